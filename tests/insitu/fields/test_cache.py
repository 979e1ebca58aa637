"""Fields kept between pilot run and rendering."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from insitu.fields.cache import drop_field, load_field, save_field
from insitu.fields.field import Field
from insitu.fields.location import FieldLocation
from insitu.fields.member_fields import Fields, as_fields
from render.grids import Grid

IDENTITY = {"simulation": "flow", "Re": 100.0}


def field(time: float | None = 2.0) -> Field:
    values = np.random.default_rng(0).random((3, 4, 5)).astype(np.float32)
    return Field(values, (0.1, 0.2, 0.3), (1.0, 2.0, 3.0), time=time)


@pytest.mark.parametrize("time", [2.0, None])
def test_what_is_kept_comes_back_bit_for_bit(tmp_path: Path, time: float | None) -> None:
    save_field(tmp_path / "kept", "a", IDENTITY, field(time))
    back = load_field(tmp_path / "kept", "a", dict(reversed(IDENTITY.items())))
    assert back is not None
    assert np.array_equal(back.values, field().values)
    assert (back.spacing, back.origin, back.time) == ((0.1, 0.2, 0.3), (1.0, 2.0, 3.0), time)


@pytest.mark.parametrize("kind", [np.float32, np.float64])
def test_samples_without_a_value_stay_without_one(tmp_path: Path, kind: type) -> None:
    values = np.random.default_rng(0).random((3, 4, 5)).astype(kind)
    holed = values.copy()
    holed[1, 2, 3] = np.nan
    save_field(
        tmp_path,
        "a",
        IDENTITY,
        as_fields(Field(holed, (0.1, 0.2, 0.3), (1.0, 2.0, 3.0)), (), FieldLocation(nan="transparent")),
    )
    back = load_field(tmp_path, "a", IDENTITY)
    assert back is not None
    assert np.array_equal(back.values, holed, equal_nan=True)
    assert (back.spacing, back.origin) == ((0.1, 0.2, 0.3), (1.0, 2.0, 3.0))


def test_several_fields_keep_their_names(tmp_path: Path) -> None:
    grids = {name: Grid(np.full((2, 2, 2), value, np.float32)) for name, value in (("a", 1.0), ("b", 2.0))}
    save_field(tmp_path, "m", IDENTITY, Fields(grids))
    back = load_field(tmp_path, "m", IDENTITY)
    assert back is not None
    assert {name: float(found.values.max()) for name, found in back.items()} == {"a": 1.0, "b": 2.0}


def test_what_another_simulation_left_is_not_taken(tmp_path: Path) -> None:
    save_field(tmp_path, "a", IDENTITY, field())
    assert load_field(tmp_path, "a", {**IDENTITY, "Re": 101.0}) is None
    assert load_field(tmp_path, "b", IDENTITY) is None


@pytest.mark.parametrize("length", [0, 10, 200, 400])
def test_a_truncated_field_is_not_taken(tmp_path: Path, length: int) -> None:
    save_field(tmp_path, "a", IDENTITY, field())
    path = tmp_path / "a.npz"
    path.write_bytes(path.read_bytes()[:length])
    assert load_field(tmp_path, "a", IDENTITY) is None


def test_the_last_one_takes_the_folder_along(tmp_path: Path) -> None:
    folder = tmp_path / "kept"
    save_field(folder, "a", IDENTITY, field())
    save_field(folder, "b", IDENTITY, field())
    drop_field(folder, "a")
    assert folder.is_dir()
    drop_field(folder, "b")
    assert not folder.exists()
    drop_field(folder, "b")


def test_a_field_with_any_bit_of_its_archive_flipped_is_not_an_error(tmp_path: Path) -> None:
    save_field(tmp_path, "a", {}, Field(np.zeros((3, 3, 3), np.float32), (1.0, 1.0, 1.0), (0.0, 0.0, 0.0)))
    (path,) = tmp_path.iterdir()
    whole, missing = path.read_bytes(), 0
    for place in range(0, len(whole), 5):
        damaged = bytearray(whole)
        damaged[place] ^= 0b10000
        path.write_bytes(damaged)
        missing += load_field(tmp_path, "a", {}) is None
    assert missing > len(whole) // 10
