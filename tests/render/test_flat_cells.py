"""Meshes of cells that are far thinner along one axis, as of the sea and of boundary layers, keep what lies in their layers."""

from __future__ import annotations

import numpy as np
import pytest
import pyvista

from render.datasets import to_grid

LAYERS, WIDE, HIGH = 16, 1e5, 1e3


def heights(layers: int = LAYERS, ratio: float = 1.0) -> np.ndarray:
    """The ends of layers that grow by a ratio, from 0 to HIGH."""
    ends = np.append(0.0, np.cumsum(ratio ** np.arange(layers)))
    return HIGH * ends / ends[-1]


def curved(axis: int, ends: np.ndarray) -> pyvista.StructuredGrid:
    """WIDE x WIDE x HIGH, its layers along one axis, its columns wavy."""
    wide = np.linspace(0, WIDE, 13)
    place = np.stack(np.meshgrid(wide, wide, ends, indexing="ij"))
    place[0] += 0.01 * WIDE * np.sin(place[1] / WIDE * 6)
    return pyvista.StructuredGrid(*np.roll(place, axis + 1, axis=0))


KINDS = {
    "structured": lambda mesh: mesh,
    "hexahedra": lambda mesh: mesh.cast_to_unstructured_grid(),
    "tetrahedra": lambda mesh: pyvista.UnstructuredGrid(mesh.triangulate()),
    "blocks": lambda mesh: pyvista.MultiBlock(
        [mesh.extract_subset((0, 6, 0, 100, 0, 100)), mesh.extract_subset((6, 12, 0, 100, 0, 100))]
    ),
    "explicit": pyvista.ExplicitStructuredGrid,
}


@pytest.mark.filterwarnings("ignore::render.datasets.ResamplingWarning")
@pytest.mark.parametrize("on_cells", [False, True])
@pytest.mark.parametrize(
    ("kind", "axis"), [(kind, axis) for kind in KINDS for axis in ((0, 1, 2) if kind != "blocks" else (2,))]
)
def test_two_waves_in_sixteen_layers_are_kept(kind: str, on_cells: bool, axis: int) -> None:
    def wave(points: np.ndarray) -> np.ndarray:
        return np.sin(4 * np.pi * np.asarray(points, float)[:, axis] / HIGH)

    mesh = KINDS[kind](curved(axis, heights()))
    for part in mesh if isinstance(mesh, pyvista.MultiBlock) else [mesh]:
        part.clear_data()
        if on_cells:
            part.cell_data["t"] = wave(part.cell_centers().points)
        else:
            part.point_data["t"] = wave(part.points)
    grid = to_grid(mesh, array="t")
    assert grid.shape[2 - axis] >= LAYERS
    values = grid.values if grid.holes is None else grid.values[~grid.holes]
    assert min(values.max(), -values.min()) > 0.85  # of 1: samples lie up to half a layer from the crests
    assert "coarser" not in grid.notes[0]


@pytest.mark.parametrize(
    "kind", ["structured", pytest.param("tetrahedra", marks=pytest.mark.slow), "explicit", "rectilinear"]
)
@pytest.mark.parametrize(("ratio", "said"), [(1.1, False), (1.5, True)])
def test_layers_that_grow_are_resolved_or_the_note_says_that_they_are_not(kind: str, ratio: float, said: bool) -> None:
    ends = heights(24, ratio)
    finest = float(np.diff(ends).min())
    wide = np.linspace(0, WIDE, 13)
    mesh = pyvista.RectilinearGrid(wide, wide, ends) if kind == "rectilinear" else KINDS[kind](curved(2, ends))
    mesh.clear_data()
    mesh.point_data["t"] = np.asarray(mesh.points, float)[:, 2]
    grid = to_grid(mesh, warn=False)
    assert ("coarser than the finest cells" in grid.notes[0]) is said
    assert grid.spacing[2] < 1.1 * finest or said
    values = grid.values if grid.holes is None else grid.values[~grid.holes]
    np.testing.assert_allclose([values.min(), values.max()], [0, HIGH], atol=1e-6 * HIGH)


def test_cells_of_one_size_are_sampled_as_before() -> None:
    mesh = pyvista.ImageData(dimensions=(9, 7, 6)).to_tetrahedra()
    mesh.point_data["t"] = np.asarray(mesh.points)[:, 0]
    edge = (8 * 6 * 5 / mesh.n_cells) ** (1 / 3)
    assert to_grid(mesh, warn=False).shape == tuple(round(n / edge) + 1 for n in (5, 6, 8))
    cloud = pyvista.PolyData(np.random.default_rng(0).random((800, 3))).delaunay_3d()
    cloud.point_data["t"] = np.asarray(cloud.points)[:, 0]
    edge = (np.prod(np.ptp(cloud.points, axis=0)) / cloud.n_cells) ** (1 / 3)
    assert to_grid(cloud, warn=False).shape == tuple(
        np.round(np.ptp(cloud.points, axis=0) / edge).astype(int)[::-1] + 1
    )
