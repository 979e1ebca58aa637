"""MPAS-Ocean's output: the value of the cell that contains a point, land and sea floor left out, and times as the file has them."""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from insitu.readers.files import read_data, read_field
from insitu.readers.mpas import recognizes
from insitu.readers.reader import Sampling
from insitu.readers.states import reader_for, table_of_files, with_states
from insitu.readers.voronoi import on_sphere
from tests.support.damage import damaged, read_or_refused
from tests.support.mpas_files import LAYERS, Made, globe, hexagons, write_mesh, write_output

netCDF4 = pytest.importorskip("netCDF4", reason="netCDF4 is not installed: pip install 'gs-surrogate[mpas]'")
FORMS = ["NETCDF3_64BIT_OFFSET", "NETCDF3_64BIT_DATA", "NETCDF4"]
TIMES = ["0001-01-01_00:00:00", "0001-03-01_00:00:00", "0002-01-01_12:00:00"]


@cache
def sphere() -> Made:
    return globe()


def field(made: Made, count: int = 3) -> np.ndarray:
    """Random numbers [time, cell, layer], what MPAS fills in below the sea floor."""
    values = np.random.default_rng(1).normal(size=(count, len(made.ocean), LAYERS))
    dry = np.arange(LAYERS) >= made.arrays["maxLevelCell"][1][:, None]
    return np.where(dry, -1e34, values)


def output(folder: Path, made: Made, form: str = FORMS[0], **how: Any) -> Path:
    path = folder / "output.nc"
    write_output(path, made, {"temperature": field(made)}, TIMES, form=form, **how)
    return path


def expected(made: Made, points: np.ndarray, period: Any = None) -> tuple[np.ndarray, np.ndarray]:
    """The first time's values [layer, point] by the definition of a Voronoi cell, of the nearest of all generators, and which
    points [point] do not lie on an edge.
    """
    away = points[:, None] - made.generators  # [N, G, D]
    if period is not None:
        away -= period * np.round(away / period)
    distances = np.linalg.norm(away, axis=2)
    nearest, two = distances.argmin(axis=1), np.sort(distances, axis=1)[:, :2]
    number = np.full(len(made.generators), -1)
    number[made.ocean] = np.arange(len(made.ocean))
    values = np.where(field(made)[0] < -1e33, np.nan, field(made)[0])
    return np.where(number[nearest] < 0, np.nan, values[number[nearest]].T), two[:, 1] > two[:, 0] * (1 + 1e-9)


def places(found: Any) -> tuple[np.ndarray, np.ndarray]:
    """The horizontal coordinates of a field's samples, each [ny * nx]."""
    _, ny, nx = found.values.shape
    across, up = (found.origin[a] + found.spacing[a] * np.arange(n) for a, n in ((0, nx), (1, ny)))
    x, y = np.meshgrid(across, up)
    return x.ravel(), y.ravel()


@pytest.mark.parametrize("form", FORMS)
def test_a_sample_has_the_value_of_the_cell_that_contains_it(tmp_path: Path, form: str) -> None:
    path = output(tmp_path, sphere(), form)
    assert recognizes(path)
    found = read_data(path, array="temperature", index=(0,), sampling=Sampling((72, 36, LAYERS)))
    longitudes, latitudes = places(found)
    assert found.values.shape == (LAYERS, 36, 72)
    truth, is_clear = expected(sphere(), on_sphere(np.radians(longitudes), np.radians(latitudes)))
    assert is_clear.all()
    assert np.array_equal(found.values[::-1].reshape(LAYERS, -1), truth, equal_nan=True)  # layers from the bottom up
    assert 0.02 < np.isnan(found.values[-1]).mean() < 0.3  # the land
    assert (found.name, found.unit) == ("temperature", "C")
    assert (longitudes.min(), longitudes.max()) == pytest.approx((2.5, 357.5))


@pytest.mark.parametrize(
    ("core", "lowest"), [("ocean", LAYERS - 1), ("atmosphere", 0), ("init_atmosphere", 0), ("landice", LAYERS - 1)]
)
def test_the_first_layer_is_the_seas_highest_and_the_airs_lowest(tmp_path: Path, core: str, lowest: int) -> None:
    made = hexagons()
    made.arrays["maxLevelCell"][1][:] = LAYERS
    values = np.broadcast_to(np.arange(float(LAYERS)), (1, len(made.ocean), LAYERS))
    write_output(tmp_path / "a.nc", made, {"theta": values}, TIMES[:1], attributes={"core_name": core})
    grid = read_data(tmp_path / "a.nc").values
    assert np.nanmin(grid[0]) == np.nanmax(grid[0]) == lowest
    assert np.nanmax(grid[-1]) == LAYERS - 1 - lowest


