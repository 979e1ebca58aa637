"""VTK and pyvista data sets as grids: their own samples where they have a grid, loud resampling where not."""

from __future__ import annotations

import warnings
from types import SimpleNamespace

import numpy as np
import pytest
import pyvista

from render.datasets import ResamplingWarning, to_grid
from tests.support.raymarch import trilinear


def linear(points: np.ndarray) -> np.ndarray:
    """A field that linear interpolation reproduces, at points (..., 3)."""
    return 3.0 * points[..., 0] - 2.0 * points[..., 1] + 0.5 * points[..., 2] + 1.0


def image() -> pyvista.ImageData:
    data = pyvista.ImageData(dimensions=(4, 5, 6), spacing=(0.5, 1.0, 2.0), origin=(10.0, 20.0, 30.0))
    data.point_data["f"] = linear(data.points)
    return data


def sample_positions(grid) -> np.ndarray:
    k, j, i = np.indices(grid.shape)
    return np.stack([i, j, k], axis=-1) * grid.spacing + grid.origin  # [nz, ny, nx, 3]


def test_image_data_with_point_values_keep_every_sample() -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        grid = to_grid(image())
    assert grid.shape == (6, 5, 4)
    assert grid.spacing == (0.5, 1.0, 2.0)
    np.testing.assert_allclose(grid.values, linear(sample_positions(grid)), rtol=1e-6)


def test_cell_values_sit_at_cell_centres_and_are_not_smeared() -> None:
    data = image()
    data.clear_data()
    data.cell_data["f"] = np.random.default_rng(0).normal(size=data.n_cells)
    grid = to_grid(data)
    assert grid.shape == (5, 4, 3)
    assert grid.origin == (10.25, 20.5, 31.0)
    np.testing.assert_array_equal(grid.values.ravel(), data.cell_data["f"])
    np.testing.assert_allclose(sample_positions(grid).reshape(-1, 3), data.cell_centers().points)


def test_an_extent_that_starts_elsewhere_moves_the_origin() -> None:
    part = image().extract_subset((1, 3, 2, 4, 1, 5), rebase_coordinates=False)
    grid = to_grid(part)
    np.testing.assert_allclose(grid.bounds[0], [10.5, 22.0, 32.0])
    np.testing.assert_allclose(grid.values, linear(sample_positions(grid)), rtol=1e-6)


def test_plain_vtk_objects_do_as_well() -> None:
    from vtkmodules.util.numpy_support import numpy_to_vtk
    from vtkmodules.vtkCommonDataModel import vtkImageData

    data = vtkImageData()
    data.SetDimensions(2, 3, 4)
    array = numpy_to_vtk(np.arange(24.0))
    array.SetName("f")
    data.GetPointData().SetScalars(array)
    np.testing.assert_array_equal(to_grid(data).values, np.arange(24).reshape(4, 3, 2))


@pytest.mark.parametrize("on_cells", [False, True])
def test_an_uneven_rectilinear_grid_is_resampled_exactly_for_a_linear_field(on_cells: bool) -> None:
    x, y, z = np.cumsum([0, 0.5, 1.0, 0.75]), np.linspace(0, 3, 5), np.array([-1.0, 0.0, 3.0])
    data = pyvista.RectilinearGrid(x, y, z)
    if on_cells:
        data.cell_data["f"] = linear(data.cell_centers().points)
    else:
        data.point_data["f"] = linear(data.points)
    with pytest.warns(ResamplingWarning, match=r"resampled from \d x \d x \d to \d+ x \d+ x \d+ samples \(trilinear\)"):
        grid = to_grid(data)
    positions = sample_positions(grid)
    np.testing.assert_allclose(grid.values, linear(positions), rtol=1e-5, atol=1e-6)
    expected = data.cell_centers().bounds if on_cells else data.bounds
    np.testing.assert_allclose(np.stack(grid.bounds, axis=1).ravel(), expected, atol=1e-9)


def test_an_evenly_spaced_rectilinear_grid_is_taken_as_it_is() -> None:
    axis = np.linspace(0, 1, 5)
    data = pyvista.RectilinearGrid(axis, 2 * axis, 3 * axis)
    data.point_data["f"] = np.arange(125.0)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        grid = to_grid(data)
    np.testing.assert_array_equal(grid.values.ravel(), np.arange(125))
    np.testing.assert_allclose(grid.spacing, (0.25, 0.5, 0.75))


def test_a_tetrahedral_mesh_is_resampled_and_what_lies_outside_is_transparent() -> None:
    mesh = image().to_tetrahedra().threshold(12.0, scalars="f")  # cuts a corner off the box
    with pytest.warns(ResamplingWarning, match="interpolated linearly in each cell") as caught:
        grid = to_grid(mesh, array="f")
    assert "lie outside" in str(caught[0].message)
    assert grid.holes is not None
    assert 0.05 < grid.holes.mean() < 0.95
    inside = ~grid.holes
    np.testing.assert_allclose(grid.values[inside], linear(sample_positions(grid))[inside], rtol=1e-4)


def test_a_curvilinear_grid_is_resampled() -> None:
    z, y, x = np.mgrid[0:1:6j, 0:1:6j, 0:1:6j]
    data = pyvista.StructuredGrid(x + 0.2 * y, y, z)
    data.point_data["f"] = linear(data.points)
    with pytest.warns(ResamplingWarning):
        grid = to_grid(data)
    center = trilinear(grid, grid.center)[0]
    assert center == pytest.approx(linear(grid.center), abs=1e-4)


