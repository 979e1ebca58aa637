"""Meshes and netCDF files as MPAS-Ocean has them ("MPAS Mesh Specification"): Voronoi cells, those of land left out."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

LAYERS = 5
WORD = 64  # characters of MPAS's strings


@dataclass(frozen=True, eq=False)
class Made:
    """A mesh as the file has it, and how its cells are chosen from all `generators` [G, D]: `ocean` [C] are their indices."""

    arrays: Mapping[str, tuple[tuple[str, ...], NDArray[Any]]]
    attributes: Mapping[str, Any]
    generators: NDArray[np.float64]
    ocean: NDArray[np.int64]


def angles(points: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Longitudes from 0 to 2 pi, and latitudes, of points [..., 3] of the unit sphere."""
    return np.mod(np.arctan2(points[..., 1], points[..., 0]), 2 * np.pi), np.arcsin(np.clip(points[..., 2], -1, 1))


def globe(count: int = 400, *, is_land: Any = lambda points: points[:, 0] > 0.8, relax: int = 20) -> Made:
    """A quasi-uniform mesh of the sphere: Lloyd's relaxation of random generators, the land's cells removed."""
    from scipy.spatial import SphericalVoronoi

    points = np.random.default_rng(0).normal(size=(count, 3))
    for _ in range(relax):
        points /= np.linalg.norm(points, axis=1, keepdims=True)
        cells = SphericalVoronoi(points)
        points = np.array([cells.vertices[region].mean(axis=0) for region in cells.regions])
    points /= np.linalg.norm(points, axis=1, keepdims=True)
    cells = SphericalVoronoi(points)
    cells.sort_vertices_of_regions()
    return _made(points, cells.vertices, cells.regions, ~np.asarray(is_land(points)), on_sphere=True)


def hexagons(nx: int = 8, ny: int = 6) -> Made:
    """A doubly periodic plane of regular hexagons, one of which is land."""
    side = 1000.0
    width, height = np.sqrt(3) * side, 1.5 * side
    i, j = np.meshgrid(np.arange(nx), np.arange(ny))
    centers = np.stack([(i + 0.5 * (j % 2)) * width, j * height], axis=-1).reshape(-1, 2)
    turns = np.pi / 6 + np.arange(6) * np.pi / 3
    corners = centers[:, None] + side * np.stack([np.cos(turns), np.sin(turns)], axis=-1)  # [C, 6, 2]
    period = np.array([nx * width, ny * height])
    keys = np.round(np.mod(corners / period + 1e-9, 1.0) * 1e6).astype(int)
    _, first, numbers = np.unique(keys.reshape(-1, 2), axis=0, return_index=True, return_inverse=True)
    vertices = np.mod(corners.reshape(-1, 2)[first], period)
    regions = [list(row) for row in numbers.reshape(-1, 6)]
    made = _made(centers, vertices, regions, np.arange(len(centers)) != 9, on_sphere=False)
    more = {"is_periodic": "YES", "x_period": period[0], "y_period": period[1]}
    return Made(made.arrays, {**made.attributes, **more}, made.generators, made.ocean)


def _made(
    points: NDArray[np.float64],
    vertices: NDArray[np.float64],
    regions: Sequence[Sequence[int]],
    is_ocean: NDArray[np.bool_],
    *,
    on_sphere: bool,
) -> Made:
    ocean = np.flatnonzero(is_ocean)
    number = np.full(len(points), 0)
    number[ocean] = 1 + np.arange(len(ocean))
    meeting: list[list[int]] = [[] for _ in vertices]
    for cell, region in enumerate(regions):
        for vertex in region:
            meeting[vertex].append(int(number[cell]))
    kept = [v for v, cells in enumerate(meeting) if any(cells)]
    renamed = {v: 1 + i for i, v in enumerate(kept)}
    edges = max(map(len, regions))
    around = np.zeros((len(ocean), edges), dtype=np.int32)
    for row, cell in enumerate(ocean):
        around[row, : len(regions[cell])] = [renamed[v] for v in regions[cell]]
    corners = np.array([[*sorted(meeting[v], reverse=True), 0, 0][:3] for v in kept], dtype=np.int32)
    used, own = vertices[kept], points[ocean]
    names = ("lon", "lat") if on_sphere else ("x", "y")
    places = (angles(own), angles(used)) if on_sphere else (own.T, used.T)
    arrays: dict[str, tuple[tuple[str, ...], NDArray[Any]]] = {}
    for kind, dim, held in (("Cell", "nCells", places[0]), ("Vertex", "nVertices", places[1])):
        arrays |= {f"{name}{kind}": ((dim,), values) for name, values in zip(names, held, strict=True)}
    arrays["verticesOnCell"] = ("nCells", "maxEdges"), around
    arrays["cellsOnVertex"] = ("nVertices", "vertexDegree"), corners
    arrays["nEdgesOnCell"] = ("nCells",), np.array([len(regions[c]) for c in ocean], dtype=np.int32)
    arrays["maxLevelCell"] = ("nCells",), (1 + np.arange(len(ocean)) % LAYERS).astype(np.int32)
    return Made(arrays, {"on_a_sphere": "YES" if on_sphere else "NO"}, points, ocean)


def write_mesh(path: Path, made: Made, form: str = "NETCDF3_64BIT_OFFSET") -> None:
    write_output(path, made, {}, [], form=form)


def write_output(
    path: Path,
    made: Made | None,
    fields: Mapping[str, NDArray[np.floating]],
    times: Sequence[str],
    *,
    start: str = "",
    form: str = "NETCDF3_64BIT_OFFSET",
    attributes: Mapping[str, Any] = {},
    layers: int = LAYERS,
) -> None:
    """Fields [time, cell, layer] at times such as "0001-01-06_12:00:00", beside their mesh or without."""
    import netCDF4

    with netCDF4.Dataset(path, "w", format=form) as file:
        file.setncatts({"model_name": "mpas", "core_name": "ocean", **attributes, **(made.attributes if made else {})})
        sizes: dict[str, int | None] = {"Time": None, "StrLen": WORD, "nVertLevels": layers}
        for dims, values in made.arrays.values() if made else ():
            sizes |= dict(zip(dims, values.shape, strict=True))
        for values in fields.values():
            sizes["nCells"] = values.shape[1]
        for name, size in sizes.items():
            file.createDimension(name, size)
        for name, (dims, values) in made.arrays.items() if made else ():
            file.createVariable(name, values.dtype, dims)[:] = values
        words = [("xtime", ("Time", "StrLen"), times)] if times else []
        words += [("simulationStartTime", ("StrLen",), [start])] if start else []
        for name, dims, held in words:
            made_of = np.array([[c.encode() for c in word.ljust(WORD)] for word in held], dtype="S1")
            file.createVariable(name, "S1", dims)[:] = made_of if len(dims) == 2 else made_of[0]
        for name, values in fields.items():
            variable = file.createVariable(name, values.dtype, ("Time", "nCells", "nVertLevels"))
            variable.units = "C"
            variable[:] = values
