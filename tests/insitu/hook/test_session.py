"""The hook: what it writes, what it costs, and what it warns of."""

from __future__ import annotations

import inspect
import re
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import insitu
from catalogs.store.catalog import Catalog
from catalogs.store.plan import name_problem
from catalogs.tools.check import check
from catalogs.vocabulary.appearance import Isosurface, VolumeRendering
from catalogs.vocabulary.scene import ViewPlan
from insitu.hook.member import HookArguments
from insitu.hook.session import Session
from insitu.members.request import member_name
from tests.support.hooked import FUNCTION, SPACING, VOLUME, blob, render

PROJECT = Path(__file__).resolve().parents[3]
SMALL = ViewPlan(frequency=1, width=8, height=8)


def test_it_returns_what_it_wrote(tmp_path: Path) -> None:
    result = render(tmp_path / "a.cdb", time=2.5)
    made = Catalog.open(tmp_path / "a.cdb")
    assert result.images == 12
    assert result.path.is_dir()
    assert result.range == (float(blob().min()), float(blob().max()))
    assert result.clipped_fraction == pytest.approx(np.mean(blob() < 0.0))
    assert 0 <= result.extra_memory < 2e9
    assert result.seconds >= result.render_seconds + result.write_seconds
    assert made.members[0].provenance["time"] == 2.5
    assert check(made.path) == []
    assert "12 images" in repr(result)


def test_the_summary_knows_the_field(catalog: Path) -> None:
    kept = Catalog.open(catalog).members[0].summary()
    assert kept is not None
    values = blob()
    inside = (values >= kept.bin_edges[0]) & (values <= kept.bin_edges[-1])
    assert kept.histogram.sum() == inside.sum()
    assert np.array_equal(kept.histogram, np.histogram(values, bins=kept.bin_edges)[0])
    assert len(kept.points) == 4000
    assert np.allclose(kept.point_opacities, FUNCTION.opacities(kept.point_values), atol=1e-6)
    # Sampled in proportion to opacity: the mean squared distance from the middle is that of the opacity itself.
    coordinates = np.stack(np.meshgrid(*[np.arange(12) * 0.1] * 3, indexing="ij"), axis=-1) - 0.55
    weights = FUNCTION.opacities(values)
    wanted = (weights * (coordinates**2).sum(-1)).sum() / weights.sum()
    got = ((kept.points - 0.55) ** 2).sum(axis=1).mean()
    assert got == pytest.approx(wanted, rel=0.15)
    assert (catalog / "members").stat().st_size < 1e6


def test_nothing_is_normalized_per_member(tmp_path: Path) -> None:
    path = tmp_path / "a.cdb"
    render(path, reynolds=110.0)
    render(path, field=0.5 * blob(), reynolds=120.0)
    made = Catalog.open(path)
    full, half = (made.images(m, "dvr", range(12)).astype(float)[..., 3].mean() for m in made.members)
    assert half < 0.6 * full


def test_out_of_bounds_warns_and_is_recorded(catalog: Path) -> None:
    with pytest.warns(UserWarning, match="outside its bounds"):
        result = render(catalog, reynolds=300.0)
    member = Catalog.open(catalog).member(result.name)
    assert member.parameters["Re"] == 300.0
    assert "outside its bounds" in member.provenance["warnings"][0]


@pytest.mark.parametrize(
    ("field", "appearance"),
    [
        (np.full((8, 8, 8), 0.5, np.float32), VOLUME),
        (np.full((8, 8, 8), 0.5, np.float32), Isosurface("surface", 0.25)),
        (blob(), Isosurface("surface", 7.0)),
    ],
    ids=["constant field", "isosurface of a constant field", "empty isosurface"],
)
def test_what_has_little_to_show_is_rendered_as_it_is(tmp_path: Path, field: np.ndarray, appearance: Any) -> None:
    result = render(tmp_path / "a.cdb", field, appearances=appearance, sample_distance=None)
    assert result.images == 12
    made = Catalog.open(tmp_path / "a.cdb")
    shown = made.images(result.name, appearance.name, range(12))[..., 3].any()
    assert shown == isinstance(appearance, VolumeRendering)


