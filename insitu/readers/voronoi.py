"""Cells of an MPAS mesh, a Voronoi tessellation of a sphere or of a plane, at the points of a regular grid.

The mesh has cells around their centres, and dual triangles between the centres of the three cells that meet at a vertex.
Sources: the "MPAS Mesh Specification"; Ringler, T. et al. 2010, "A unified approach to energy conservation and potential vorticity
dynamics for arbitrarily-structured C-grids".
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

ROOM = 1 << 24  # numbers that one step of the search holds
AROUND = (
    4  # cells near a point whose dual triangles may contain it: one with an obtuse angle need not touch the nearest
)
ON_EDGE = 1e-9  # of a cell's extent: points that close to its edge are in it


@dataclass(frozen=True, eq=False)
class VoronoiMesh:
    """Cells and vertices; indices from 0, -1 where there is none.

    Attributes
    ----------
    centers : [C, D] of the cells: on the unit sphere (D = 3), or in the plane (D = 2).
    vertices : [V, D].
    vertices_on_cell : [C, E], in order around each cell.
    cells_on_vertex : [V, 3]; a vertex at the boundary has fewer cells.
    period : (x, y) of a periodic plane; 0 along an axis without.
    """

    centers: NDArray[np.float64]  # [C, D]
    vertices: NDArray[np.float64]  # [V, D]
    vertices_on_cell: NDArray[np.int64]  # [C, E]
    cells_on_vertex: NDArray[np.int64]  # [V, 3]
    period: tuple[float, float] = (0.0, 0.0)

    @property
    def is_sphere(self) -> bool:
        return self.centers.shape[1] == 3


@dataclass(frozen=True, eq=False)
class PointLocations:
    """The places of points in a mesh.

    Attributes
    ----------
    cells : [N], the cell that contains each; -1 outside all of them.
    corners, weights : [N, 3], the cells at the corners of the dual triangle around it, and their barycentric weights.  They are -1
        and 0 where there is no triangle, as within half a cell of the boundary.
    """

    cells: NDArray[np.int64]  # [N]
    corners: NDArray[np.int64]  # [N, 3]
    weights: NDArray[np.float64]  # [N, 3]

    def sampled(self, values: NDArray[np.floating], linear: bool) -> NDArray[np.floating]:
        """Values [C] of the cells at the points [N]: of the containing cell, or `linear` between centres where all three have one.

        NaN outside the cells, and where the containing cell's value is.
        """
        nearest = np.where(self.cells < 0, np.nan, values[self.cells]).astype(values.dtype)
        if not linear:
            return nearest
        between = np.sum(values[self.corners] * self.weights, axis=1)
        is_inside = (self.corners[:, 0] >= 0) & np.isfinite(between) & np.isfinite(nearest)
        return np.where(is_inside, between, nearest).astype(values.dtype)


def on_sphere(longitudes: NDArray[np.float64], latitudes: NDArray[np.float64]) -> NDArray[np.float64]:
    """Points [..., 3] of the unit sphere at angles in radians."""
    return np.stack(
        [np.cos(latitudes) * np.cos(longitudes), np.cos(latitudes) * np.sin(longitudes), np.sin(latitudes)], axis=-1
    )


def spacing_of(mesh: VoronoiMesh) -> float:
    """The median distance of a cell's centre to the nearest other."""
    distances, _ = _tree(mesh).query(_wrapped(mesh, mesh.centers), k=2)
    return float(np.median(distances[:, 1]))


