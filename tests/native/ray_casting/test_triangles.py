"""Triangles of isosurfaces: those that VTK has, in every case of a cell, and hard fields."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy.spatial import cKDTree

from native.ray_casting import SampledField
from native.ray_casting.triangles import Triangles
from render.grids import Grid
from render.isosurface import extract
from render.placement import Placement
from tests.support.cast_cases import gyroid, punctured, with_values

RANDOM = np.random.default_rng(5)


def of_vtk(field: SampledField, isovalue: float) -> tuple[Any, Any]:
    """Places (T, 3, 3), in samples, and normals (T, 3, 3) of VTK's triangles."""
    from vtkmodules.util.numpy_support import vtk_to_numpy

    grid = Grid(field.filled, (1.0, 1.0, 1.0), (0.0, 0.0, 0.0), field.holes)
    placement = Placement.of(grid)
    surface = extract(grid, isovalue, placement)
    corners = vtk_to_numpy(surface.GetPolys().GetConnectivityArray()).reshape(-1, 3)
    places = (vtk_to_numpy(surface.GetPoints().GetData()) - placement.origin) / placement.spacing  # [V, 3]
    return places[corners], vtk_to_numpy(surface.GetPointData().GetNormals())[corners]


def described(places: Any, normals: Any) -> Any:
    """Numbers (T, 12) that tell triangles apart, whichever corner comes first."""
    return np.concatenate([a.mean(axis=1) for a in (places, places**2, normals, places * normals)], axis=1)


FIELDS: dict[str, tuple[SampledField, float]] = {
    "gyroid": (gyroid(), 0.2),
    "holes": (punctured(), 0.2),
    "noise, all cases of a cell": (
        SampledField(RANDOM.uniform(0.3, 1.0, (18, 17, 16)) * RANDOM.choice([-1.0, 1.0], (18, 17, 16))),
        0.0,
    ),
    "one cell": (SampledField(np.linspace(-1, 1, 8).reshape(2, 2, 2)), 0.1),
    "whole numbers": (SampledField(np.arange(60).reshape(3, 4, 5) % 7), 3.5),
}


@pytest.mark.parametrize("name", FIELDS)
def test_triangles_are_those_of_vtk(name: str) -> None:
    field, isovalue = FIELDS[name]
    field = SampledField(field.values, field.holes)
    found, (places, normals) = Triangles.of(field, isovalue), of_vtk(field, isovalue)
    assert len(found.corners) == len(places) > 0
    own = described(found.places[found.corners], -found.normals[found.corners])
    distances, others = cKDTree(described(places, normals)).query(own)
    assert distances.max() < 1e-3
    assert len(set(others)) == len(others)


def test_normals_are_of_the_world() -> None:
    z, y, x = np.mgrid[0:5, 0:6, 0:7].astype(np.float64)
    triangles = Triangles.of(SampledField(0.5 * x + 2.0 * y - z, None, (0.5, 2.0, 1.0)), 1.3)
    np.testing.assert_allclose(triangles.normals, np.tile([1.0, 1.0, -1.0] / np.sqrt(3.0), (len(triangles.normals), 1)))
    np.testing.assert_allclose(triangles.places @ [0.5, 2.0, -1.0], 1.3)


@pytest.mark.parametrize("value", [0.2, 7.0, -7.0])
def test_a_constant_field_has_none(value: float) -> None:
    triangles = Triangles.of(with_values(np.full((4, 5, 6), 0.2)), value)
    assert triangles.places.shape == triangles.normals.shape == triangles.corners.shape == (0, 3)