def test_a_transparent_first_member_is_as_good_as_any(tmp_path: Path) -> None:
    result = render(tmp_path / "a.cdb", np.zeros((8, 8, 8)), sample_distance=None)
    assert result.images == 12
    decibels = Catalog.open(tmp_path / "a.cdb").plan.provenance["measured_decibels"]["dvr"]
    assert np.isfinite(decibels)


def test_resampling_is_said_and_recorded(tmp_path: Path) -> None:
    import pyvista

    axis = np.linspace(0.0, 1.1, 12)
    mesh = pyvista.RectilinearGrid(axis, axis, axis**2 / 1.1)
    mesh["density"] = blob().ravel()
    with pytest.warns(UserWarning, match=r"(?i)resampl|interpolat"):
        result = render(tmp_path / "a.cdb", mesh, spacing=None)
    stored = Catalog.open(tmp_path / "a.cdb").members[0].provenance["warnings"]
    assert list(result.warnings) == stored
    assert len(stored) == 1


def test_a_smaller_member_is_rendered_with_a_warning(catalog: Path) -> None:
    with pytest.warns(UserWarning, match="spacing and origin"):
        render(catalog, reynolds=160.0, spacing=(0.1, 0.1, 0.05))


def test_bounds_given_hold_different_members_without_a_warning(tmp_path: Path, recwarn: Any) -> None:
    bounds = ((-1.0, -1.0, -1.0), (2.0, 2.0, 2.0))
    render(tmp_path / "a.cdb", reynolds=110.0, bounds=bounds)
    render(tmp_path / "a.cdb", reynolds=120.0, spacing=(0.15, 0.1, 0.1))
    assert Catalog.open(tmp_path / "a.cdb").plan.bounds == bounds
    assert not recwarn.list


@pytest.mark.slow
@pytest.mark.parametrize(("value", "copies"), [("field[0, 0, 0]", 3.7), ("numpy.nan", 4.2)], ids=["whole", "holes"])
def test_memory_is_bounded_by_a_few_copies_of_the_field(tmp_path: Path, value: str, copies: float) -> None:
    program = (
        "import sys, numpy, insitu\n"
        "from catalogs.vocabulary.appearance import *\nfrom catalogs.vocabulary.scene import ViewPlan\n"
        "volume = VolumeRendering('dvr', TransferFunction(((0, 0, 0, 1), (1, 1, 0, 0)), ((0, 0), (1, 0.5)), 0.3))\n"
        "axis = numpy.linspace(-1, 1, int(sys.argv[2]), dtype='f4')\n"
        "field = numpy.exp(-sum(g**2 for g in numpy.meshgrid(axis, axis, axis, indexing='ij', sparse=True)))\n"
        f"field[:9] = field[::7, ::7, ::7] = {value}\n"
        "print(insitu.render_member(field, {'a': 0.5}, catalog=sys.argv[1], space={'a': (0, 1)}, appearances=volume,"
        " views=ViewPlan(frequency=1, width=16, height=16), spacing=(1, 1, 1), sample_distance=2.0,"
        " nan='transparent').extra_memory)\n"
    )
    extra = {}
    for size in (32, 192):
        command = [sys.executable, "-c", program, str(tmp_path / f"{size}.cdb"), str(size)]
        result = subprocess.run(command, capture_output=True, text=True, cwd=PROJECT, check=True)
        extra[size] = int(result.stdout)
    field = 4 * (192**3 - 32**3)
    assert field < extra[192] - extra[32] < copies * field


def test_data_sets_of_pyvista_and_vtk_are_taken(tmp_path: Path) -> None:
    import pyvista

    mesh = pyvista.ImageData(dimensions=(12, 12, 12), spacing=SPACING)
    mesh["density"] = blob().ravel()
    path = tmp_path / "a.cdb"
    render(path, reynolds=110.0)
    render(path, mesh, reynolds=120.0, spacing=None, array="density")
    made = Catalog.open(path)
    first, second = (made.images(m, "dvr", range(12)) for m in made.members)
    assert np.array_equal(first, second)


