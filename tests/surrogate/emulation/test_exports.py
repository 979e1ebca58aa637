"""Exported fields are read by other programs as they were predicted."""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from catalogs.vocabulary.quantity import Quantity
from surrogate.emulation import EmulatedField, FieldEmulator
from surrogate.emulation.exports import vti_bytes
from tests.support.ensembles_of_fields import ORIGIN, SHAPE, SPACING, smooth, some_points

UNKNOWN = Quantity()


def predicted(quantity: Quantity = UNKNOWN, *, holes: bool = False) -> EmulatedField:
    points = some_points(8)
    field = FieldEmulator.fit(points, smooth(points), SPACING, ORIGIN).at([0.2, 0.1])
    return replace(field, quantity=quantity, holes=field.values > 11.0 if holes else None)


@pytest.mark.parametrize("holes", [False, True])
@pytest.mark.parametrize("quantity", [UNKNOWN, Quantity("speed <u>", 'm/s & "more"'), Quantity("energy")])
def test_image_data_are_read_by_vtk(tmp_path: Path, quantity: Quantity, holes: bool) -> None:
    import pyvista
    from vtkmodules.vtkCommonCore import vtkDataArray

    field = predicted(quantity, holes=holes)
    field.save(tmp_path / "field.vti")
    grid = pyvista.read(tmp_path / "field.vti")
    name = quantity.name or "value"
    assert grid.dimensions == SHAPE[::-1]
    np.testing.assert_allclose((grid.spacing, grid.origin), (SPACING, ORIGIN))
    assert grid.point_data.keys() == [name, f"{name}, standard deviation"]
    values = np.where(field.holes, np.nan, field.values) if holes else field.values
    np.testing.assert_array_equal(grid[name].reshape(SHAPE), values)
    unit = grid.GetPointData().GetArray(name).GetInformation().Get(vtkDataArray.UNITS_LABEL())
    assert unit == (quantity.unit or None)
    assert [path.name for path in tmp_path.iterdir()] == ["field.vti"]


def test_xarray_holds_values_deviations_and_units() -> None:
    field = predicted(Quantity("speed", "m/s"), holes=True)
    data = field.to_xarray()
    assert data["speed"].dims == ("z", "y", "x")
    assert data["speed"].attrs["units"] == "m/s"
    np.testing.assert_array_equal(np.isnan(data["speed"]), field.holes)
    np.testing.assert_allclose(data["x"], ORIGIN[0] + SPACING[0] * np.arange(SHAPE[2]))
    np.testing.assert_array_equal(data["speed, standard deviation"].isnull(), field.holes)


def test_several_fields_share_a_file_of_one_grid(tmp_path: Path) -> None:
    import pyvista

    fields = [predicted(Quantity("speed", "m/s")), predicted(Quantity("energy", "J"), holes=True)]
    (tmp_path / "a.vti").write_bytes(vti_bytes(fields))
    names = ["speed", "speed, standard deviation", "energy", "energy, standard deviation"]
    assert pyvista.read(tmp_path / "a.vti").point_data.keys() == names
    for wrong, complaint in (
        ([fields[0], fields[0]], "two fields have one name"),
        ([fields[0], fields[1].resampled((4, 4, 4))], "the fields lie on different grids"),
    ):
        with pytest.raises(ValueError, match=complaint):
            vti_bytes(wrong)
    with pytest.raises(ValueError, match=r"must end with \.vti, got a\.nc"):
        fields[0].save(tmp_path / "a.nc")


def test_without_xarray_its_command_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "xarray", None)
    with pytest.raises(ModuleNotFoundError, match=r"^to_xarray needs the package xarray: pip install xarray$"):
        predicted().to_xarray()
