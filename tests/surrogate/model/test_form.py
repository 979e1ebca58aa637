"""Damaged and malicious models: one sentence names the part, little memory is taken, and nothing outside the folder is read."""

from __future__ import annotations

import contextlib
import copy
import hashlib
import json
import os
import resource
import struct
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from surrogate import Surrogate
from tests.support.visualizations import base, of_functions, of_isovalue, surrogate

TENSORS, RECORD = "model.safetensors", "model.json"
TRAINING = {
    "fingerprint": "f",
    "appearance": "a",
    "seconds": 1.0,
    "steps": 3,
    "settings": {},
    "curve": [],
    "choices": [],
}


@cache
def contents() -> tuple[bytes, str]:
    fitted = base()
    made = surrogate(fitted, of_isovalue(fitted, 1), of_functions(fitted))
    _, (tensors, record, _) = made.__reduce__()
    return tensors, record.decode()


def written(folder: Path, change: Callable[[dict[str, Any]], object], tensors: bytes | None = None) -> Path:
    """A model whose record was changed; its hash is that of the `tensors`."""
    content, text = contents()
    content = content if tensors is None else tensors
    record = json.loads(text)
    record["training"] = copy.deepcopy(TRAINING)
    record["tensors"]["sha256"] = hashlib.sha256(content).hexdigest()
    change(record)
    (folder / TENSORS).write_bytes(content)
    (folder / RECORD).write_text(json.dumps(record))
    return folder


def put(*path: Any) -> Callable[[dict[str, Any]], None]:
    """Sets the value at the end of a path of keys."""
    *keys, last, value = path

    def change(record: dict[str, Any]) -> None:
        for key in keys:
            record = record[key]
        record[last] = value

    return change


def drop(*path: Any) -> Callable[[dict[str, Any]], None]:
    *keys, last = path

    def change(record: dict[str, Any]) -> None:
        for key in keys:
            record = record[key]
        del record[last]

    return change


NAN = float("nan")
DAMAGE = [
    (put("schema", -1), "the file: schema must be a whole number from 1 on, got -1"),
    (put("schema", True), "the file: schema must be"),
    (put("schema", "3"), "the file: schema must be"),
    (drop("schema"), "the file: 'schema' is missing"),
    (put("normalization", "extent", 0.0), "normalization: extent must be positive"),
    (put("normalization", "extent", NAN), "normalization: extent must be a finite number"),
    (put("normalization", "center", [0.0, 1.0]), "normalization: center must be 3 numbers"),
    (put("normalization", "center", ["0", "1", "2"]), "normalization: center must be a finite number, got '0'"),
    (put("normalization", []), "normalization: "),
    (put("rasterizer", "near", -1.0), "rasterizer: near must be positive"),
    (put("rasterizer", "dilation", -1.0), "rasterizer: dilation must not be negative"),
    (put("rasterizer", "alpha_cap", 1.0), "rasterizer: alpha_floor and alpha_cap"),
    (put("rasterizer", "alpha_floor", "0"), "rasterizer: alpha_floor must be a finite number"),
    (put("rasterizer", "backend", "os.system"), "rasterizer: backend must be one of"),
    (put("rasterizer", "speed", 3), "rasterizer: unknown values speed"),
    (put("background", [0.0, 2.0, 0.0]), "background: a colour must lie in"),
    (put("background", "red"), "background: it must be 3 numbers"),
    (drop("background"), "background: 'background' is missing"),
    (put("parameters", {}), "parameters: they must be a list of objects"),
    (put("parameters", 0, "low", NAN), "parameters: .*must be a finite number, got nan"),
    (put("parameters", 0, "scale", "cubic"), "parameters: .*scale must be one of"),
    (put("parameters", []), "deformation: it must be of 0 parameters, got 1"),
    (put("deformation", "units", [1.0] * 12), "deformation: units must be a list of 13 or 14 or 23 numbers"),
    (put("deformation", "units", [NAN] * 14), "deformation: units must be a finite number"),
    (put("deformation", "units", 0, 0.0), "deformation: weights_out must be of shape"),
    (put("deformation", "kind", ["bilinear"]), "deformation: unknown deformation \\['bilinear'\\]"),
    (put("encodings", []), "encodings: they must be formats"),
    (put("encodings", {"gaussians.means": []}), "encodings: "),
    (put("training", []), "training: it must be an object"),
    (drop("training", "settings"), "training: settings are missing"),
    (put("training", "settings", None), "training: settings must be of type dict"),
    (put("training", "seconds", "long"), "training: seconds must be a finite number"),
    (put("training", "choices", [3]), "training: choices must be a list of objects"),
    (put("visualizations", {}), "visualizations: they must be a list"),
    (put("visualizations", 0, "color_degree", 7), "visualization 0: color_degree must be 0 or 1"),
    (put("visualizations", 0, "variation", "settings", 0, "values", [NAN]), "visualization 0: .*must be finite"),
    (put("visualizations", 0, "variation", "base", 5), "visualization 0: appearances must have names"),
    (put("visualizations", 1, "deformation", "steps", [1.0]), "visualization 1: steps must be 4 numbers"),
    (put("visualizations", 1, "deformation", "values", [0.0]), "visualization 1: weights of 1 increasing values"),
    (put("visualizations", 1, "deformation", "base", "opacity_points", [[0, 0], [1, 1]]), "visualization 1: "),
    (put("tensors", "file", "../model.safetensors"), "tensors: file must be 'model.safetensors'"),
    (put("tensors", "file", "/dev/zero"), "tensors: file must be 'model.safetensors'"),
    (put("tensors", []), "tensors: file must be 'model.safetensors'"),
    (put("tensors", "sha256", "0" * 64), "model.safetensors: it does not belong to the record"),
]


