"""Values of cells belong to their centres: a linear field comes out exactly, on any mesh."""

from __future__ import annotations

import re
import warnings

import numpy as np
import pytest
import pyvista

from render.datasets import ResamplingWarning, to_grid
from render.grids import Grid

WAVE = 5.0


def linear(points: np.ndarray) -> np.ndarray:
    """At points (..., 3)."""
    return 3.0 * points[..., 0] - 2.0 * points[..., 1] + 0.5 * points[..., 2] + 1.0


def sample_positions(grid: Grid) -> np.ndarray:
    k, j, i = np.indices(grid.shape)
    return np.stack([i, j, k], axis=-1) * grid.spacing + grid.origin  # [nz, ny, nx, 3]


def image(cells: tuple[int, int, int] = (6, 5, 4), origin: tuple[float, float, float] = (10.0, 20.0, 30.0)):
    return pyvista.ImageData(dimensions=np.array(cells) + 1, spacing=(0.5, 1.0, 0.7), origin=origin)


def uneven() -> pyvista.RectilinearGrid:
    return pyvista.RectilinearGrid(
        np.cumsum([0, 0.5, 1.0, 0.75, 0.2]), np.linspace(0, 3, 6), np.array([-1.0, 0.0, 3.0, 3.5, 4])
    )


def sheared() -> pyvista.StructuredGrid:
    z, y, x = np.mgrid[0:1:7j, 0:1:6j, 0:1:5j]
    return pyvista.StructuredGrid(x**1.3 + 0.3 * y, y, z + 0.1 * x)


def with_ghosts() -> pyvista.UnstructuredGrid:
    """Two blocks that overlap by a layer of ghosts, whose values are garbage."""
    parts = []
    for first, ghost in ((0, 3), (2, 2)):
        part = image((4, 5, 4), (10.0 + 0.5 * first, 20.0, 30.0)).cast_to_unstructured_grid()
        part.cell_data["f"] = linear(part.cell_centers().points)
        column = np.floor((part.cell_centers().points[:, 0] - 10.0) / 0.5).astype(int)
        flags = np.where(column == ghost, 1, 0).astype(np.uint8)
        part.cell_data["f"][flags == 1] = 1e5
        part.cell_data["vtkGhostType"] = flags
        parts.append(part)
    return pyvista.MultiBlock(parts)


def in_blocks() -> pyvista.MultiBlock:
    return pyvista.MultiBlock([image((2, 5, 4)), image((4, 5, 4), (11.0, 20.0, 30.0))])


def refined() -> pyvista.MultiBlock:
    fine = pyvista.ImageData(dimensions=(5, 11, 9), spacing=(0.25, 0.5, 0.35), origin=(13.0, 20.0, 30.0))
    return pyvista.MultiBlock([image(), fine])


MESHES = {
    "image": image,
    "rectilinear": lambda: pyvista.RectilinearGrid(np.arange(5.0), 2 * np.arange(6.0), np.arange(4.0)),
    "uneven rectilinear": uneven,
    "image as cells": lambda: image().cast_to_unstructured_grid(),
    "uneven as cells": lambda: uneven().cast_to_unstructured_grid(),
    "straight structured": lambda: image().cast_to_structured_grid(),
    "structured": sheared,
    "tetrahedra": lambda: image().to_tetrahedra(),
    "part": lambda: image().extract_cells(np.arange(17, 97)),
    "blocks": in_blocks,
    "blocks combined": lambda: in_blocks().combine(),
    "blocks with ghosts": with_ghosts,
    "blocks of two sizes": refined,
    "nested blocks": lambda: pyvista.MultiBlock([pyvista.MultiBlock([image((2, 5, 4))]), in_blocks()[1], None]),
}


def filled(mesh, function):
    """The mesh with values of `function` at its cells' centres, unless it has values."""
    for block in mesh.recursive_iterator(skip_none=True) if isinstance(mesh, pyvista.MultiBlock) else [mesh]:
        if "f" not in block.cell_data:
            block.cell_data["f"] = function(block.cell_centers().points)
    return mesh


@pytest.mark.filterwarnings("ignore::render.datasets.ResamplingWarning")
@pytest.mark.parametrize("name", MESHES)
def test_a_linear_field_on_cells_comes_out_exactly(name: str) -> None:
    grid = to_grid(filled(MESHES[name](), linear))
    known = np.ones(grid.shape, dtype=bool) if grid.holes is None else ~grid.holes
    assert known.mean() > 0.3
    np.testing.assert_allclose(grid.values[known], linear(sample_positions(grid))[known], rtol=1e-5, atol=1e-5)


