"""The netCDF output of MPAS: fields on a Voronoi mesh, sampled on a regular grid of longitude, latitude and layer.

Layers are kept as they are: the grid's z axis counts them from the bottom up, evenly spaced.  The ocean's first layer is the
highest, the atmosphere's the lowest.  Where there is no cell, and below the deepest layer of one, the field is NaN: land and the
sea floor.  Planar meshes are sampled along x and y.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from insitu.fields.field import Field
from insitu.readers.arrays import NETCDF4, Arrays, StoredArray, check_room, open_arrays, open_classic
from insitu.readers.attributes import as_text
from insitu.readers.netcdf import is_classic, read_header
from insitu.readers.reader import Reader, Sampling, StoredState, chosen_array
from insitu.readers.voronoi import PointLocations, VoronoiMesh, locate, on_sphere, spacing_of

CELLS, LAYERS, TIME = "nCells", "nVertLevels", "Time"
MOST_SAMPLES = 512  # along an axis, where no resolution is stated
HEIGHT = 0.25  # of the grid's shorter horizontal side: how high all layers together are drawn
ABSENT = 1e30  # what MPAS fills in where there is no water is larger
SINCE = "0001-01-01_00:00:00"
MOMENT = re.compile(r"(\d{4,})-(\d\d)-(\d\d)(?:_(\d\d):(\d\d):(\d\d))?")


@dataclass(frozen=True, eq=False)
class HorizontalGrid:
    """The horizontal points of a grid: `points` [ny * nx, D] as the mesh has them, `spacing` and `origin` (x, y) in world units."""

    shape: tuple[int, int]  # ny, nx
    points: NDArray[np.float64]
    spacing: tuple[float, float]
    origin: tuple[float, float]


def recognizes(path: Path) -> bool:
    """True if a netCDF file has fields on the layers of a mesh as MPAS calls them."""
    try:
        if not path.is_file():
            return False
        if is_classic(path):
            return {CELLS, LAYERS} <= set(read_header(path).dimensions)
        if not h5py.is_hdf5(path):
            return False
        with h5py.File(path, "r") as file:
            return CELLS in file and LAYERS in file
    except (OSError, ValueError, RuntimeError, KeyError):
        return False


def records(path: Path, sampling: Sampling) -> list[StoredState]:
    """The times in a file: `time`, days since the simulation's start where the file says it, else since the year 1."""
    with _opened(path) as arrays:
        times, start = arrays.arrays.get("xtime"), arrays.arrays.get("simulationStartTime")
        if times is None or times.dims[0] != TIME:
            count = max((a.shape[0] for a in arrays.arrays.values() if _is_field(a) and a.dims[0] == TIME), default=1)
            return [StoredState((i,), {}) for i in range(count)]
        begin = SINCE if start is None else _words(start)[0]
        calendar = as_text(arrays.attrs[""].get("config_calendar_type", "noleap")).strip().removeprefix("gregorian_")
        return [StoredState((i,), {"time": _days(word, begin, calendar)}) for i, word in enumerate(_words(times))]


def read(path: Path, array: str | None, index: tuple[int, ...], sampling: Sampling) -> Field:
    """A field on all layers, at one time."""
    with _opened(path) as arrays:
        name = chosen_array(
            array, [a.name for a in arrays.arrays.values() if _is_field(a)], "on cells and layers the file"
        )
        field = arrays.arrays[name]
        states = () if field.dims[0] != TIME else index or (0,)
        if states and states[0] >= field.shape[0]:
            raise ValueError(f"it has {field.shape[0]} times, not {states[0] + 1}")
        cells, layers = field.shape[-2:]
        with _mesh_file(arrays, sampling.mesh) as mesh_arrays:
            mesh, scale = _mesh(mesh_arrays, cells)
            active = _active(mesh_arrays, cells, layers)
            is_upwards = _is_upwards(arrays) or _is_upwards(mesh_arrays)
        plane = _plane(mesh, scale, sampling, layers)
        size = plane.shape[0] * plane.shape[1] * layers * field.dtype.itemsize
        check_room(
            size, f"{name!r} on {plane.shape[1]} x {plane.shape[0]} x {layers} samples (--resolution asks for fewer)"
        )
        values = np.array(field.read(states))  # [cells, layers]
    if values.dtype.kind != "f":
        values = values.astype(np.float32 if values.dtype.itemsize < 4 else np.float64)
    values[~active | ~(np.abs(values) < ABSENT)] = np.nan
    located = locate(mesh, plane.points, sampling.interpolation == "linear")
    if (located.cells < 0).all():
        raise ValueError("none of the grid's points lies in a cell of the mesh")
    upwards = values if is_upwards else values[:, ::-1]  # [cells, layers from the bottom up]
    return _gridded(upwards, located, plane, sampling, name, as_text(field.attrs.get("units", "")).strip())


