"""Labelled arrays: whatever the order of their axes, every value is drawn where its coordinates say."""

from __future__ import annotations

import itertools
from typing import Any

import numpy as np
import pytest

from render.datasets import ResamplingWarning, to_grid
from render.xarray_fields import placed

xarray = pytest.importorskip("xarray")

X, Y, Z = np.linspace(1.0, 3.0, 5), np.linspace(-2.0, 2.0, 9), np.linspace(0.0, 0.7, 8)


def function(x: Any, y: Any, z: Any) -> Any:
    """Linear along each axis, so that resampling is exact, and different in each."""
    return x + 10.0 * y + 100.0 * z


def array(dims: str = "zyx", **axes: np.ndarray) -> Any:
    """The function on an xarray whose axes stand in the order of `dims`."""
    axes = {"x": X, "y": Y, "z": Z} | axes
    x, y, z = (xarray.DataArray(axes[a], dims=a) for a in "xyz")
    made = function(x, y, z).transpose(*dims)
    return made.assign_coords({a: axes[a] for a in dims}).rename("f")


def is_function(grid: Any) -> bool:
    """True if every sample is the function at its place in the world."""
    places = [o + s * np.arange(n) for o, s, n in zip(grid.origin, grid.spacing, grid.shape[::-1], strict=True)]
    z, y, x = np.meshgrid(*places[::-1], indexing="ij")
    return np.allclose(grid.values, function(x, y, z), atol=1e-3)


@pytest.mark.parametrize("dims", ["".join(p) for p in itertools.permutations("xyz")])
def test_axes_are_taken_by_name_in_any_order(dims: str) -> None:
    grid = to_grid(array(dims))
    assert grid.shape == (8, 9, 5)
    assert np.allclose(grid.spacing, (0.5, 0.5, 0.1))
    assert np.allclose(grid.origin, (1.0, -2.0, 0.0))
    assert is_function(grid)


@pytest.mark.parametrize(("axis", "values"), [("x", X[::-1]), ("y", Y[::-1]), ("z", Z[::-1])])
def test_descending_coordinates_are_flipped(axis: str, values: np.ndarray) -> None:
    assert is_function(to_grid(array("xyz", **{axis: values})))


def test_uneven_coordinates_are_resampled_and_told() -> None:
    with pytest.warns(ResamplingWarning, match="array 'f' was resampled"):
        grid = to_grid(array("xzy", z=np.array([0.0, 0.1, 0.25, 0.3, 0.5, 0.55, 0.6, 0.9])))
    assert is_function(grid)
    assert np.allclose(grid.bounds[1], (3.0, 2.0, 0.9))


def test_coordinates_in_single_precision_are_even() -> None:
    fine = np.linspace(100.0, 101.0, 300).astype(np.float32)
    assert to_grid(array(x=fine)).notes == ()


@pytest.mark.parametrize(
    "names", [{"x": "lon", "y": "lat", "z": "level"}, {"x": "Longitude", "y": "latitude", "z": "altitude"}]
)
def test_the_axes_of_the_earth_are_known(names: dict[str, str]) -> None:
    assert is_function(to_grid(array("xyz").rename(names)))


def test_a_coordinate_may_say_which_axis_it_is() -> None:
    renamed = array("xyz").rename({"x": "a", "y": "b", "z": "c"})
    for name, letter in zip("abc", "XYZ", strict=True):
        renamed[name].attrs["axis"] = letter
    assert is_function(to_grid(renamed))


@pytest.mark.parametrize(
    ("data", "arguments", "message"),
    [
        (array().rename(x="a"), {}, r"z, y, a do not say which"),
        (array().rename(x="lat", y="latitude"), {}, "do not say which"),
        (array(), {"dims": ("x", "x", "z")}, "an order of"),
        (array(), {"spacing": (0.5, 0.5, 0.2)}, "contradicts the coordinates along 'z', which are 0.1 apart"),
        (array(), {"origin": (0.0, -2.0, 0.0)}, "contradicts the coordinates along 'x', which begin at 1"),
        (array().expand_dims(run=[1, 2]), {}, r"\.isel\(run=0\)"),
        (array()[0], {}, "3 axes"),
        (array(x=np.array([1.0, 2.0, 2.0, 3.0, 4.0])), {}, "increase or decrease strictly"),
        (array(x=np.array([1.0, np.nan, 2.0, 3.0, 4.0])), {}, "finite"),
        (array().assign_coords(x=list("abcde")), {}, "real numbers"),
        (array().drop_vars("x"), {}, r"none along x: give spacing"),
        (xarray.Dataset({"f": array(), "g": array()}), {}, r"name the array.*f, g"),
        (xarray.Dataset({"f": array()}), {"array": "h"}, r"no array 'h'.*f"),
        (array().astype(complex), {}, "real numbers"),
    ],
)
def test_what_cannot_be_placed_is_named(data: Any, arguments: dict[str, Any], message: str) -> None:
    with pytest.raises((ValueError, TypeError), match=message):
        to_grid(data, **arguments)


def test_given_dims_and_agreeing_places_are_taken() -> None:
    odd = array("yxz").rename({"x": "a", "y": "b", "z": "c"})
    assert is_function(to_grid(odd, dims=("y", "x", "z"), spacing=(0.5, 0.5, 0.1), origin=(1.0, -2.0, 0.0)))
    bare = array("xyz").drop_vars(["x", "y", "z"])
    assert is_function(to_grid(bare, spacing=(0.5, 0.5, 0.1), origin=(1.0, -2.0, 0.0)))
    part = array("xyz").drop_vars("y")
    assert is_function(to_grid(part, spacing=(0.5, 0.5, 0.1), origin=(1.0, -2.0, 0.0)))
    assert is_function(to_grid(array().expand_dims("time")))
    plain = array("xyz").values
    assert is_function(to_grid(plain, dims=("x", "y", "z"), spacing=(0.5, 0.5, 0.1), origin=(1.0, -2.0, 0.0)))


def test_names_and_units_are_kept() -> None:
    named = array()
    named.attrs["units"] = "K"
    found = placed(named)
    assert (found.name, found.unit) == ("f", "K")


def test_of_a_data_set_only_what_is_chosen_is_loaded_and_once() -> None:
    dask = pytest.importorskip("dask.array")
    loaded: list[str] = []

    def lazily(name: str) -> Any:
        def load(block: np.ndarray) -> np.ndarray:
            loaded.append(name)
            return block

        return array().copy(data=dask.from_array(array().values).map_blocks(load, dtype=float, meta=np.empty(0)))

    data = xarray.Dataset({"f": lazily("f"), "g": lazily("g")})
    assert is_function(to_grid(data, array="g"))
    assert loaded == ["g"]