def locate(mesh: VoronoiMesh, points: NDArray[np.float64], linear: bool) -> PointLocations:
    """The places of `points` [N, D]; triangles are only looked for if `linear`."""
    tree, count = _tree(mesh), len(points)
    cells, corners, weights = np.full(count, -1), np.full((count, 3), -1), np.zeros((count, 3))
    step = max(1, ROOM // (mesh.vertices_on_cell.shape[1] * 9))
    for begin in range(0, count, step):
        part = slice(begin, begin + step)
        _, nearest = tree.query(_wrapped(mesh, points[part]), k=range(1, 1 + min(AROUND, len(mesh.centers))))
        inside = _contains(mesh, nearest[:, 0], points[part])
        cells[part] = np.where(inside, nearest[:, 0], -1)
        for near in nearest.T if linear else ():
            lacking = begin + np.flatnonzero(inside & (corners[part, 0] < 0))
            corners[lacking], weights[lacking] = _triangles(mesh, near[lacking - begin], points[lacking])
    return PointLocations(cells, corners, weights)


def _tree(mesh: VoronoiMesh) -> Any:
    from scipy.spatial import cKDTree

    box = None if mesh.is_sphere or not any(mesh.period) else [p or 0.0 for p in mesh.period]
    return cKDTree(_wrapped(mesh, mesh.centers), boxsize=box)


def _wrapped(mesh: VoronoiMesh, points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Points of a periodic plane within one period."""
    if mesh.is_sphere or not any(mesh.period):
        return points
    return np.stack([np.mod(points[:, a], p) if p else points[:, a] for a, p in enumerate(mesh.period)], axis=1)


def _from(mesh: VoronoiMesh, origins: NDArray[np.float64], points: NDArray[np.float64]) -> NDArray[np.float64]:
    """The shortest way from origins to points of a plane."""
    away = points - origins
    for axis, period in enumerate(mesh.period):
        if period:
            away[..., axis] -= period * np.round(away[..., axis] / period)
    return away


def _contains(mesh: VoronoiMesh, cells: NDArray[np.int64], points: NDArray[np.float64]) -> NDArray[np.bool_]:
    """True if each of the `cells` [N], which are convex, contains its point [N, D].

    The cell with the nearest centre is the one that contains a point, unless that one was removed from the mesh.
    """
    around = mesh.vertices_on_cell[cells]  # [N, E]
    first = mesh.vertices[around]  # [N, E, D]
    first = np.where(around[..., None] < 0, first[:, :1], first)  # an edge of no length, which every point is beside
    if not mesh.is_sphere:
        first = _from(mesh, mesh.centers[cells][:, None], first)
        points = _from(mesh, mesh.centers[cells], points)
    second = np.roll(first, -1, axis=1)
    if mesh.is_sphere:
        sides = np.cross(first, second)  # [N, E, 3]
        at_point = np.einsum("nei,ni->ne", sides, points)
        at_center = np.einsum("nei,ni->ne", sides, mesh.centers[cells])
    else:
        edges = second - first
        at_point = _cross(edges, points[:, None] - first)
        at_center = _cross(edges, -first)
    turned = np.where(at_center < 0, -at_point, at_point)
    extent = np.abs(at_center).max(axis=1, keepdims=True)
    return np.asarray(((turned >= -ON_EDGE * extent) & (extent > 0)).all(axis=1))


def _cross(first: NDArray[np.float64], second: NDArray[np.float64]) -> NDArray[np.float64]:
    return first[..., 0] * second[..., 1] - first[..., 1] * second[..., 0]


def _triangles(
    mesh: VoronoiMesh, cells: NDArray[np.int64], points: NDArray[np.float64]
) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """(corners, weights) [N, 3] of the dual triangle around each point, of those at the vertices of the cell nearest to it."""
    around = mesh.vertices_on_cell[cells]  # [N, E]
    corners = np.where(around[..., None] < 0, -1, mesh.cells_on_vertex[around])  # [N, E, 3]
    there = (corners >= 0).all(axis=2)
    tips = mesh.centers[corners]  # [N, E, 3, D]
    if mesh.is_sphere:
        a, b, c = tips[..., 0, :], tips[..., 1, :], tips[..., 2, :]
        parts = np.stack([np.cross(b, c), np.cross(c, a), np.cross(a, b)], axis=-2)  # [N, E, 3, 3]
        shares = np.einsum("nekd,nd->nek", parts, points)
    else:
        tips = _from(mesh, points[:, None, None], tips)  # the point is the origin
        a, b, c = tips[..., 0, :], tips[..., 1, :], tips[..., 2, :]
        shares = np.stack([_cross(b, c), _cross(c, a), _cross(a, b)], axis=-1)
    total = shares.sum(axis=2, keepdims=True)
    weights = np.where(total == 0, -1.0, shares / np.where(total == 0, 1.0, total))  # [N, E, 3]
    least = np.where(there, weights.min(axis=2), -np.inf)  # [N, E]
    best = least.argmax(axis=1)
    rows = np.arange(len(points))
    is_inside = least[rows, best] >= -ON_EDGE
    return np.where(is_inside[:, None], corners[rows, best], -1), np.where(is_inside[:, None], weights[rows, best], 0.0)
