"""Emulated fields are exported with their units and standard deviations, as other programs read them."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner, Result

import insitu
from catalogs.store.catalog import Catalog
from catalogs.vocabulary.appearance import Isosurface, VolumeRendering
from catalogs.vocabulary.scene import ViewPlan
from catalogs.vocabulary.variations.field import field_variation
from surrogate.explore.exporting.commands import export
from surrogate.explore.exporting.exports import exported
from surrogate.explore.run import Run
from surrogate.model import Surrogate
from surrogate.settings import TrainingSettings
from surrogate.training.run import train
from tests.support.hooked import FUNCTION, blob
from tests.support.requests import message

pyvista = pytest.importorskip("pyvista")

SIZE = 8


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run with the emulators of two fields over p, without Gaussians."""
    folder = tmp_path_factory.mktemp("runs") / "two"
    looks = [VolumeRendering("dvr", FUNCTION, field="q"), Isosurface("surface", 2.0, field="speed")]
    options: dict[str, Any] = {
        "variations": [field_variation("dvr", appearances=["surface"])],
        "space": {"p": (0.0, 1.0)},
        "appearances": looks,
        "fields": {"q": "1/s²", "speed": "m/s"},
    }
    views = ViewPlan(frequency=1, width=16, height=16)
    with insitu.Session(folder / "catalog.cdb", views=views, **options) as session:
        for p in (0.0, 0.3, 0.7, 1.0):
            fields = {"q": blob(size=SIZE) * (1.0 + p), "speed": blob(size=SIZE) * 4.0 + p}
            session.render_member(fields, {"p": p}, spacing=(1.1 / (SIZE - 1),) * 3)
    train(TrainingSettings(), Catalog.open(folder / "catalog.cdb"), folder / "surrogate", only_field=True)
    return folder


def invoke(*arguments: Any) -> Result:
    return CliRunner().invoke(export, [str(argument) for argument in arguments])


@pytest.mark.parametrize(
    ("chosen", "names"),
    [
        ((), ["q", "speed"]),
        (("-a", "dvr"), ["q"]),
        (("-a", "speed", "-a", "dvr"), ["speed", "q"]),
        (("-p", "appearance=surface"), ["speed"]),
    ],
)
def test_fields_are_written_with_units_and_deviations(
    run: Path, tmp_path: Path, chosen: tuple[str, ...], names: list[str]
) -> None:
    from vtkmodules.vtkCommonCore import vtkDataArray

    result = invoke(run, "-p", "p=0.4", *chosen, "-o", tmp_path / "a.vti")
    units = {"q": "1/s²", "speed": "m/s"}
    labels = ", ".join(f"{name} ({units[name]})" for name in names)
    assert result.stdout == f"{tmp_path / 'a.vti'}: {labels} with standard deviations, p = 0.4\n", result.output
    grid, model = pyvista.read(tmp_path / "a.vti"), Surrogate.load(run / "surrogate").field
    assert model is not None
    assert grid.point_data.keys() == [part for name in names for part in (name, f"{name}, standard deviation")]
    for name in names:
        field = model.emulators[name].at(model.space.normalize([0.4]))
        np.testing.assert_array_equal(grid[name].reshape((SIZE,) * 3), field.values)
        np.testing.assert_array_equal(grid[f"{name}, standard deviation"].reshape((SIZE,) * 3), field.deviations)
        unit = grid.GetPointData().GetArray(name).GetInformation().Get(vtkDataArray.UNITS_LABEL())
        assert unit == units[name]


def test_the_page_saves_the_same(run: Path, tmp_path: Path) -> None:
    invoke(run, "-p", "p=0.25", "-o", tmp_path / "a.vti")
    made = exported(message(kind="vti"), Run.open(run))
    assert made.name.endswith(".vti")
    assert made.content == (tmp_path / "a.vti").read_bytes()


@pytest.mark.parametrize(
    ("arguments", "complaint"),
    [
        (("-a", "energy"), "no field of energy is emulated, only of dvr, surface, q, speed"),
        (("-p", "p=9"), "p = 9 lies too far outside its bounds [0, 1]: it can be drawn from -1 to 2"),
        (("-p", "q=9"), "unknown parameter q: this surrogate has p, appearance"),
    ],
)
def test_what_can_not_be_written_is_said(run: Path, tmp_path: Path, arguments: tuple[str, ...], complaint: str) -> None:
    result = invoke(run, *arguments, "-o", tmp_path / "a.vti")
    assert result.exit_code == 1
    assert complaint in result.stderr
    assert not (tmp_path / "a.vti").exists()


def test_values_out_of_bounds_are_reported(run: Path, tmp_path: Path) -> None:
    result = invoke(run, "-p", "p=1.5", "-o", tmp_path / "a.vti")
    assert result.stderr == "p = 1.5 lies outside its bounds [0, 1]: extrapolating beyond the training range\n"


def test_members_give_fields_of_any_shape(run: Path) -> None:
    field = Surrogate.load(run / "surrogate").at(p=0.4).field(shape=(4, 5, 6))
    assert field.values.shape == (4, 5, 6)
    assert str(field.quantity) == "q (1/s²)"
    other = Surrogate.load(run / "surrogate").at(p=0.4, appearance="surface").field()
    assert str(other.quantity) == "speed (m/s)"
    assert field.statistics().minimum.deviation is not None
