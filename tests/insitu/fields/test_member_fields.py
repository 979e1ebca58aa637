"""Which fields a member is taken to have, and everything that is refused before it is rendered."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from catalogs.vocabulary.appearance import Isosurface
from insitu.fields.field import Field
from insitu.fields.location import FieldLocation
from insitu.fields.member_fields import as_fields, check_names, time_of
from render import to_grid

VALUES = np.random.default_rng(0).random((3, 4, 5)).astype(np.float32)
PLACED: dict[str, Any] = {"spacing": (1.0, 2.0, 3.0), "origin": (4.0, 5.0, 6.0)}
UNNAMED = [Isosurface("one", 0.5), Isosurface("two", 0.6)]
NAMED = [Isosurface("one", 0.5, field="q"), Isosurface("two", 0.6, field="speed"), Isosurface("three", 0.7, field="q")]


def data_set(**arrays: np.ndarray) -> Any:
    import pyvista

    mesh = pyvista.ImageData(dimensions=(5, 4, 3), **PLACED)
    for name, values in arrays.items():
        mesh[name] = values.ravel()
    return mesh


def labelled(**arrays: np.ndarray) -> Any:
    xarray = pytest.importorskip("xarray")
    along = {
        d: o + s * np.arange(n)
        for d, o, s, n in zip("xyz", PLACED["origin"], PLACED["spacing"], (5, 4, 3), strict=True)
    }
    data = {name: xarray.DataArray(values, coords=along, dims=("z", "y", "x")) for name, values in arrays.items()}
    return xarray.Dataset(data).transpose("x", "z", "y")


def held(scale: float) -> Field:
    return Field(VALUES * scale, PLACED["spacing"], PLACED["origin"], time=1.5)


HOLDERS = {
    "arrays": ({"speed": VALUES * 2, "q": VALUES}, PLACED),
    "lists": ({"speed": (VALUES * 2).tolist(), "q": VALUES.tolist()}, PLACED),
    "fields that know their place": ({"q": held(1), "speed": held(2)}, {}),
    "both": ({"q": held(1), "speed": VALUES * 2}, PLACED),
    "labelled arrays": ({"q": labelled(q=VALUES)["q"], "speed": labelled(q=VALUES * 2)["q"]}, {}),
    "a labelled data set": (labelled(q=VALUES, speed=VALUES * 2, other=VALUES * 3), {}),
    "grids": ({"q": to_grid(VALUES, **PLACED), "speed": to_grid(VALUES * 2, **PLACED)}, {}),
    "a data set": (data_set(q=VALUES, pressure=VALUES * 3, speed=VALUES * 2), {}),
    "a data set each": ({"q": data_set(a=VALUES), "speed": data_set(b=VALUES * 2)}, {}),
}


@pytest.mark.parametrize("case", HOLDERS)
def test_fields_are_found_by_name_whatever_holds_them(case: str) -> None:
    data, placed = HOLDERS[case]
    found = as_fields(data, NAMED, FieldLocation(**placed))
    assert list(found.grids) == ["q", "speed"]
    for appearance, scale in zip(NAMED, (1, 2, 1), strict=True):
        grid = found.shown_by(appearance)
        assert np.array_equal(grid.values, VALUES * np.float32(scale))
        assert (grid.spacing, grid.origin) == (PLACED["spacing"], PLACED["origin"])
    assert found.ranges["speed"] == (float(2 * VALUES.min()), float(2 * VALUES.max()))


@pytest.mark.parametrize("data", [VALUES, {"q": VALUES}, {"whatever": VALUES}])
def test_the_only_field_needs_no_name(data: Any) -> None:
    found = as_fields(data, UNNAMED, FieldLocation(**PLACED))
    assert list(found.grids) == [""]
    assert found.shown_by(UNNAMED[0]) is found.shown_by(UNNAMED[1])
    assert np.array_equal(found.grids[""].values, VALUES)


def test_only_what_a_member_shows_is_looked_at() -> None:
    broken = {"q": np.full((3, 4, 5), np.nan), "speed": VALUES}
    assert list(as_fields(broken, NAMED[1:2], FieldLocation(**PLACED), all_appearances=NAMED).grids) == ["speed"]
    assert list(as_fields({"speed": VALUES}, NAMED[1:2], FieldLocation(**PLACED), all_appearances=NAMED).grids) == [
        "speed"
    ]


def test_holes_are_each_fields_own() -> None:
    holed = VALUES.copy()
    holed[1, 2, 3] = np.nan
    found = as_fields({"q": VALUES, "speed": holed}, NAMED, FieldLocation(nan="transparent"))
    assert found.grids["q"].holes is None
    assert found.grids["speed"].holes is not None
    assert found.grids["speed"].holes.sum() == 1


def cells(mesh: Any) -> Any:
    mesh.cell_data["speed"] = np.zeros(24)
    return mesh


WRONG: dict[str, tuple[Any, list[Isosurface], dict[str, Any], list[str]]] = {
    "a field is missing": (
        {"q": VALUES},
        NAMED,
        {},
        ["appearance two", "'speed'", "the member has q", "let the appearance name one of these"],
    ),
    "all are missing": ({"Q": VALUES, "U": VALUES}, NAMED, {}, ["appearance one", "'q'", "Q, U"]),
    "a field that none shows": (
        {"q": VALUES, "speed": VALUES, "p": VALUES},
        NAMED,
        {},
        ["p, which no appearance shows", "q, speed", "leave them out"],
    ),
    "nobody says which": (
        {"q": VALUES, "speed": VALUES},
        UNNAMED,
        {},
        ["q, speed", "appearance one", "give every appearance its field", "field='q'"],
    ),
    "some do not say which": ({"q": VALUES}, [NAMED[0], UNNAMED[1]], {}, ["one name the field", "two do not"]),
    "nothing at all": ({}, NAMED, {}, ["by name", "the names none"]),
    "a number for a name": ({3: VALUES, "q": VALUES}, NAMED, {}, ["by name", "3, q"]),
    "no name": ({"": VALUES}, UNNAMED, {}, ["by name", ""]),
    "an array without names": (VALUES, NAMED, {}, ["appearance one", "'q'", "one ndarray without a name", "pass {'q'"]),
    "another shape": (
        {"q": VALUES, "speed": VALUES[:, :, :4]},
        NAMED,
        {},
        ["share shape, spacing and origin", "'speed' is 4 x 4 x 3", "'q' is 5 x 4 x 3", "resample"],
    ),
    "another place": (
        {"q": held(1), "speed": Field(VALUES, PLACED["spacing"], (0.0, 0.0, 0.0))},
        NAMED,
        {},
        ["'speed' is 5 x 4 x 3 from (0, 0, 0)", "from (4, 5, 6)"],
    ),
    "another spacing": (
        {"q": held(1), "speed": Field(VALUES, (1.0, 2.0, 3.5), PLACED["origin"])},
        NAMED,
        {},
        ["'speed' is 5 x 4 x 3 from (4, 5, 6) to (8, 11, 13)", "to (8, 11, 12)"],
    ),
    "points and cells": (cells(data_set(q=VALUES)), NAMED, {}, ["'speed' is 4 x 3 x 2", "'q' is 5 x 4 x 3"]),
    "NaN in one": (
        {"q": VALUES, "speed": np.where(VALUES > 0.9, np.nan, VALUES)},
        NAMED,
        {},
        ["field 'speed', which two shows", "NaN", "(z, y, x)"],
    ),
    "text in one": ({"q": np.full((3, 4, 5), "x"), "speed": VALUES}, NAMED, {}, ["field 'q', which one", "numbers"]),
    "two-dimensional": ({"q": VALUES[0], "speed": VALUES[0]}, NAMED, {}, ["field 'q'"]),
    "an array that the data set lacks": (data_set(q=VALUES), NAMED, {}, ["field 'speed', which two shows", "no array"]),
    "an array beside names": (data_set(q=VALUES), NAMED, {"array": "q"}, ["array='q'", "leave array out"]),
    "several arrays without names": (data_set(q=VALUES, speed=VALUES), UNNAMED, {}, ["name the array", "'speed'"]),
    "an unknown policy": ({"q": VALUES, "speed": VALUES}, NAMED, {"nan": "ignore"}, ["field 'q'", "'ignore'"]),
}


@pytest.mark.parametrize("case", WRONG)
def test_what_is_wrong_is_named_with_its_remedy(case: str) -> None:
    data, appearances, options, said = WRONG[case]
    with pytest.raises((ValueError, TypeError)) as caught:
        as_fields(data, appearances, FieldLocation(**options))
    for words in said:
        assert words in str(caught.value)


def test_names_alone_are_checked_before_there_are_fields() -> None:
    check_names(["speed", "q"], NAMED, NAMED)
    check_names(["q"], NAMED[:1], NAMED)
    check_names(["anything"], UNNAMED, UNNAMED)
    with pytest.raises(ValueError, match="'speed', but the member has"):
        check_names(["q"], NAMED, NAMED)


def test_the_time_is_the_fields() -> None:
    assert time_of(held(1)) == time_of({"q": held(1), "speed": VALUES}) == 1.5
    assert time_of(VALUES) is time_of({"q": VALUES}) is time_of(SimpleNamespace()) is None


def test_a_labelled_array_may_bear_the_fields_name() -> None:
    data = labelled(q=VALUES)["q"]
    assert np.array_equal(as_fields(data, NAMED[:1]).grids["q"].values, VALUES)
    with pytest.raises(ValueError, match="shows the field 'speed'"):
        as_fields(data, NAMED[1:2])


def test_a_labelled_time_is_a_time_where_it_is_one_number() -> None:
    data = labelled(q=VALUES)
    assert time_of(data.assign_coords(time=2.5)) == time_of(data["q"].assign_coords(time=2.5)) == 2.5
    assert time_of(data.assign_coords(time=np.datetime64("2020-01-01", "ns"))) is None
    assert time_of(data) is None


def test_units_of_labelled_arrays_are_the_fields() -> None:
    data = labelled(q=VALUES, speed=VALUES)
    data["q"].attrs["units"] = "K"
    assert str(as_fields(data, NAMED[:1]).quantities["q"]) == "q (K)"
    assert str(as_fields(data["q"], UNNAMED).quantities[""]) == "q (K)"


def test_what_data_say_of_their_names_and_units_is_kept() -> None:
    xarray = pytest.importorskip("xarray")
    along = dict(zip("zyx", map(np.arange, VALUES.shape), strict=True))
    array = xarray.DataArray(VALUES, coords=along, dims=("z", "y", "x"), name="q", attrs={"units": "1/s²"})
    several = xarray.Dataset({"q": array, "speed": 2 * array})
    field = Field(VALUES, PLACED["spacing"], PLACED["origin"], "T", "K")
    for data, looks, said in (
        (array, UNNAMED, {"": "q (1/s²)"}),
        (xarray.Dataset({"q": array}), UNNAMED, {"": "q (1/s²)"}),
        (several, NAMED, {"q": "q (1/s²)", "speed": "speed (1/s²)"}),
        (field, UNNAMED, {"": "T (K)"}),
        ({"q": field, "speed": Field(VALUES, PLACED["spacing"], PLACED["origin"])}, NAMED, {"q": "T (K)"}),
        (SimpleNamespace(values=VALUES, **PLACED, name=5, unit=["m"]), UNNAMED, {}),
        (SimpleNamespace(values=VALUES, **PLACED, name="a\x00b", unit=" m "), UNNAMED, {"": "m"}),
    ):
        assert {name: str(found) for name, found in as_fields(data, looks).quantities.items()} == said


@pytest.mark.parametrize("time", [np.datetime64("2026-01-01"), "noon", np.arange(3.0), float("nan")])
def test_what_is_no_time_is_not_taken_for_one(time: Any) -> None:
    assert time_of(SimpleNamespace(time=time)) is None