@pytest.mark.parametrize(
    "name", ["image as cells", "straight structured", "blocks", "blocks combined", "blocks with ghosts"]
)
def test_boxes_in_rows_are_samples_at_their_centres(name: str) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        grid = to_grid(filled(MESHES[name](), linear))
    assert grid.shape == (4, 5, 6)
    np.testing.assert_allclose(grid.spacing, (0.5, 1.0, 0.7), rtol=1e-6)
    np.testing.assert_allclose(grid.origin, (10.25, 20.5, 30.35))


def test_every_value_of_boxes_in_rows_is_kept() -> None:
    mesh = image().cast_to_unstructured_grid()
    mesh.cell_data["f"] = np.random.default_rng(0).normal(size=mesh.n_cells)
    shuffled = mesh.extract_cells(np.random.default_rng(1).permutation(mesh.n_cells))
    np.testing.assert_array_equal(to_grid(mesh).values.ravel(), mesh.cell_data["f"])
    np.testing.assert_array_equal(to_grid(shuffled, array="f").values.ravel(), mesh.cell_data["f"])


@pytest.mark.filterwarnings("ignore::render.datasets.ResamplingWarning")
def test_a_smooth_field_is_not_half_a_cell_off() -> None:
    def wave(points):
        return np.sin(points @ [WAVE, 0.7 * WAVE, 0.4 * WAVE])

    errors = []
    for cells in (8, 16):
        mesh = pyvista.ImageData(dimensions=[cells + 1] * 3, spacing=[1 / cells] * 3).to_tetrahedra()
        grid = to_grid(filled(mesh, wave))
        errors.append(np.sqrt(np.mean((grid.values - wave(sample_positions(grid))) ** 2)))
    assert errors[0] < 0.1
    assert errors[1] < errors[0] / 3  # second order; constant cells halve it


@pytest.mark.filterwarnings("ignore::render.datasets.ResamplingWarning")
def test_no_sample_of_inner_cells_leaves_the_range_of_the_values() -> None:
    mesh = pyvista.ImageData(dimensions=(9, 9, 9)).to_tetrahedra()
    centers = mesh.cell_centers().points
    mesh.cell_data["f"] = (np.linalg.norm(centers - 4.0, axis=1) < 2.0).astype(float)
    grid = to_grid(mesh)
    assert 0.0 <= grid.values.min() < grid.values.max() <= 1.0


def test_the_note_says_how() -> None:
    with pytest.warns(ResamplingWarning, match="linear in each cell around its centre"):
        to_grid(filled(MESHES["tetrahedra"](), linear))


@pytest.mark.parametrize("kind", ["image", "rectilinear", "structured"])
def test_hidden_cells_are_transparent(kind: str) -> None:
    mesh = {"image": image(), "rectilinear": uneven(), "structured": image().cast_to_structured_grid()}[kind]
    centers = mesh.cell_centers().points
    hidden = centers[:, 0] > mesh.center[0]
    mesh.cell_data["f"] = np.where(hidden, 1e9, linear(centers))
    mesh.cell_data["vtkGhostType"] = 32 * hidden.astype(np.uint8)
    grid = to_grid(mesh, warn=False)
    assert grid.holes is not None or grid.bounds[1][0] <= mesh.center[0]
    assert grid.values.max() < 1e3


def two_names() -> pyvista.MultiBlock:
    mixed = in_blocks()
    mixed[0].cell_data["f"], mixed[1].cell_data["g"] = np.zeros(mixed[0].n_cells), np.zeros(mixed[1].n_cells)
    return mixed


@pytest.mark.parametrize(
    ("make", "options", "message"),
    [
        (
            two_names,
            {},
            "name the array to render: the blocks of the vtkMultiBlockDataSet have point arrays [] and cell arrays",
        ),
        (two_names, {"array": "h"}, "no array 'h'"),
        (pyvista.MultiBlock, {}, "none of its blocks has cells"),
    ],
)
def test_what_is_refused(make, options, message: str) -> None:
    with pytest.raises(ValueError, match=re.escape(message)):
        to_grid(make(), **options)


def test_one_block_of_several_has_the_array() -> None:
    assert to_grid(two_names(), array="f").shape == (4, 5, 2)
