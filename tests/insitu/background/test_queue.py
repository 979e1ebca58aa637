"""Queued fields were checked without a look at their values, and fill the box of the whole field."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from catalogs.vocabulary.appearance import Isosurface
from insitu.background.queue import handed_over
from insitu.fields.field import Field
from insitu.fields.location import FieldLocation
from insitu.fields.member_fields import Fields, LocalField

SHAPE = (5, 6, 7)
VALUES = np.linspace(0.0, 1.0, 5 * 6 * 7).reshape(SHAPE)
ONE = [Isosurface("surface", 0.5)]
TWO = [Isosurface("a", 0.5, field="u"), Isosurface("b", 0.5, field="v")]
PLACE = {"spacing": (0.5, 1.0, 2.0), "origin": (1.0, 2.0, 3.0)}
TAKEN: dict[str, tuple[Any, list[Isosurface], dict[str, Any], bool]] = {
    "an array": (VALUES, ONE, PLACE, True),
    "without a border": (VALUES[1:-1, 1:-1, 1:-1], ONE, PLACE, True),
    "whole numbers": (VALUES.astype(np.int16), ONE, {}, True),
    "a field": (Field(VALUES.astype(np.float32), (1.0, 2.0, 3.0), (0.0, 0.0, 1.0), "Q", "1/s"), ONE, {}, True),
    "several": ({"u": VALUES, "v": -VALUES}, TWO, PLACE, True),
    "other axes": (VALUES, ONE, {**PLACE, "dims": ("x", "y", "z")}, False),
    "masked": (np.ma.masked_less(VALUES, 0.1), ONE, {**PLACE, "nan": "transparent"}, False),
    "a list": (VALUES.tolist(), ONE, PLACE, False),
}


@pytest.mark.parametrize("case", TAKEN)
def test_what_comes_out_is_what_the_loop_would_have_made(case: str) -> None:
    data, appearances, place, plain = TAKEN[case]
    given = LocalField(data, FieldLocation(**place))
    handed, box = handed_over(given, appearances, appearances)
    assert isinstance(handed.data, Fields) != plain
    wanted, found = given.take(appearances, appearances), handed.take(appearances, appearances)
    assert box == found.box == wanted.box
    assert list(found.grids) == list(wanted.grids)
    for one, other in zip(found.grids.values(), wanted.grids.values(), strict=True):
        assert np.array_equal(one.values, other.values)
        assert one.spacing == other.spacing
    assert found.quantities == wanted.quantities


def test_only_what_is_shown_is_handed_over() -> None:
    handed, _ = handed_over(LocalField({"u": VALUES, "v": -VALUES}), TWO[:1], TWO)
    assert list(handed.data) == ["u"]


def test_values_are_not_looked_at() -> None:
    handed, _ = handed_over(LocalField(np.full(SHAPE, np.nan)), ONE, ONE)
    assert np.isnan(handed.data).all()


@pytest.mark.parametrize(
    ("data", "appearances", "place", "message"),
    [
        (VALUES[0], ONE, {}, "3 axes"),
        (VALUES[:1], ONE, {}, "at least 2"),
        (VALUES.astype(complex), ONE, {}, "real numbers"),
        (VALUES, ONE, {"spacing": (0.0, 1.0, 1.0)}, "positive"),
        (VALUES, ONE, {"nan": "maybe"}, "nan"),
        ({"u": VALUES}, TWO, {}, "'v'"),
        ({"u": VALUES, "v": VALUES[:-1]}, TWO, {}, "share shape"),
        ({}, TWO, {}, "by name"),
        (None, ONE, {}, "field"),
    ],
)
def test_what_is_wrong_is_told_at_once(data: Any, appearances: list[Isosurface], place: Any, message: str) -> None:
    with pytest.raises((ValueError, TypeError), match=message):
        handed_over(LocalField(data, FieldLocation(**place)), appearances, appearances)