def test_a_session_renders_many_members_through_one_window(tmp_path: Path) -> None:
    views = ViewPlan(frequency=1, width=24, height=24)
    with insitu.Session(tmp_path / "a.cdb", space={"Re": (100, 200)}, appearances=VOLUME, views=views) as session:
        for reynolds in (110.0, 150.0, 190.0):
            session.render_member(blob(reynolds / 300.0), {"Re": reynolds}, spacing=SPACING)
    assert len(Catalog.open(tmp_path / "a.cdb").members) == 3


def test_parameters_that_are_no_name_get_one(tmp_path: Path) -> None:
    names = [member_name({name: 1.5}) for name in ("ρ", "σ", "_x", "Re")]
    assert names[-1] == "Re-1.5"
    assert len(set(names)) == 4
    assert all(name_problem(name) is None for name in names)


def test_the_hook_shows_every_argument_that_it_takes() -> None:
    shown = inspect.signature(insitu.render_member).parameters
    assert list(shown)[:3] == ["field", "parameters", "catalog"]
    of_session = set(inspect.signature(Session).parameters)
    of_member = set(inspect.signature(Session.render_member).parameters) - {"self"}
    assert set(shown) == of_session | of_member
    assert {name: shown[name].default for name in ("appearances", "views", "split", "nan", "time")} == {
        "appearances": None,
        "views": None,
        "split": "train",
        "nan": "refuse",
        "time": None,
    }
    assert all(p.kind is p.KEYWORD_ONLY for name, p in shown.items() if name not in ("field", "parameters"))


@pytest.mark.parametrize("hook", ["render_member", "Session"])
def test_a_warning_points_at_the_callers_line(catalog: Path, hook: str) -> None:
    render = (
        partial(insitu.render_member, catalog=catalog) if hook == "render_member" else Session(catalog).render_member
    )
    with pytest.warns(UserWarning, match="outside its bounds") as caught:
        render(blob(), {"Re": 300.0}, spacing=SPACING)
    assert [warning.filename for warning in caught] == [__file__]


def test_warnings_can_be_taken_elsewhere(catalog: Path, recwarn: Any) -> None:
    said: list[str] = []
    with Session(catalog, warn=lambda note: said.append(str(note))) as session:
        result = session.render_member(blob(), {"Re": 300.0}, spacing=SPACING)
    assert said == list(result.warnings)
    assert len(said) == 1
    assert not recwarn.list


def test_a_session_is_told_in_one_line(catalog: Path, tmp_path: Path) -> None:
    assert repr(Session(catalog)) == f"Session({str(catalog)!r}, 1 member)"
    new = Session(tmp_path / "b.cdb", space={"Re": (1, 2)}, appearances=VOLUME)
    assert repr(new) == f"Session({str(tmp_path / 'b.cdb')!r}, not made yet)"


def test_a_loop_finds_all_that_it_needs_in_one_package_that_loads_nothing() -> None:
    script = (
        "import sys, insitu; print(sorted({'torch', 'vtkmodules', 'pyvista', 'numpy', 'scipy'} & set(sys.modules))); "
        "print([name for name in insitu.__all__ if not hasattr(insitu, name)], 'torch' in sys.modules)"
    )
    done = subprocess.run([sys.executable, "-c", script], cwd=PROJECT, capture_output=True, text=True, check=True)
    assert done.stdout.split("\n")[:2] == ["[]", "[] False"]
    needed = "Parameter ParameterSpace TransferFunction VolumeRendering Isosurface ViewPlan isovalue_family Session"
    assert set(needed.split()) <= set(insitu.__all__)