@pytest.mark.parametrize(("change", "complaint"), DAMAGE, ids=[words[:60] for _, words in DAMAGE])
def test_each_damaged_part_is_named(tmp_path: Path, change: Any, complaint: str) -> None:
    with pytest.raises(ValueError, match=rf"model\.json is damaged: {complaint}") as caught:
        Surrogate.load(written(tmp_path, change))
    assert "\n" not in str(caught.value)


def test_what_is_not_damaged_is_read(tmp_path: Path) -> None:
    assert Surrogate.load(written(tmp_path, lambda record: None)).training == TRAINING


def safetensors_of(header: dict[str, Any], data: bytes) -> bytes:
    text = json.dumps(header).encode()
    return struct.pack("<Q", len(text)) + text + data


def header_and_data() -> tuple[dict[str, Any], bytes]:
    content = contents()[0]
    length = struct.unpack("<Q", content[:8])[0]
    return json.loads(content[8 : 8 + length]), content[8 + length :]


def test_numbers_that_are_not_finite_are_named(tmp_path: Path) -> None:
    header, data = header_and_data()
    begin = header["gaussians.quats"]["data_offsets"][0]
    wrong = data[:begin] + struct.pack("<f", NAN) + data[begin + 4 :]
    folder = written(tmp_path, lambda record: None, safetensors_of(header, wrong))
    with pytest.raises(ValueError, match=r"tensor 'gaussians\.quats': it has numbers that are not finite"):
        Surrogate.load(folder)


@pytest.mark.parametrize(
    ("change", "complaint"),
    [
        (put("gaussians.means", "shape", [10**12, 3]), "can't be of shape|describes"),
        (put("gaussians.means", "dtype", "F64"), "tensor 'gaussians.means' must be of a type among"),
        (put("gaussians.means", "shape", "3"), "must have a shape of whole numbers"),
        (put("gaussians.means", "data_offsets", [0, 4]), "its header can't be read"),
        (put("gaussians.means", 3), "tensor 'gaussians.means' must be of a type among"),
        (put("gaussians.log_scales", "shape", [0, 10**9]), "can't be of shape"),
        (drop("gaussians.means"), "its header describes"),
    ],
)
def test_headers_that_lie_are_named(tmp_path: Path, change: Any, complaint: str) -> None:
    header, data = header_and_data()
    change(header)
    folder = written(tmp_path, lambda record: None, safetensors_of(header, data))
    with pytest.raises(ValueError, match=rf"is damaged: model\.safetensors: .*({complaint})"):
        Surrogate.load(folder)


