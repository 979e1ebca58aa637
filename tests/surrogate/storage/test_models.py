"""Models are read as they were written, and damaged ones are named."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from catalogs.vocabulary.cameras import Camera
from surrogate import Surrogate
from surrogate.storage.encoding import encode
from tests.support.surrogates import CENTER, some_surrogate

CAMERA = Camera.look_at(CENTER + np.array([90.0, 120.0, 60.0]), CENTER, vertical_fov_degrees=35, width=24, height=20)


def test_a_saved_surrogate_draws_the_same_pictures(tmp_path: Path) -> None:
    surrogate = some_surrogate(color_columns=12)
    surrogate.save(tmp_path / "model")
    loaded = Surrogate.load(tmp_path / "model")
    expected = surrogate.at(Re=1830.0, time=0.4).render(CAMERA)
    np.testing.assert_array_equal(loaded.at(Re=1830.0, time=0.4).render(CAMERA), expected)
    assert loaded.background == (1.0, 0.5, 0.0)
    assert expected[..., 3].max() > 0.2
    assert sorted(path.name for path in (tmp_path / "model").iterdir()) == ["model.json", "model.safetensors"]


def encoded(surrogate: Surrogate) -> Surrogate:
    """The same, most of whose tensors are stored in fewer bits."""
    forms = {"gaussians.means": "uint16", "gaussians.colors": "uint8", "gaussians.quats": "float16"}
    tensors = surrogate.gaussians.tensors()
    encodings = {name: encode(tensors[name.partition(".")[2]], form) for name, form in forms.items()}
    decoded = {name.partition(".")[2]: encoding.decoded() for name, encoding in encodings.items()}
    latents = encode(surrogate.deformation.tensors()["latents"], "uint8")
    return replace(
        surrogate,
        gaussians=replace(surrogate.gaussians, **decoded),
        deformation=replace(surrogate.deformation, latents=latents.decoded()),  # type: ignore[type-var]
        encodings=encodings | {"deformation.latents": latents},
    )


def test_fewer_bits_are_stored_read_and_stored_again_without_a_change(tmp_path: Path) -> None:
    plain, small = some_surrogate(), encoded(some_surrogate())
    plain.save(tmp_path / "plain")
    small.save(tmp_path / "small")
    Surrogate.load(tmp_path / "small").save(tmp_path / "again")
    loaded = Surrogate.load(tmp_path / "again")
    at = {"Re": 1830.0, "time": 0.4}
    np.testing.assert_array_equal(loaded.at(**at).render(CAMERA), small.at(**at).render(CAMERA))
    stored = [(tmp_path / folder / "model.safetensors").read_bytes() for folder in ("plain", "small", "again")]
    assert stored[1] == stored[2]
    assert len(stored[1]) < len(stored[0])
    assert loaded.megabytes == small.megabytes < plain.megabytes


def test_a_tensor_that_was_replaced_is_stored_as_it_is(tmp_path: Path) -> None:
    small = encoded(some_surrogate())
    moved = replace(small, gaussians=replace(small.gaussians, means=small.gaussians.means + 0.123))
    moved.save(tmp_path)
    loaded = Surrogate.load(tmp_path)
    assert torch.equal(loaded.gaussians.means, moved.gaussians.means)
    assert sorted(loaded.encodings) == ["deformation.latents", "gaussians.colors", "gaussians.quats"]


@pytest.mark.parametrize(
    ("encodings", "complaint"),
    [
        ({"gaussians.means": "uint8"}, "a tensor in 'uint8' must consist of"),
        ({"gaussians.means": "pickle"}, "a tensor in 'pickle' must consist of"),
        ({}, r"is damaged: encodings: '(gaussians|deformation)\.[a-z]*' is missing"),
    ],
)
def test_encodings_that_are_not_those_of_the_tensors_are_refused(
    tmp_path: Path, encodings: dict[str, str], complaint: str
) -> None:
    encoded(some_surrogate()).save(tmp_path)
    record = json.loads((tmp_path / "model.json").read_text())
    record["encodings"] = record["encodings"] | encodings if encodings else {}
    (tmp_path / "model.json").write_text(json.dumps(record))
    with pytest.raises(ValueError, match=complaint):
        Surrogate.load(tmp_path)


def test_a_missing_surrogate_is_named(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError, match="no trained surrogate in"):
        Surrogate.load(tmp_path)


@pytest.mark.parametrize(
    ("damage", "complaint"),
    [
        (lambda record, folder: record.update(schema=99), "its schema is 99, this version reads up to"),
        (lambda record, folder: record.pop("normalization"), "is damaged: normalization: 'normalization' is missing"),
        (lambda record, folder: record["deformation"].update(kind="warp"), "unknown deformation 'warp'"),
        (
            lambda record, folder: (folder / "model.safetensors").write_bytes(b"half"),
            "is damaged: model.safetensors: its header is cut off",
        ),
        (lambda record, folder: (folder / "model.safetensors").unlink(), "model.safetensors"),
    ],
)
def test_damaged_files_are_named(tmp_path: Path, damage: object, complaint: str) -> None:
    some_surrogate().save(tmp_path)
    record = json.loads((tmp_path / "model.json").read_text())
    damage(record, tmp_path)  # type: ignore[operator]
    (tmp_path / "model.json").write_text(json.dumps(record))
    with pytest.raises(ValueError, match=complaint):
        Surrogate.load(tmp_path)


def test_a_file_that_is_no_json_is_named(tmp_path: Path) -> None:
    (tmp_path / "model.json").write_text("{")
    with pytest.raises(ValueError, match=r"model\.json is damaged: the file: "):
        Surrogate.load(tmp_path)
