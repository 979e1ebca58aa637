"""Fields are recognized, and others refused, before anything is drawn."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

from render.datasets import to_grid
from render.grids import Grid

FIELD = np.arange(24.0).reshape(2, 3, 4)


def test_axes_spacing_and_origin_make_the_box() -> None:
    grid = to_grid(FIELD, spacing=(0.5, 1.0, 2.0), origin=(10, 20, 30))
    assert grid.shape == (2, 3, 4)
    assert grid.values.dtype == np.float32
    assert not grid.values.flags.writeable
    np.testing.assert_allclose(grid.bounds, [[10, 20, 30], [11.5, 22, 32]])
    np.testing.assert_allclose(grid.center, [10.75, 21, 31])
    assert grid.bounding_radius == pytest.approx(np.linalg.norm([1.5, 2, 2]) / 2)
    assert to_grid(grid) is grid
    assert "4 x 3 x 2" in repr(grid)


def test_the_callers_array_is_neither_shared_nor_frozen() -> None:
    field = FIELD.astype(np.float32)
    grid = to_grid(field)
    field[0, 0, 0] = 99
    assert grid.values[0, 0, 0] == 0


@pytest.mark.parametrize("dtype", [np.float16, np.float32, np.float64, np.int16, np.uint8, np.int64, bool])
@pytest.mark.parametrize("order", ["C", "F"])
def test_real_numbers_of_any_kind_and_layout(dtype: type, order: str) -> None:
    np.testing.assert_array_equal(to_grid(np.array(FIELD > 5, dtype=dtype, order=order)).values, FIELD > 5)
    np.testing.assert_array_equal(to_grid(FIELD[::-1, ::2].astype(dtype)).values, FIELD[::-1, ::2].astype(dtype))


@pytest.mark.parametrize("unit", [1e-30, 1e-10, 1e10, 1e90])
def test_any_unit_of_length_does(unit: float) -> None:
    grid = to_grid(FIELD, spacing=unit, origin=(5 * unit, 0, -unit))
    np.testing.assert_allclose(grid.bounds[1] / unit, np.array([5, 0, -1]) + np.array(FIELD.shape[::-1]) - 1)


def test_a_constant_field_is_a_field() -> None:
    assert to_grid(np.full((2, 2, 2), 7)).values.min() == 7


@pytest.mark.parametrize(
    ("data", "options", "error", "message"),
    [
        (np.zeros((0, 4, 4)), {}, ValueError, "at least 2 samples along every axis, got (0, 4, 4)"),
        (np.zeros((4, 1, 4)), {}, ValueError, "at least 2 samples along every axis, got (4, 1, 4)"),
        (np.zeros((4, 4)), {}, ValueError, "3 axes (z, y, x), got 2"),
        (np.zeros((4, 4, 4, 3)), {}, ValueError, "3 axes (z, y, x), got 4"),
        (np.zeros((2, 2, 2), dtype=complex), {}, TypeError, "real numbers, got complex128"),
        (np.full((2, 2, 2), "x"), {}, TypeError, "real numbers, got <U1"),
        (np.full((2, 2, 2), None), {}, TypeError, "real numbers, got object"),
        (FIELD, {"spacing": 0}, ValueError, "spacing must be positive along x, y and z, got (0.0, 0.0, 0.0)"),
        (FIELD, {"spacing": (1, -1, 1)}, ValueError, "spacing must be positive"),
        (
            FIELD,
            {"spacing": (1, 1e300, 1)},
            ValueError,
            "spacing (1.0, 1e+300, 1.0) coincide in double precision, or th",
        ),
        (FIELD, {"spacing": 1e-300}, ValueError, "choose another unit of length or another origin"),
        (FIELD, {"origin": (0, 0, -1e300)}, ValueError, "samples at origin (0.0, 0.0, -1e+300) with spacing"),
        (FIELD, {"origin": (0, 1e20, 0)}, ValueError, "samples at origin (0.0, 1e+20, 0.0) with spacing"),
        (FIELD, {"spacing": (1, np.nan, 1)}, ValueError, "spacing must be three finite numbers"),
        (FIELD, {"spacing": (1, 2)}, ValueError, "spacing must be three finite numbers (x, y, z), got (1, 2)"),
        (FIELD, {"origin": (0, 0, np.inf)}, ValueError, "origin must be three finite numbers"),
        (FIELD, {"array": "Q"}, ValueError, "array='Q' names an array of a VTK data set"),
        (FIELD, {"nan": "ignore"}, ValueError, "'ignore'"),
        (np.full((2, 2, 2), np.nan), {"nan": "transparent"}, ValueError, "not one value of the field is finite"),
    ],
)
def test_what_is_refused(data: np.ndarray, options: dict, error: type[Exception], message: str) -> None:
    with pytest.raises(error) as caught:
        to_grid(data, **options)
    assert message in str(caught.value)


def test_a_grid_checks_itself() -> None:
    with pytest.raises(ValueError, match="float32"):
        Grid(FIELD.astype(np.int16))
    with pytest.raises(ValueError, match="holes"):
        Grid(FIELD.astype(np.float32), holes=np.zeros((2, 2, 2), dtype=bool))
    with pytest.raises(ValueError, match="own spacing"):
        to_grid(to_grid(FIELD), spacing=1)


def test_nan_is_counted_and_placed() -> None:
    field = FIELD.copy()
    field[1, 0, 2] = np.nan
    field[1, 2, 3] = np.inf
    with pytest.raises(ValueError, match=r"2 of 24 values are NaN or infinite, the first at \(z, y, x\) = \(1, 0, 2\)"):
        to_grid(field)


@given(arrays.arrays(np.float32, (3, 4, 5), elements=st.floats(-10, 10, width=32)), st.integers(1, 59), st.randoms())
def test_holes_take_the_nearest_value_around_and_the_rest_is_untouched(field: np.ndarray, count: int, random) -> None:
    holes = np.zeros(field.size, dtype=bool)
    holes[random.sample(range(field.size), count)] = True
    holes = holes.reshape(field.shape)
    grid = to_grid(np.where(holes, np.nan, field), nan="transparent")
    np.testing.assert_array_equal(grid.holes, holes)
    np.testing.assert_array_equal(grid.values[~holes], field[~holes])
    kept = np.argwhere(~holes)
    for hole in np.argwhere(holes):
        squared = ((kept - hole) ** 2).sum(axis=1)
        near = kept[squared == squared.min()] if np.abs(kept - hole).max(axis=1).min() == 1 else kept
        assert grid.values[tuple(hole)] in field[tuple(near.T)]


@pytest.mark.parametrize(
    ("values", "dtype"),
    [
        (np.full((2, 2, 2), 0.1), "float64"),
        (np.full((2, 2, 2), 0.5, ">f8"), "float32"),
        (np.full((2, 2, 2), 1e40), "float64"),
        (np.full((2, 2, 2), 1e-300), "float64"),
        (np.full((2, 2, 2), 0.1, np.longdouble), "float64"),
        (np.full((2, 2, 2), 0.1, np.float16), "float32"),
        (np.full((2, 2, 2), 2**24), "float32"),
        (np.full((2, 2, 2), 2**24 + 1), "int64"),
        (np.full((2, 2, 2), 2**64 - 1, ">u8"), "uint64"),
        (np.full((2, 2, 2), -(2**31), "i4"), "int32"),
        (np.full((2, 2, 2), True), "float32"),
    ],
)
def test_no_value_is_rounded(values: np.ndarray, dtype: str) -> None:
    grid = to_grid(values)
    assert grid.values.dtype == dtype
    assert (grid.values == values.astype(values.dtype.newbyteorder("="))).all()


def test_no_holes_are_no_mask() -> None:
    assert to_grid(FIELD, nan="transparent").holes is None


@pytest.mark.parametrize("dtype", [np.float32, np.float64, np.int16, np.uint8])
def test_what_is_masked_is_no_value(dtype: type) -> None:
    masked = np.ma.masked_array(FIELD.astype(dtype), FIELD == 7)
    with pytest.raises(ValueError, match=r"1 of 24 values are NaN.*\(0, 1, 3\)"):
        to_grid(masked)
    grid = to_grid(masked, nan="transparent")
    assert grid.holes is not None
    np.testing.assert_array_equal(grid.holes, FIELD == 7)
    np.testing.assert_array_equal(grid.values[~grid.holes], FIELD[FIELD != 7])
    assert to_grid(np.ma.masked_array(FIELD, False)).holes is None