def test_a_field_is_called_what_the_loop_calls_it(tmp_path: Path) -> None:
    path = tmp_path / "a.cdb"
    first = render(path, fields={"Q": "1/s²"})
    assert re.search(r"\n  Q \S+ to \S+ 1/s², ", str(first))
    assert Catalog.open(path).plan.field_label() == "Q (1/s²)"
    render(path, reynolds=160.0, fields={"Q": "1/s²"})
    render(path, reynolds=170.0)  # a later call may leave it out
    for fields, message in (
        ({"T": "K"}, r"fields: T \(K\) here, Q \(1/s²\) in the catalog"),
        ({"T": "K", "Q": "1/s²"}, "the catalog has a single unnamed field"),
        ({"Q": 5}, "the unit of field 'Q' must be printable text, got 5"),
    ):
        with pytest.raises(ValueError, match=message):
            render(path, reynolds=180.0, fields=fields)
    assert len(Catalog.open(path).members) == 3


def test_a_field_says_itself_what_it_is_called(tmp_path: Path) -> None:
    field = insitu.Field(blob(), SPACING, (0.0, 0.0, 0.0), "T", "K")
    render(tmp_path / "a.cdb", field, spacing=None)
    assert Catalog.open(tmp_path / "a.cdb").plan.field_label() == "T (K)"
    render(tmp_path / "b.cdb", field, spacing=None, fields={"temperature": "°C"})  # what the caller says counts more
    assert Catalog.open(tmp_path / "b.cdb").plan.field_label() == "temperature (°C)"


def test_several_fields_are_described_by_the_names_that_appearances_give_them(tmp_path: Path) -> None:
    shown = [VolumeRendering("q", FUNCTION, field="q"), Isosurface("v", 0.5, field="speed")]
    data = {"q": blob(), "speed": insitu.Field(blob(0.4), SPACING, (0.0, 0.0, 0.0), "|u|", "m/s")}
    with pytest.raises(ValueError, match=r"fields describes heat, but the appearances show q, speed"):
        render(tmp_path / "a.cdb", data, appearances=shown, spacing=None, fields={"heat": "K"})
    assert not (tmp_path / "a.cdb").exists()
    data["q"] = insitu.Field(data["q"], SPACING, (0.0, 0.0, 0.0))
    render(tmp_path / "a.cdb", data, appearances=shown, spacing=None, fields={"q": insitu.Quantity("Q", "1/s²")})
    plan = Catalog.open(tmp_path / "a.cdb").plan
    assert [plan.field_label(name) for name in plan.fields] == ["Q (1/s²)", "|u| (m/s)"]


def test_a_parameter_on_a_logarithmic_scale_comes_through_the_hook(tmp_path: Path) -> None:
    render(tmp_path / "a.cdb", space=insitu.Parameter("Re", 100.0, 1e4, "", "log"))
    assert Catalog.open(tmp_path / "a.cdb").plan.space.normalize((1e3,)) == pytest.approx(0.0, abs=1e-12)
    with pytest.raises(ValueError, match=r'space\.Re\.scale: null here, "log" in the catalog'):
        render(tmp_path / "a.cdb", reynolds=160.0, space={"Re": (100.0, 1e4)})
    with pytest.raises(ValueError, match="Re has a logarithmic scale, so it must be positive, got -1"):
        render(tmp_path / "a.cdb", reynolds=-1.0, space=None)


def test_members_are_rendered_from_other_threads(tmp_path: Path) -> None:
    with (
        insitu.Session(tmp_path / "a.cdb", space={"Re": (100, 200)}, appearances=VOLUME, views=SMALL) as session,
        ThreadPoolExecutor(3) as threads,
    ):
        made = [
            threads.submit(session.render_member, blob(), {"Re": re}, spacing=SPACING) for re in range(110, 150, 10)
        ]
        assert [member.result().images for member in made] == [12] * 4
        session.render_member(blob(), {"Re": 190.0}, spacing=SPACING)
    first, *others = Catalog.open(tmp_path / "a.cdb").members
    pictures = [Catalog.open(tmp_path / "a.cdb").images(member, "dvr") for member in (first, *others)]
    assert all(np.array_equal(picture, pictures[0]) for picture in pictures)
    assert check(tmp_path / "a.cdb") == []


def test_the_hooks_types_name_every_argument_that_it_takes() -> None:
    shown = set(inspect.signature(insitu.render_member).parameters)
    assert set(HookArguments.__annotations__) == shown - {"field", "parameters", "catalog"}
