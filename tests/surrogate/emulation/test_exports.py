"""Exported fields are read by other programs as they were predicted."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from catalogs.vocabulary.quantity import Quantity
from surrogate.emulation import EmulatedField, FieldEmulator
from surrogate.emulation.exports import to_vti, to_xarray
from tests.support.ensembles_of_fields import ORIGIN, SHAPE, SPACING, smooth, some_points


def predicted(*, holes: bool = False) -> EmulatedField:
    points = some_points(8)
    field = FieldEmulator.fit(points, smooth(points), SPACING, ORIGIN).at([0.2, 0.1])
    return replace(field, holes=field.values > 11.0) if holes else field


@pytest.mark.parametrize("holes", [False, True])
@pytest.mark.parametrize("quantity", [None, Quantity("speed <u>", 'm/s & "more"'), Quantity("energy")])
def test_image_data_are_read_by_vtk(tmp_path: Path, quantity: Quantity | None, holes: bool) -> None:
    import pyvista
    from vtkmodules.vtkCommonCore import vtkDataArray

    field = predicted(holes=holes)
    to_vti(tmp_path / "field.vti", field, quantity)
    grid = pyvista.read(tmp_path / "field.vti")
    name = quantity.name if quantity else "value"
    assert grid.dimensions == SHAPE[::-1]
    np.testing.assert_allclose((grid.spacing, grid.origin), (SPACING, ORIGIN))
    assert grid.point_data.keys() == [name, f"{name}, standard deviation"]
    values = np.where(field.holes, np.nan, field.values) if holes else field.values
    np.testing.assert_array_equal(grid[name].reshape(SHAPE), values)
    unit = grid.GetPointData().GetArray(name).GetInformation().Get(vtkDataArray.UNITS_LABEL())
    assert unit == (quantity.unit if quantity and quantity.unit else None)
    assert [path.name for path in tmp_path.iterdir()] == ["field.vti"]


def test_xarray_holds_values_deviations_and_units() -> None:
    field = predicted(holes=True)
    data = to_xarray(field, Quantity("speed", "m/s"))
    assert data["speed"].dims == ("z", "y", "x")
    assert data["speed"].attrs["units"] == "m/s"
    np.testing.assert_array_equal(np.isnan(data["speed"]), field.holes)
    np.testing.assert_allclose(data["x"], ORIGIN[0] + SPACING[0] * np.arange(SHAPE[2]))
    np.testing.assert_array_equal(data["speed, standard deviation"].isnull(), field.holes)
