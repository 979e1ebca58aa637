"""Axes of climate and ocean data: known by CF's attributes first, by the names that codes give them second."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from render.coordinates import letter_of, points_down, unit_of
from render.datasets import ResamplingWarning, to_grid

xarray = pytest.importorskip("xarray")

# (z, y, x) as codes call their axes, and whether z counts downwards.
CODES = {
    "NEMO": ("deptht", "y", "x", True),
    "NEMO velocity": ("depthu", "nav_lat", "nav_lon", True),
    "POP": ("z_t", "nlat", "nlon", True),
    "POP faces": ("z_w_top", "nlat", "nlon", True),
    "MOM": ("st_ocean", "yt_ocean", "xt_ocean", True),
    "MOM6": ("z_l", "yh", "xh", False),
    "ROMS": ("s_rho", "eta_rho", "xi_rho", False),
    "ROMS velocity": ("s_w", "eta_u", "xi_u", False),
    "WRF": ("bottom_top", "south_north", "west_east", False),
    "WRF staggered": ("bottom_top_stag", "south_north_stag", "west_east_stag", False),
    "CMIP": ("plev", "lat", "lon", True),
    "CMIP levels": ("plev19", "lat", "lon", True),
    "CAM": ("lev", "lat", "lon", False),
    "ERA5": ("isobaricInhPa", "latitude", "longitude", True),
    "ERA5 new": ("pressure_level", "latitude", "longitude", True),
    "COSMO": ("level1", "rlat", "rlon", False),
    "ICON": ("height_2", "lat", "lon", False),
    "HYCOM": ("Depth", "Latitude", "Longitude", True),
    "plain": ("k", "j", "i", False),
    "staggered": ("zw", "yf", "x_u", False),
}


@pytest.mark.parametrize("code", CODES)
def test_names_of_codes_are_known(code: str) -> None:
    *names, down = CODES[code]
    assert "".join(letter_of(name, {}) for name in names) == "zyx"
    assert points_down(names[0], {}, np.arange(3.0)) == down


@pytest.mark.parametrize("name", ["time", "member", "bnds", "t", "Re", "a", "nv", "ensemble"])
def test_other_names_are_no_axes(name: str) -> None:
    assert letter_of(name, {}) == ""


@pytest.mark.parametrize(
    ("name", "attributes", "letter"),
    [
        ("a", {"axis": "Z"}, "z"),
        ("z", {"axis": "X"}, "x"),
        ("x", {"axis": "T"}, ""),
        ("a", {"standard_name": "longitude"}, "x"),
        ("x", {"standard_name": "projection_y_coordinate"}, "y"),
        ("a", {"standard_name": "ocean_s_coordinate_g2"}, "z"),
        ("a", {"standard_name": "atmosphere_hybrid_sigma_pressure_coordinate"}, "z"),
        ("y", {"positive": "up"}, "z"),
        ("a", {"units": "millibar"}, "z"),
        ("a", {"units": "hPa"}, "z"),
        ("a", {"units": "degrees_north"}, "y"),
        ("a", {"units": "degreeE"}, "x"),
        ("a", {"units": "m"}, ""),
    ],
)
def test_attributes_go_before_names(name: str, attributes: dict[str, str], letter: str) -> None:
    assert letter_of(name, attributes) == letter


@pytest.mark.parametrize(
    ("name", "attributes", "values", "down"),
    [
        ("lev", {"positive": "down"}, [1, 2], True),
        ("depth", {"positive": "up"}, [1, 2], False),
        ("a", {"units": "Pa"}, [100.0, 1.0], True),
        ("a", {"standard_name": "air_pressure"}, [100.0, 1.0], True),
        ("a", {"standard_name": "depth"}, [0.0, 5.0], True),
        ("depth", {}, [0.0, -5.0, -10.0], False),
        ("a", {"standard_name": "atmosphere_sigma_coordinate"}, [0.1, 1.0], True),
        ("a", {"standard_name": "ocean_s_coordinate"}, [-1.0, 0.0], False),
        ("lev", {"standard_name": "height"}, [0.0, 9.0], False),
        ("depth", {}, None, True),
        ("plev", {}, None, False),
        ("z", {}, None, False),
    ],
)
def test_the_way_up(name: str, attributes: dict[str, str], values: Any, down: bool) -> None:
    assert points_down(name, attributes, None if values is None else np.array(values)) == down


def test_units_of_one_kind_are_one() -> None:
    assert {unit_of("a", {"units": u}) for u in ("degrees_east", "degree_N", "degrees", "degreesE")} == {"degrees"}
    assert [unit_of("a", {"units": u}) for u in ("metres", "meter", "M", "km", "kilometers", "hPa")] == [
        *("m", "m", "m", "km", "km", "hpa")
    ]
    assert (unit_of("lon", {}), unit_of("x", {}), unit_of("plev", {})) == ("degrees", "", "pressure")
    assert unit_of("x", {"standard_name": "grid_longitude"}) == "degrees"


def field(z: Any, y: Any = None, x: Any = None, **attributes: dict[str, str]) -> Any:
    """The number of the level as it is stored, plus the longitude modulo 360 over 1000."""
    x, y = np.arange(6.0) if x is None else np.asarray(x, float), np.arange(5.0) if y is None else np.asarray(y, float)
    values = np.arange(len(z))[:, None, None] + np.mod(x, 360) / 1000 + 0 * y[:, None]
    coords = {"lev": z, "lat": y, "lon": x}
    return xarray.DataArray(
        values, dims=("lev", "lat", "lon"), coords={n: (n, c, attributes.get(n, {})) for n, c in coords.items()}
    )


@pytest.mark.parametrize("levels", [[0.0, 1.0, 2.0], [2.0, 1.0, 0.0]])
def test_depth_is_a_negative_height(levels: list[float]) -> None:
    grid = to_grid(field(levels, lev={"positive": "down"}))
    assert (grid.origin[2], grid.spacing[2]) == (-2.0, 1.0)
    assert grid.values[-1, 0, 0] == levels.index(0.0)
    assert grid.values[0, 0, 0] == levels.index(2.0)


@pytest.mark.parametrize(
    ("longitudes", "first", "step"),
    [
        ([350, 355, 0, 5], 350.0, 5.0),
        ([0, 60, 120, 180, -120, -60], 0.0, 60.0),
        ([170, 175, -180, -175], 170.0, 5.0),
        ([0, 90, 180, 270, 0], 0.0, 90.0),
        ([0, 90, 180, 270, 360], 0.0, 90.0),
        ([10, 0, 350, 340], -20.0, 10.0),
    ],
)
def test_longitudes_go_on_where_they_fall_back(longitudes: list[float], first: float, step: float) -> None:
    grid = to_grid(field([0.0, 10.0, 20.0], x=longitudes, lon={"units": "degrees_east"}))
    assert (grid.origin[0], grid.spacing[0]) == (first, step)
    places = grid.origin[0] + grid.spacing[0] * np.arange(len(longitudes))
    assert np.allclose(grid.values[0, 0], np.mod(places, 360) / 1000)


def test_other_coordinates_do_not_go_on() -> None:
    with pytest.raises(ValueError, match="'lat' must be finite and increase or decrease strictly"):
        to_grid(field([0.0, 1.0], y=[350, 355, 0, 5]))
    with pytest.raises(ValueError, match="'lon' must be finite and increase or decrease strictly"):
        to_grid(field([0.0, 1.0], x=[0, 90, 90, 180]))


DEGREES = {"lon": {"units": "degrees_east"}, "lat": {"units": "degrees_north"}}


@pytest.mark.parametrize("levels", [np.linspace(0, 5500, 12), np.array([0.0, 0.02, 0.06]), np.array([1e5, 5e4, 1e4])])
def test_metres_beside_degrees_are_drawn_a_quarter_high_and_told(levels: np.ndarray) -> None:
    data = field(levels, np.arange(-80.0, 81, 10), np.arange(0.0, 360, 10), lev={"units": "m"}, **DEGREES)
    with pytest.warns(ResamplingWarning, match=r"'lev' is in m: it is drawn 40 high.*give spacing \(10, 10, Z\)"):
        grid = to_grid(data)
    low, high = grid.bounds
    assert np.allclose(high - low, (350, 160, 40))
    if len(levels) == 12:
        stated = to_grid(data, spacing=(10, 10, 3.0))
        assert np.allclose(stated.spacing, (10, 10, 3))
        assert stated.notes == ()
        with pytest.raises(ValueError, match="contradicts the coordinates along 'lon'"):
            to_grid(data, spacing=(9, 10, 3.0))


def test_axes_of_different_units_stay_where_their_numbers_make_a_box() -> None:
    grid = to_grid(field([0.0, 1.0, 2.0], lev={"units": "km"}, **DEGREES))
    assert (grid.spacing, grid.notes) == ((1.0, 1.0, 1.0), ())


def test_lengths_are_brought_to_one_unit() -> None:
    km = {"units": "km"}
    with pytest.warns(ResamplingWarning, match="drawn 3 high, as in km"):
        grid = to_grid(field([0.0, 1000, 2000, 3000], lev={"units": "metres"}, lon=km, lat=km))
    assert np.allclose(grid.spacing, (1, 1, 1))


def test_a_spacing_without_coordinates_states_the_height_where_else_there_is_no_box() -> None:
    """Curved cells of the ocean: only depth has coordinates."""
    data = field(np.linspace(0.0, 5500.0, 12), lev={"units": "m", "positive": "down"}).drop_vars(["lat", "lon"])
    assert np.allclose(to_grid(data, spacing=(1, 1, 0.1)).bounds, [(0, 0, -1.1), (5, 4, 0)])
    near = field(np.linspace(0.0, 3.0, 12), lev={"units": "m"}).drop_vars(["lat", "lon"])
    assert np.allclose(to_grid(near, spacing=(1, 1, 0.1)).bounds, [(0, 0, 0), (5, 4, 3)])


def test_attributes_may_be_arrays_of_one_word() -> None:
    assert letter_of("a", {"axis": np.array([b"Z"])}) == "z"
    assert points_down("a", {"positive": np.array(["down"])}, np.arange(2.0))


def test_of_a_data_set_what_describes_the_field_is_no_field() -> None:
    held = field(np.arange(3.0))
    described = held.assign_attrs(cell_measures="volume: volcello", ancillary_variables="quality")
    data = xarray.Dataset(
        {"thetao": described, "volcello": 0 * held, "quality": held > 0, "lev_bnds": ("lev", [0, 1, 2])}
    )
    assert np.array_equal(to_grid(data).values, held.values)
    assert to_grid(data, array="volcello").range == (0.0, 0.0)


def test_horizontal_axes_in_two_units_of_length_are_refused() -> None:
    with pytest.raises(ValueError, match="'lon' is in km and 'lat' in m: store their coordinates in one unit"):
        to_grid(field([0.0, 1.0, 2.0], lon={"units": "km"}, lat={"units": "m"}))