def test_an_image_turned_in_space_is_resampled_not_straightened_silently() -> None:
    data = image()
    angle = np.radians(30)
    data.direction_matrix = np.array([[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1]])
    data.point_data["f"] = linear(data.points)
    with pytest.warns(ResamplingWarning):
        grid = to_grid(data)
    inside = ~grid.holes
    np.testing.assert_allclose(grid.values[inside], linear(sample_positions(grid))[inside], rtol=1e-3)


def two_arrays() -> pyvista.ImageData:
    data = image()
    data.cell_data["g"] = np.zeros(data.n_cells)
    data.point_data["velocity"] = np.zeros((data.n_points, 3))
    return data


def no_array() -> pyvista.ImageData:
    return pyvista.ImageData(dimensions=(3, 3, 3))


@pytest.mark.parametrize(
    ("make", "options", "error", "message"),
    [
        (two_arrays, {}, ValueError, "name the array to render: the vtkImageData has point arrays ['f', 'velocity']"),
        (two_arrays, {"array": "h"}, ValueError, "no array 'h': the vtkImageData has point arrays"),
        (two_arrays, {"array": "velocity"}, ValueError, "'velocity' has 3 components per sample"),
        (no_array, {}, ValueError, "no named numeric array"),
        (image, {"spacing": 1.0}, ValueError, "vtkImageData has its own spacing"),
        (pyvista.ImageData, {}, ValueError, "the vtkImageData is empty"),
        (pyvista.Sphere, {"array": "Normals"}, ValueError, "3 components"),
        (lambda: pyvista.Sphere().elevation(), {"array": "Elevation"}, TypeError, "no volume cells"),
        (pyvista.Table, {}, TypeError, "holds no field"),
    ],
)
def test_what_is_refused(make, options: dict, error: type[Exception], message: str) -> None:
    with pytest.raises(error) as caught:
        to_grid(make(), **options)
    assert message in str(caught.value)


def test_nan_in_a_data_set_is_refused_but_outside_is_not_nan() -> None:
    data = image()
    data.point_data["f"][7] = np.nan
    with pytest.raises(ValueError, match="1 of 120 values are NaN"):
        to_grid(data)


@pytest.mark.parametrize("kind", ["image", "mesh", "blocks"])
@pytest.mark.parametrize(("array", "on_cells"), [(None, True), ("p", True), ("cell:p", True), ("point:p", False)])
def test_of_one_name_on_cells_and_points_the_cells_count(kind: str, array: str | None, on_cells: bool) -> None:
    data = pyvista.ImageData(dimensions=(5, 4, 3))
    data.cell_data["p"] = np.arange(24.0)
    data.point_data["p"] = linear(data.points)
    made = {"image": data, "mesh": data.cast_to_unstructured_grid(), "blocks": pyvista.MultiBlock([data, None])}[kind]
    grid = to_grid(made, array=array, warn=False)
    if on_cells:
        np.testing.assert_array_equal(grid.values.ravel(), np.arange(24))
    else:
        assert grid.shape == (3, 4, 5)
        np.testing.assert_allclose(grid.values, linear(sample_positions(grid)), atol=1e-6)


def test_notes_say_what_a_warning_would() -> None:
    mesh = image().cast_to_unstructured_grid().triangulate()
    with pytest.warns(ResamplingWarning) as caught:
        warned = to_grid(mesh)
    assert [str(warning.message) for warning in caught] == list(warned.notes)
    assert caught[0].filename == __file__
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert to_grid(mesh, warn=False).notes == warned.notes
        assert to_grid(warned) is warned  # said once


def test_values_at_the_corners_of_boxes_are_not_resampled() -> None:
    whole = image()
    mesh = whole.cast_to_unstructured_grid()
    shuffled = mesh.extract_cells(np.random.default_rng(0).permutation(mesh.n_cells))
    for boxes in (mesh, shuffled):
        grid = to_grid(boxes)
        assert grid.notes == ()
        np.testing.assert_array_equal(grid.values, to_grid(whole).values)
        np.testing.assert_allclose((grid.spacing, grid.origin), (whole.spacing, whole.origin), rtol=1e-12)


VALUES = np.random.default_rng(0).random((3, 4, 5)).astype(np.float32)


class Exporter:
    """An array of another library, known by DLPack alone."""

    def __dlpack__(self, **options):
        return VALUES.__dlpack__(**options)

    def __dlpack_device__(self):
        return VALUES.__dlpack_device__()


@pytest.mark.parametrize(
    ("field", "given"),
    [
        (VALUES, True),
        (np.asfortranarray(VALUES), True),
        (np.concatenate([VALUES, VALUES], axis=2)[:, :, :5], True),
        (VALUES.tolist(), True),
        (Exporter(), True),
        (SimpleNamespace(values=VALUES, spacing=(1.0, 2.0, 3.0), origin=(4.0, 5.0, 6.0)), False),
    ],
    ids=["array", "Fortran order", "view", "list", "DLPack", "field"],
)
def test_the_grid_is_the_same(field, given: bool) -> None:
    placed = {"spacing": (1.0, 2.0, 3.0), "origin": (4.0, 5.0, 6.0)} if given else {}
    grid = to_grid(field, **placed)
    assert np.array_equal(grid.values, VALUES)
    assert (grid.spacing, grid.origin) == ((1.0, 2.0, 3.0), (4.0, 5.0, 6.0))


def test_the_simulations_array_may_change_afterwards() -> None:
    field = VALUES.copy()
    grid = to_grid(field)
    field[:] = 0.0
    assert np.array_equal(grid.values, VALUES)


@pytest.mark.parametrize("field", [None, "text", object(), {"values": 1}])
def test_what_is_no_field_is_refused(field) -> None:
    with pytest.raises((TypeError, ValueError)):
        to_grid(field)