def _gridded(
    values: NDArray[Any], located: PointLocations, plane: HorizontalGrid, sampling: Sampling, name: str, unit: str
) -> Field:
    layers = values.shape[1]
    gridded = np.empty((layers, *plane.shape), dtype=values.dtype)  # [layer, ny, nx], from the bottom up
    for layer in range(layers):
        column = np.ascontiguousarray(values[:, layer])
        gridded[layer] = located.sampled(column, sampling.interpolation == "linear").reshape(plane.shape)
    across = min(n * step for n, step in zip(plane.shape[::-1], plane.spacing, strict=True))
    return Field(gridded, (*plane.spacing, HEIGHT * across / layers), (*plane.origin, 0.0), name, unit)


# ---- the file --------------------------------------------------------------------------------------------------------


@contextmanager
def _opened(path: Path) -> Iterator[Arrays]:
    if not is_classic(path) and not h5py.is_hdf5(path):
        raise ValueError("it is neither a classic netCDF file nor one of HDF5")
    with open_classic(path) if is_classic(path) else open_arrays(path) as arrays:
        yield arrays


@contextmanager
def _mesh_file(arrays: Arrays, path: Path | None) -> Iterator[Arrays]:
    """The arrays that say where the cells lie: of the file itself, or of the one of the mesh."""
    if path is None:
        yield arrays
        return
    if not path.is_file():
        raise ValueError(f"there is no file of the mesh, {path}")
    try:
        with _opened(path) as mesh_arrays:
            yield mesh_arrays
    except ValueError as error:
        raise ValueError(f"mesh {path}: {error}") from None


def _is_upwards(arrays: Arrays) -> bool:
    """True if a file is the atmosphere's, which its core's name says, else its array of heights."""
    core = as_text(arrays.attrs[""].get("core_name", "")).strip().lower()
    return "atmosphere" in core or (not core and "zgrid" in arrays.arrays)


def _is_field(array: StoredArray) -> bool:
    return array.is_real and array.dims in ((TIME, CELLS, LAYERS), (CELLS, LAYERS))


def _words(array: StoredArray) -> list[str]:
    """The words of an array of characters, one a row, or of words."""
    values = np.atleast_1d(array.read())
    if values.dtype == "S1":
        values = np.array([b"".join(row.tolist()) for row in np.atleast_2d(values)])
    if values.ndim != 1 or not values.size or values.dtype.kind not in "SUO":
        raise ValueError(f"{array!r} must hold a word for each time")
    return [as_text(word).strip("\0 ") for word in values]


def _days(word: str, begin: str, calendar: str) -> float:
    """Days from one moment to another, as MPAS writes them."""
    try:
        import cftime
    except ModuleNotFoundError:
        raise ModuleNotFoundError(NETCDF4) from None
    moments = []
    for text in (word, begin):
        match = MOMENT.fullmatch(text)
        if match is None:
            raise ValueError(f"xtime must be as 0001-01-01_00:00:00, got {text[:40]!r}")
        year, month, day, *clock = (int(part or 0) for part in match.groups())
        try:
            moments.append(cftime.datetime(year, month, day, *clock, calendar=calendar, has_year_zero=True))
        except ValueError as error:
            raise ValueError(f"xtime {text!r} in the calendar {calendar[:40]!r}: {error}") from None
    return float((moments[0] - moments[1]).total_seconds() / 86400)


# ---- the mesh --------------------------------------------------------------------------------------------------------