def test_a_plane_that_repeats_is_sampled_over_one_period(tmp_path: Path) -> None:
    made = hexagons()
    found = read_data(output(tmp_path, made), index=(0,), sampling=Sampling((46, 37, LAYERS)))
    points = np.stack(places(found), axis=1)
    period = np.array([made.attributes["x_period"], made.attributes["y_period"]])
    truth, is_clear = expected(made, points, period)
    assert is_clear.mean() > 0.98
    assert np.array_equal(found.values[::-1].reshape(LAYERS, -1)[:, is_clear], truth[:, is_clear], equal_nan=True)
    assert np.array(found.spacing[:2]) == pytest.approx(period / (46, 37))


def test_between_centers_it_is_linear(tmp_path: Path) -> None:
    """Against the triangles of the convex hull of the centres, which are the dual mesh."""
    from scipy.spatial import ConvexHull

    made = globe(is_land=lambda points: np.zeros(len(points), dtype=bool))
    made.arrays["maxLevelCell"][1][:] = LAYERS
    found = read_data(output(tmp_path, made), index=(0,), sampling=Sampling((40, 20, LAYERS), "linear"))
    longitudes, latitudes = places(found)
    points = on_sphere(np.radians(longitudes), np.radians(latitudes))
    triangles = ConvexHull(made.generators).simplices  # [T, 3]
    shares = np.linalg.solve(made.generators[triangles].transpose(0, 2, 1)[None], points[:, None, :, None])[..., 0]
    weights = shares / shares.sum(axis=2, keepdims=True)  # [N, T, 3]
    weights[shares.sum(axis=2) < 0] = -1  # on the other side of the globe
    best = weights.min(axis=2).argmax(axis=1)
    rows = np.arange(len(points))
    truth = np.einsum("nk,nkl->ln", weights[rows, best], field(made)[0][triangles[best]])
    assert np.allclose(found.values[::-1].reshape(LAYERS, -1), truth, atol=1e-12)


def test_linear_is_closer_to_a_smooth_field_and_keeps_the_coast(tmp_path: Path) -> None:
    made = globe(2000)
    smooth = np.repeat((made.generators[made.ocean] @ [1.0, 2.0, 3.0])[None, :, None], LAYERS, axis=2)
    made.arrays["maxLevelCell"][1][:] = LAYERS
    write_output(tmp_path / "a.nc", made, {"t": smooth}, TIMES[:1])
    near, linear = (
        read_data(tmp_path / "a.nc", sampling=Sampling((60, 30, LAYERS), method)) for method in ("nearest", "linear")
    )
    assert np.array_equal(np.isnan(near.values), np.isnan(linear.values))
    longitudes, latitudes = places(near)
    truth = (on_sphere(np.radians(longitudes), np.radians(latitudes)) @ [1.0, 2.0, 3.0]).reshape(30, 60)
    errors = [float(np.sqrt(np.nanmean((found.values - truth) ** 2))) for found in (near, linear)]
    assert errors[1] < errors[0] / 5


def test_land_is_left_out_of_the_picture_if_asked(tmp_path: Path) -> None:
    path = output(tmp_path, sphere())
    with pytest.raises(ValueError, match=r'values are NaN or infinite, .* pass nan="transparent"'):
        read_field(path, array="temperature")
    grid = read_field(path, nan="transparent", array="temperature")
    assert grid.holes is not None
    assert grid.notes == ()
    low, high = grid.bounds
    across = high - low
    assert across[2] == pytest.approx(
        0.25 * across[1], rel=0.3
    )  # layers are drawn evenly, a quarter as high as the globe


def test_times_are_the_files(tmp_path: Path) -> None:
    path = output(tmp_path, sphere())
    reader = reader_for([path])
    assert reader is not None
    table = with_states(table_of_files([path]), reader, Sampling())
    assert [(row.index, dict(row.parameters)) for row in table.rows] == [
        ((0,), {"time": 0.0}),
        ((1,), {"time": 59.0}),  # no leap days
        ((2,), {"time": 365.5}),
    ]
    assert table.units == {"time": "d"}
    found = [read_data(path, index=(t,), sampling=Sampling((9, 9, LAYERS))).values for t in range(3)]
    assert not np.array_equal(found[0], found[1], equal_nan=True)
    with pytest.raises(ValueError, match="it has 3 times, not 4"):
        read_data(path, index=(3,))
    leap = output(tmp_path, sphere(), start="0004-02-28_00:00:00", attributes={"config_calendar_type": "gregorian"})
    with netCDF4.Dataset(leap, "a") as file:
        file.variables["xtime"][0] = np.array([c.encode() for c in "0004-03-01_00:00:00".ljust(64)])
    assert with_states(table_of_files([leap]), reader, Sampling()).rows[0].parameters == {"time": 2.0}