def link_out(folder: Path, name: str) -> None:
    outside = folder.parent / f"{folder.name}-{name}"
    os.replace(folder / name, outside)
    (folder / name).symlink_to(outside)


def pipe(folder: Path, name: str) -> None:
    (folder / name).unlink()
    os.mkfifo(folder / name)


def zeros(folder: Path, name: str) -> None:
    (folder / name).unlink()
    (folder / name).symlink_to("/dev/zero")


def folder_instead(folder: Path, name: str) -> None:
    (folder / name).unlink()
    (folder / name).mkdir()


def sparse(folder: Path, name: str) -> None:
    os.truncate(folder / name, 10**12)


@pytest.mark.timeout(60)
@pytest.mark.parametrize("name", [TENSORS, RECORD])
@pytest.mark.parametrize("harm", [link_out, pipe, zeros, folder_instead, sparse])
def test_only_regular_files_of_the_folder_are_read(tmp_path: Path, name: str, harm: Any) -> None:
    folder = tmp_path / "model"
    folder.mkdir()
    harm(written(folder, lambda record: None), name)
    with pytest.raises(
        (ValueError, FileNotFoundError), match=r"is damaged: (the file|model\.safetensors): |no trained"
    ):
        Surrogate.load(folder)


def test_a_link_within_the_folder_is_followed(tmp_path: Path) -> None:
    folder = written(tmp_path, lambda record: None)
    os.replace(folder / TENSORS, folder / "data")
    (folder / TENSORS).symlink_to("data")
    Surrogate.load(folder)


def paths_of(value: Any, path: tuple[Any, ...] = ()) -> list[tuple[Any, ...]]:
    """The paths of all values of a record."""
    keys: Any = value if isinstance(value, dict) else range(len(value)) if isinstance(value, list) else ()
    return [path][: bool(path)] + [found for key in keys for found in paths_of(value[key], (*path, key))]


STRANGE = st.one_of(
    st.sampled_from(
        [None, True, -1, 0, 1, 2**63, 10**30, NAN, float("inf"), -0.5, "", "x", "../x", [], {}, [[]], [None]]
    ),
    st.integers(),
    st.floats(),
    st.text(max_size=5),
)


@settings(max_examples=60, suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow])
@given(data=st.data())
def test_whatever_a_record_says_either_is_read_or_refused(tmp_path: Path, data: st.DataObject) -> None:
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    record = json.loads(contents()[1])
    chosen = data.draw(st.lists(st.sampled_from(paths_of(record)), min_size=1, max_size=3))

    def change(values: dict[str, Any]) -> None:
        for path in chosen:
            try:
                put(*path, data.draw(STRANGE))(values)
            except (TypeError, KeyError, IndexError):
                drop(*path[:1])(values) if path[0] in values else None

    _load(written(tmp_path, change))
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 500_000  # kB


@settings(max_examples=60, suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow])
@given(data=st.data())
def test_whatever_a_header_says_either_is_read_or_refused(tmp_path: Path, data: st.DataObject) -> None:
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    header, content = header_and_data()
    for path in data.draw(st.lists(st.sampled_from(paths_of(header)), min_size=1, max_size=3)):
        try:
            put(*path, data.draw(STRANGE | st.lists(st.integers(-1, 2**70), max_size=4)))(header)
        except (TypeError, KeyError, IndexError):
            header.pop(path[0], None)
    made = safetensors_of(header, content[: data.draw(st.sampled_from([0, len(content) // 2, len(content)]))])
    _load(written(tmp_path, lambda record: None, made))
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 500_000  # kB


def _load(folder: Path) -> None:
    """Raises whatever is neither of these two."""
    with contextlib.suppress(ValueError, FileNotFoundError):
        assert len(repr(Surrogate.load(folder))) < 2000