def _mesh(arrays: Arrays, cells: int) -> tuple[VoronoiMesh, float]:
    """The mesh, and what one of its units is in world units (degrees of a radian; metres)."""
    is_sphere = as_text(arrays.attrs[""].get("on_a_sphere", "YES")).strip().upper() == "YES"
    names = ("lonCell", "latCell", "lonVertex", "latVertex") if is_sphere else ("xCell", "yCell", "xVertex", "yVertex")
    lacking = [n for n in (*names, "verticesOnCell", "nEdgesOnCell", "cellsOnVertex") if n not in arrays.arrays]
    if lacking:
        raise ValueError(
            f"the mesh lacks {', '.join(lacking)}: name by --mesh a file that has it, such as an initial condition"
        )
    a, b, c, d = (arrays.arrays[name].read().astype(np.float64) for name in names)
    edges = arrays.arrays["nEdgesOnCell"].read()
    with np.errstate(invalid="ignore"):  # numbers that were never written, of no cell
        around, meeting = (arrays.arrays[n].read().astype(np.int64) - 1 for n in ("verticesOnCell", "cellsOnVertex"))
    if a.shape != (cells,) or edges.shape != (cells,) or around.shape[:1] != (cells,):
        raise ValueError(f"the mesh has {a.shape} cells, the field {cells}")
    if around.ndim != 2 or meeting.shape != (len(c), 3) or a.shape != b.shape or c.shape != d.shape:
        raise ValueError("its arrays of cells and vertices do not fit each other")
    if not all(np.isfinite(numbers).all() for numbers in (a, b, c, d)):
        raise ValueError("places of its cells and vertices must be finite")
    places = np.arange(around.shape[1]) < edges[:, None]  # [C, E]; what follows the last vertex does not count
    if edges.min() < 3 or edges.max() > around.shape[1] or around[places].min() < 0 or around[places].max() >= len(c):
        raise ValueError("its verticesOnCell name vertices that are not there, or fewer than 3 around a cell")
    if meeting.min() < -1 or meeting.max() >= cells:
        raise ValueError("its cellsOnVertex name cells that are not there")
    around = np.where(places, around, -1)
    if is_sphere:
        return VoronoiMesh(on_sphere(a, b), on_sphere(c, d), around, meeting), 180 / np.pi
    period = [float(arrays.attrs[""].get(f"{letter}_period", 0.0)) for letter in "xy"]
    return VoronoiMesh(np.stack([a, b], 1), np.stack([c, d], 1), around, meeting, (period[0], period[1])), 1.0


def _active(arrays: Arrays, cells: int, layers: int) -> NDArray[np.bool_]:
    """Which layers [cells, layers] hold water; all where the mesh does not say."""
    number = np.arange(layers)
    active = np.ones((cells, layers), dtype=bool)
    for name, holds in (("maxLevelCell", np.less), ("minLevelCell", np.greater_equal)):
        limits = arrays.arrays.get(name)
        if limits is not None and limits.shape == (cells,) and limits.dtype.kind in "iu":
            active &= holds(number, limits.read().astype(np.int64)[:, None] - (name == "minLevelCell"))
    return active


def _plane(mesh: VoronoiMesh, scale: float, sampling: Sampling, layers: int) -> HorizontalGrid:
    """The horizontal points: over the whole mesh, as far apart as its cells, or as many as are asked for."""
    low, high = _extent(mesh)
    if sampling.resolution is None:
        step = spacing_of(mesh)
        counts = [int(np.clip(np.round(width / step), 2, MOST_SAMPLES)) for width in high - low]
    elif sampling.resolution[2] != layers:
        raise ValueError(f"its {layers} layers are not resampled: let the last number of --resolution be {layers}")
    else:
        counts = list(sampling.resolution[:2])
    steps = (high - low) / counts
    x, y = (a + step * (np.arange(n) + 0.5) for a, step, n in zip(low, steps, counts, strict=True))
    across, up = np.meshgrid(x, y)  # [ny, nx]
    points = on_sphere(across, up) if mesh.is_sphere else np.stack([across, up], axis=-1)
    spacing, origin = scale * steps, scale * (low + steps / 2)
    return HorizontalGrid(
        (len(y), len(x)),
        points.reshape(-1, points.shape[-1]),
        (float(spacing[0]), float(spacing[1])),
        (float(origin[0]), float(origin[1])),
    )


def _extent(mesh: VoronoiMesh) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """(low, high) of longitude and latitude in radians, or of x and y, of all cells."""
    if not mesh.is_sphere:
        used = mesh.vertices[np.unique(mesh.vertices_on_cell[mesh.vertices_on_cell >= 0])]
        low, high = used.min(axis=0), used.max(axis=0)
        return low, np.array([a + p if p else b for a, b, p in zip(low, high, mesh.period, strict=True)])
    used = mesh.vertices[np.unique(mesh.vertices_on_cell[mesh.vertices_on_cell >= 0])]
    latitudes = np.arcsin(np.clip(used[:, 2], -1, 1))
    longitudes = np.sort(np.mod(np.arctan2(used[:, 1], used[:, 0]), 2 * np.pi))
    gaps = np.diff(longitudes, append=longitudes[0] + 2 * np.pi)
    widest = int(gaps.argmax())
    if gaps[widest] < np.pi / 18:  # less than ten degrees without a cell: all around the globe
        west, east = 0.0, 2 * np.pi
    else:
        west = float(longitudes[(widest + 1) % len(longitudes)])
        east = west + 2 * np.pi - float(gaps[widest])
    return np.array([west, latitudes.min()]), np.array([east, latitudes.max()])


READER = Reader("mpas", "MPAS, netCDF", recognizes, records, read, grows=True, samples=True, units={"time": "d"})
