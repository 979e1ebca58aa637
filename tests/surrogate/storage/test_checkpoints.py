from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from catalogs.store.catalog import Catalog
from surrogate.settings import TrainingSettings
from surrogate.storage.checkpoints import CHECKPOINT, Checkpoint, fingerprint, fingerprint_of_scene, locked
from tests.support.blobs import Blobs
from tests.support.field_blobs import BLOBS, FUNCTIONS, ISOVALUE, field_catalog


def test_a_checkpoint_survives_bit_for_bit(tmp_path: Path) -> None:
    tensors = {"a": torch.randn(7, 3), "b": torch.tensor([float("inf"), -0.0, 1e-45])}
    record = {"step": 12, "losses": [0.1 + 0.2, 1e-300], "stage": "canonical", "nothing": None}
    Checkpoint(tensors, record).save(tmp_path)
    loaded = Checkpoint.load(tmp_path)
    assert loaded is not None
    assert loaded.record == record
    assert all(loaded.tensors[name].numpy().tobytes() == tensor.numpy().tobytes() for name, tensor in tensors.items())
    assert [path.name for path in tmp_path.iterdir()] == [CHECKPOINT]


def test_tensors_begin_where_those_of_an_undisturbed_run_do(tmp_path: Path) -> None:
    """At a multiple of 64 bytes, whatever the length of the record before them: see `Checkpoint.load`."""
    for length in range(0, 64, 4):
        Checkpoint({"a": torch.randn(3), "b": torch.randn(5, 5)}, {"said": "x" * length}).save(tmp_path)
        loaded = Checkpoint.load(tmp_path)
        assert loaded is not None
        assert {tensor.data_ptr() % 64 for tensor in loaded.tensors.values()} == {0}


def test_no_checkpoint_is_none(tmp_path: Path) -> None:
    assert Checkpoint.load(tmp_path) is None


@pytest.mark.parametrize("content", [b"", b"half a file", b"\x02\x00\x00\x00\x00\x00\x00\x00{}"])
def test_what_is_no_checkpoint_is_named(tmp_path: Path, content: bytes) -> None:
    (tmp_path / CHECKPOINT).write_bytes(content)
    with pytest.raises(ValueError, match=r"checkpoint\.safetensors is not a checkpoint .*delete it to train anew"):
        Checkpoint.load(tmp_path)


def test_a_folder_is_held_by_one(tmp_path: Path) -> None:
    with locked(tmp_path), pytest.raises(RuntimeError, match="another process is training"), locked(tmp_path):
        pass
    with locked(tmp_path):
        pass


def test_the_fingerprint_sees_every_setting_and_member_but_not_the_clock(make_catalog) -> None:
    catalog = make_catalog()
    mark = fingerprint(TrainingSettings(), catalog)
    assert fingerprint(TrainingSettings(checkpoint_seconds=1.0), catalog) == mark
    others = {
        "setting": fingerprint(TrainingSettings(latent_rate=1e-5), catalog),
        "split": fingerprint(
            TrainingSettings(), make_catalog(members=(("train", 0.0), ("train", 0.5), ("test", 1.0)), name="a.cdb")
        ),
        "member": fingerprint(TrainingSettings(), make_catalog(members=(("train", 0.0), ("train", 0.5)), name="b.cdb")),
        "image": fingerprint(TrainingSettings(), make_catalog(blank=True, name="c.cdb")),
        "background": fingerprint(TrainingSettings(), make_catalog(background=(0.0, 0.0, 0.0), name="d.cdb")),
    }
    assert len({mark, *others.values()}) == 6
    assert fingerprint(TrainingSettings(), make_catalog(name="same.cdb")) == mark


def test_that_of_a_scene_is_not_of_its_pictures(make_catalog) -> None:
    marks = [
        fingerprint_of_scene(make_catalog(name=f"{number}.cdb", **options))
        for number, options in enumerate([{}, {"blank": True}, {"background": (0.0, 0.0, 0.0)}])
    ]
    assert marks[0] == marks[1] != marks[2]


@pytest.mark.parametrize(("change", "same"), [(1e-13, True), (-1e-13, True), (1e-6, False)])
def test_that_of_a_scene_does_not_see_how_a_processor_rounds_its_cameras(
    make_catalog, monkeypatch: pytest.MonkeyPatch, change: float, same: bool
) -> None:
    mark = fingerprint_of_scene(make_catalog())
    cameras = Blobs().cameras()
    moved = np.zeros((4, 4))
    moved[:3] = change
    monkeypatch.setattr(
        Blobs, "cameras", lambda _: tuple(replace(c, world_to_camera=c.world_to_camera + moved) for c in cameras)
    )
    assert (fingerprint_of_scene(make_catalog(name="moved.cdb")) == mark) == same


def varied(path: Path, **options: Any) -> Catalog:
    return field_catalog(path, **{"members": (("train", 0.0),), "view_splits": ("train",) * 2, **options})


def test_the_fingerprint_sees_the_variations_of_the_appearance_that_is_learnt(tmp_path: Path) -> None:
    settings, catalog = TrainingSettings(), varied(tmp_path / "a.cdb")
    mark = fingerprint(settings, catalog)
    assert fingerprint(settings, varied(tmp_path / "same.cdb")) == mark
    fewer = replace(ISOVALUE, settings=ISOVALUE.settings[:-1])
    others = [
        varied(tmp_path / "b.cdb", variations=(ISOVALUE,)),
        varied(tmp_path / "c.cdb", variations=(fewer, FUNCTIONS)),
        varied(tmp_path / "d.cdb", blobs=replace(BLOBS, count=13)),
    ]
    marks = {mark, *(fingerprint(settings, other) for other in others)}
    assert len(marks) == 4


@pytest.mark.parametrize(("appearance", "seen"), [("iso=0.1", True), ("tf-test-0", True), ("unrelated", False)])
def test_the_fingerprint_sees_images_of_variations_but_not_of_other_appearances(
    tmp_path: Path, appearance: str, seen: bool
) -> None:
    settings, catalog = TrainingSettings(), varied(tmp_path / "a.cdb", unrelated=True)
    mark = fingerprint(settings, catalog)
    path = catalog.image_path(catalog.members[0], appearance, 1)
    path.write_bytes(path.read_bytes() + b"longer")
    assert (fingerprint(settings, Catalog.open(catalog.path)) != mark) == seen


def test_the_fingerprint_of_a_plain_run_does_not_see_variations_or_what_else_is_shown(tmp_path: Path) -> None:
    plain = TrainingSettings(visualization_steps=0)
    catalogs = (
        varied(tmp_path / "a.cdb"),
        varied(tmp_path / "b.cdb", variations=()),
        varied(tmp_path / "c.cdb", variations=(ISOVALUE,), unrelated=True),
    )
    assert len({fingerprint(plain, catalog) for catalog in catalogs}) == 1
    with_steps = TrainingSettings()
    assert fingerprint(with_steps, catalogs[1]) != fingerprint(with_steps, catalogs[0])
    unrelated = varied(tmp_path / "d.cdb", unrelated=True)
    assert fingerprint(with_steps, unrelated) == fingerprint(with_steps, catalogs[0])