def test_the_mesh_may_lie_in_another_file(tmp_path: Path) -> None:
    made = sphere()
    write_output(tmp_path / "history.nc", None, {"temperature": field(made)}, TIMES)
    write_mesh(tmp_path / "init.nc", made)
    how = {"index": (0,)}
    alone = read_data(output(tmp_path, made), sampling=Sampling((20, 10, LAYERS)), **how)
    found = read_data(tmp_path / "history.nc", sampling=Sampling((20, 10, LAYERS), mesh=tmp_path / "init.nc"), **how)
    assert np.array_equal(found.values, alone.values, equal_nan=True)
    with pytest.raises(ValueError, match=r"the mesh lacks lonCell, .* name by --mesh a file that has it"):
        read_data(tmp_path / "history.nc", **how)
    with pytest.raises(ValueError, match="there is no file of the mesh"):
        read_data(tmp_path / "history.nc", sampling=Sampling(mesh=tmp_path / "none.nc"), **how)
    write_mesh(tmp_path / "other.nc", hexagons())
    with pytest.raises(ValueError, match=r"the mesh has .* cells, the field"):
        read_data(tmp_path / "history.nc", sampling=Sampling(mesh=tmp_path / "other.nc"), **how)


def changed(name: str, value: float) -> Callable[[Path], None]:
    def change(path: Path) -> None:
        with netCDF4.Dataset(path, "a") as file:
            file.variables[name][...] = value

    return change


def xtime(path: Path) -> None:
    with netCDF4.Dataset(path, "a") as file:
        file.variables["xtime"][0] = np.array([b"x"] * 64)


@pytest.mark.parametrize(
    ("harm", "message"),
    [
        (changed("verticesOnCell", 10**6), "name vertices that are not there"),
        (changed("verticesOnCell", 0), "name vertices that are not there"),
        (changed("cellsOnVertex", 10**6), "name cells that are not there"),
        (changed("nEdgesOnCell", 2), "fewer than 3 around a cell"),
        (changed("nEdgesOnCell", 99), "name vertices that are not there"),
        (changed("lonCell", np.nan), "must be finite"),
        (changed("verticesOnCell", 1), "none of the grid's points lies in a cell"),
    ],
)
def test_a_mesh_that_lies_is_one_error(tmp_path: Path, harm: Callable[[Path], None], message: str) -> None:
    path = output(tmp_path, sphere())
    harm(path)
    with pytest.raises(ValueError, match=message) as caught:
        read_data(path, array="temperature")
    assert str(path) in str(caught.value)


def test_what_cannot_be_had_is_told(tmp_path: Path) -> None:
    path = output(tmp_path, sphere())
    with pytest.raises(ValueError, match="its 5 layers are not resampled: let the last number of --resolution be 5"):
        read_data(path, sampling=Sampling((10, 10, 10)))
    with pytest.raises(ValueError, match="no array 'lonCell': on cells and layers the file has temperature"):
        read_data(path, array="lonCell")
    xtime(path)
    reader = reader_for([path])
    assert reader is not None
    with pytest.raises(ValueError, match="xtime must be as 0001-01-01_00:00:00, got 'xxx"):
        with_states(table_of_files([path]), reader, Sampling())


@cache
def small() -> Made:
    return globe(40, relax=5)


@pytest.mark.slow
@settings(max_examples=80)
@given(st.sampled_from(FORMS[:2]), st.data())
def test_a_damaged_file_is_read_or_refused(form: str, data: st.DataObject) -> None:
    with tempfile.TemporaryDirectory() as name:
        path = output(Path(name), small(), form)
        path.write_bytes(data.draw(damaged(path.read_bytes(), 3000)))
        sampling = Sampling((6, 5, LAYERS))
        found = read_or_refused(
            lambda: read_data(path, array="temperature", index=(0,), reader="mpas", sampling=sampling), path
        )
        assert found is None or found.values.shape == (LAYERS, 5, 6)
