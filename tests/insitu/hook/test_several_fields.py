"""Members of several fields, end to end: each field looks, is measured and is kept as if it were alone."""

from __future__ import annotations

import tomllib
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any
from unittest.mock import ANY

import h5py
import numpy as np
import pytest
from click.testing import CliRunner

import insitu
from catalogs.store.catalog import Catalog
from catalogs.store.members import Member
from catalogs.tools.check import check
from catalogs.vocabulary.appearance import (
    Appearance,
    Isosurface,
    TransferFunction,
    VolumeRendering,
    appearance_from_json,
)
from catalogs.vocabulary.parameters import Parameter, ParameterSpace
from catalogs.vocabulary.scene import PlannedMember, Scene, ViewPlan
from catalogs.vocabulary.variations import field_variation, isovalue_family
from insitu.cli import main
from insitu.ensembles.dataset import make_dataset
from insitu.ensembles.ensemble import run_ensemble
from insitu.fields.cache import load_field, save_field
from insitu.fields.field import Field
from insitu.fields.summarize import value_range_of
from insitu.members.planning import PlanOptions
from insitu.readers.ensemble_file import StoredEnsemble
from insitu.readers.layout import FileMapping
from tests.support.hooked import FUNCTION, SPACING, blob, tree
from tests.support.scenes import scene

PROJECT = Path(__file__).resolve().parents[3]
WIDE = TransferFunction(((0.0, 0.0, 1.0, 0.0), (8.0, 1.0, 0.0, 1.0)), ((1.0, 0.0), (8.0, 0.9)), 0.2)
Q = VolumeRendering("dvr", FUNCTION, field="q")
SPEED = VolumeRendering("speed-dvr", WIDE, field="speed")
SURFACE = Isosurface("surface", 4.0, field="speed")
LOOKS = (Q, SPEED, SURFACE)
VARIATION = field_variation("dvr", appearances=["speed-dvr", "surface"])


def speed(width: float = 0.5) -> np.ndarray:
    """Another field than `blob`: a slope along x through a wider blob, up to 7."""
    return (8.0 * blob(0.8 * width) * np.linspace(0.2, 1.0, 12)[None, None, :]).astype(np.float32)


def options(**changes: Any) -> dict[str, Any]:
    return {
        "space": {"Re": (100.0, 200.0)},
        "appearances": LOOKS,
        "variations": [VARIATION],
        "views": ViewPlan(frequency=1, width=24, height=24),
        "sample_distance": 0.05,
        **changes,
    }


def render(path: Path, data: Any, reynolds: float = 150.0, spacing: Any = SPACING, **changes: Any) -> Any:
    return insitu.render_member(data, {"Re": reynolds}, catalog=path, spacing=spacing, **options(**changes))


def alone(path: Path, data: np.ndarray, appearances: tuple[Appearance, ...], **changes: Any) -> tuple[Catalog, Member]:
    """The catalog of one field, whose appearances name none."""
    unnamed = [replace(a, field="") for a in appearances]  # type: ignore[type-var]
    render(path, data, **{"appearances": unnamed, "variations": None, **changes})
    made = Catalog.open(path)
    return made, made.members[0]


def test_each_field_is_rendered_and_kept_as_if_it_were_alone(tmp_path: Path) -> None:
    result = render(tmp_path / "a.cdb", {"q": blob(), "speed": speed()})
    made = Catalog.open(tmp_path / "a.cdb")
    (member,) = made.members
    assert check(made.path) == []
    assert made.plan.variations == (VARIATION,)
    assert list(member.summaries()) == ["q", "speed"]
    for field, data, looks in (("q", blob(), (Q,)), ("speed", speed(), (SPEED, SURFACE))):
        one, single = alone(tmp_path / f"{field}.cdb", data, looks)
        for look in looks:
            assert np.array_equal(made.images(member, look.name), one.images(single, look.name))
        here, there = member.summary(field), single.summary()
        assert here is not None
        assert there is not None
        for name in ("minimum", "maximum", "clipped_fraction", "histogram", "bin_edges", "points", "point_values"):
            assert np.array_equal(getattr(here, name), getattr(there, name)), name
        assert value_range_of(made.plan, field) == value_range_of(one.plan, "")
        assert result.ranges[field] == (float(data.min()), float(data.max())) == (here.minimum, here.maximum)
        assert result.clipped_fractions[field] == there.clipped_fraction
    assert result.images == 3 * 12
    assert (result.range, result.clipped_fraction) == (result.ranges["q"], result.clipped_fractions["q"])
    assert "q " in str(result)
    assert "speed " in str(result)


def test_a_data_set_gives_the_same(tmp_path: Path) -> None:
    import pyvista

    mesh = pyvista.ImageData(dimensions=(12, 12, 12), spacing=SPACING)
    for name, values in (("speed", speed()), ("pressure", np.ones((12, 12, 12))), ("q", blob())):
        mesh[name] = values.ravel()
    render(tmp_path / "a.cdb", {"q": blob(), "speed": speed()}, 110.0)
    render(tmp_path / "a.cdb", mesh, 120.0, spacing=None)
    made = Catalog.open(tmp_path / "a.cdb")
    first, second = made.members
    for look in LOOKS:
        assert np.array_equal(made.images(first, look.name), made.images(second, look.name))


def test_each_volume_is_sampled_as_finely_as_its_own_field_needs(tmp_path: Path) -> None:
    """A smooth field and a noisy one under one transfer function: what each needs alone, it gets among both."""
    noise = np.random.default_rng(0).random((12, 12, 12)).astype(np.float32)
    smooth, rough = replace(Q, name="smooth"), VolumeRendering("rough", FUNCTION, field="speed")
    asked = {
        "sample_distance": None,
        "target_decibels": 46.0,
        "variations": [field_variation("smooth", appearances=["rough"])],
    }
    render(tmp_path / "a.cdb", {"q": blob(), "speed": noise}, appearances=(smooth, rough), **asked)
    found = Catalog.open(tmp_path / "a.cdb").plan.provenance
    asked["variations"] = None
    for look, data in ((smooth, blob()), (rough, noise)):
        own, _ = alone(tmp_path / f"{look.name}.cdb", data, (look,), **asked)
        assert own.plan.provenance["sample_distances"] == {look.name: found["sample_distances"][look.name]}
        assert own.plan.provenance["measured_decibels"] == {look.name: found["measured_decibels"][look.name]}
    assert found["sample_distances"]["rough"] < found["sample_distances"]["smooth"]


def test_members_may_show_one_field_only(tmp_path: Path) -> None:
    path = tmp_path / "a.cdb"
    with insitu.Session(path, **options()) as session:
        first = session.render_member(
            {"q": blob(), "speed": speed()}, {"Re": 110.0}, spacing=SPACING, appearances=["surface"]
        )
        second = session.render_member({"speed": speed()}, {"Re": 120.0}, spacing=SPACING, appearances=["surface"])
        third = session.render_member(
            {"q": blob(), "speed": np.full((12, 12, 12), np.nan)}, {"Re": 130.0}, spacing=SPACING, appearances=["dvr"]
        )
    made = Catalog.open(path)
    assert check(path) == []
    assert [list(m.summaries()) for m in made.members] == [["speed"], ["speed"], ["q"]]
    assert [list(r.ranges) for r in (first, second, third)] == [["speed"], ["speed"], ["q"]]
    assert np.array_equal(made.images(first.name, "surface"), made.images(second.name, "surface"))


def test_a_first_member_must_have_all_fields(tmp_path: Path) -> None:
    """The sample distances of all are chosen on it."""
    with (
        insitu.Session(tmp_path / "a.cdb", **options()) as session,
        pytest.raises(ValueError, match="appearance dvr shows the field 'q'"),
    ):
        session.render_member({"speed": speed()}, {"Re": 120.0}, spacing=SPACING, appearances=["surface"])
    assert list(tmp_path.iterdir()) == []


def test_holes_of_one_field_are_its_own(tmp_path: Path) -> None:
    holed = speed()
    holed[5:7, 5:7, 5:7] = np.nan
    render(tmp_path / "a.cdb", {"q": blob(), "speed": holed}, nan="transparent")
    made = Catalog.open(tmp_path / "a.cdb")
    (member,) = made.members
    whole, single = alone(tmp_path / "q.cdb", blob(), (Q,))
    assert np.array_equal(made.images(member, "dvr"), whole.images(single, "dvr"))
    kept = member.summary("speed")
    assert kept is not None
    assert kept.histogram.sum() < member.summary("q").histogram.sum()  # type: ignore[union-attr]


BAD: dict[str, tuple[Callable[[], Any], dict[str, Any], str]] = {
    "a field is missing": (lambda: {"q": blob()}, {}, "'speed', but the member has"),
    "a field too many": (lambda: {"q": blob(), "speed": speed(), "p": blob()}, {}, r"\['p'\], which no appearance"),
    "an array": (blob, {}, "without a name"),
    "another shape": (lambda: {"q": blob(), "speed": speed()[1:]}, {}, "share shape"),
    "NaN": (lambda: {"q": blob(), "speed": np.where(speed() > 3, np.nan, speed())}, {}, "field 'speed'.*NaN"),
    "nobody says which": (
        lambda: {"q": blob(), "speed": speed()},
        {"appearances": [replace(Q, field="")], "variations": None},
        "give every appearance its field|made with another plan",
    ),
    "some say which": (
        lambda: {"q": blob(), "speed": speed()},
        {"appearances": [Q, replace(SPEED, field="")], "variations": None},
        "do not: where there are several|appearances",
    ),
    "another field than the catalog's": (
        lambda: {"q": blob(), "speed": speed()},
        {"appearances": [Q, SPEED, replace(SURFACE, field="q")]},
        'appearances.surface.field: "q" here, "speed" in the catalog',
    ),
}


@pytest.mark.parametrize("case", [name for name in BAD if name != "another field than the catalog's"])
def test_bad_fields_leave_no_catalog(tmp_path: Path, case: str) -> None:
    make, changes, message = BAD[case]
    with pytest.raises((ValueError, TypeError), match=message):
        render(tmp_path / "a.cdb", make(), **changes)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("case", BAD)
def test_bad_fields_change_nothing(tmp_path: Path, case: str) -> None:
    render(tmp_path / "a.cdb", {"q": blob(), "speed": speed()})
    before = tree(tmp_path / "a.cdb")
    make, changes, message = BAD[case]
    with pytest.raises((ValueError, TypeError), match=message):
        render(tmp_path / "a.cdb", make(), 160.0, **changes)
    assert tree(tmp_path / "a.cdb") == before


# --- many members ----------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class TwoFields:
    """A blob and its speed; every call leaves a line in `log`."""

    log: str

    @property
    def identity(self) -> Mapping[str, Any]:
        return {"kind": "two"}

    @property
    def expensive(self) -> bool:
        return True

    def field(self, member: PlannedMember, progress: Callable[[float], None]) -> dict[str, Field]:
        with open(self.log, "a") as log:
            log.write(member.name + "\n")
        width = member.parameters["Re"] / 300.0
        made = {"speed": speed(width), "q": blob(width)}
        return {name: Field(values, SPACING, (0.0, 0.0, 0.0), time=2.5) for name, values in made.items()}


@pytest.mark.slow
def test_worker_processes_render_all_fields_and_keep_those_of_pilots(tmp_path: Path) -> None:
    members = [PlannedMember(f"m{i}", {"Re": re}, "train") for i, re in enumerate((110.0, 150.0, 190.0))]
    space = ParameterSpace((Parameter("Re", 100.0, 200.0),))
    options = PlanOptions(space, LOOKS, ViewPlan(frequency=1, width=16, height=16), sample_distance=0.1)
    source = TwoFields(str(tmp_path / "log"))
    result = run_ensemble(tmp_path / "a.cdb", members, source, options, workers=2, cache=tmp_path / "pilots")
    assert (len(result.rendered), result.failures) == (3, {})
    assert sorted((tmp_path / "log").read_text().split()) == ["m0", "m1", "m2"], "fields of pilots are computed once"
    made = Catalog.open(tmp_path / "a.cdb")
    assert check(made.path) == []
    assert [m.provenance["time"] for m in made.members] == [2.5] * 3
    for member in made.members:
        field = speed(member.parameters["Re"] / 300.0)
        assert member.summary("speed").maximum == float(field.max())  # type: ignore[union-attr]


def test_fields_that_are_kept_come_back_by_name(tmp_path: Path) -> None:
    made = {
        "speed / 1": Field(speed(), SPACING, (1.0, 2.0, 3.0), time=2.0),
        "q": Field(blob(), SPACING, (0, 0, 0)),
    }
    save_field(tmp_path, "a", {"x": 1}, made)
    back = load_field(tmp_path, "a", {"x": 1})
    assert isinstance(back, dict)
    assert list(back) == list(made)
    assert np.array_equal(back["speed / 1"].values, speed())
    assert (back["speed / 1"].origin, back["speed / 1"].time, back["q"].time) == ((1.0, 2.0, 3.0), 2.0, None)
    assert load_field(tmp_path, "a", {"x": 2}) is None


# --- stored ensembles ------------------------------------------------------------------------------------------------


@pytest.fixture
def stored(tmp_path: Path) -> Path:
    """Four members of three data sets, one of another shape."""
    path = tmp_path / "ensemble.h5"
    random = np.random.default_rng(0)
    with h5py.File(path, "w") as file:
        file["q"] = np.stack([blob(w) for w in (0.3, 0.4, 0.5, 0.6)])
        file["speed"] = np.stack([speed(w) for w in (0.3, 0.4, 0.5, 0.6)])
        file["coarse"] = random.random((4, 6, 6, 6))
        file["params"] = np.linspace(100.0, 200.0, 4)[:, None]
        file.attrs.update(names=["Re"], lower=[100.0], upper=[200.0], spacing=[0.1] * 3, origin=[0, 0, 0], time=3.0)
    return path


def test_several_data_sets_are_read_by_name(stored: Path) -> None:
    opened = StoredEnsemble.open(stored, FileMapping(("speed", "q")))
    found = opened.read(2)
    assert list(found) == ["speed", "q"]
    assert np.array_equal(found["speed"].values, speed(0.5))
    assert found["q"].time == 3.0
    assert opened.identity == {"kind": "hdf5", "file": "ensemble.h5", "datasets": ["speed", "q"], "contents": ANY}
    one = StoredEnsemble.open(stored, FileMapping(("q",))).identity
    assert one == {"kind": "hdf5", "file": "ensemble.h5", "dataset": "q", "contents": ANY}, "as it was: catalogs go on"
    assert "speed, q" in repr(opened)


@pytest.mark.parametrize(
    ("datasets", "message"),
    [
        (["q", "coarse"], "one shape.*coarse"),
        (["q", "p"], "'p'"),
        (["q", "q"], "each once"),
        (["params"], "axes"),
    ],
)
def test_data_sets_that_can_not_be_are_named(stored: Path, datasets: list[str], message: str) -> None:
    with pytest.raises(ValueError, match=message) as caught:
        StoredEnsemble.open(stored, FileMapping(tuple(datasets)))
    assert "ensemble.h5" in str(caught.value)


LOOK = """
[[appearance]]
kind = "isosurface"
name = "core"
field = "q"
isovalue = 0.5
[[appearance]]
kind = "isosurface"
name = "fast"
field = "speed"
isovalue = 2.0
"""


def run(*arguments: object) -> Any:
    return CliRunner().invoke(main, [str(argument) for argument in arguments])


@pytest.mark.slow
def test_a_stored_ensemble_shows_the_data_sets_that_appearances_name(stored: Path, tmp_path: Path) -> None:
    look, out = tmp_path / "look.toml", tmp_path / "out.cdb"
    look.write_text(LOOK)
    result = run("ensemble", stored, "--catalog", out, "--appearance", look, "--size", 16, "--workers", 1)
    assert result.exit_code == 0, result.output
    assert check(out) == []
    made = Catalog.open(out)
    assert made.plan.fields == ("q", "speed")
    assert made.members[3].summary("speed").maximum == float(speed(0.6).max())  # type: ignore[union-attr]
    again = run("ensemble", stored, "--catalog", out, "--workers", 1)  # the catalog knows them
    assert again.exit_code == 0, again.output
    assert "4 were there already" in again.output
    wrong = run("ensemble", stored, "--catalog", tmp_path / "b.cdb", "--appearance", look, "--dataset", "q")
    assert wrong.exit_code == 1
    assert "appearance fast shows the field 'speed', but the member has ['q']" in wrong.output
    assert not (tmp_path / "b.cdb").exists()


@pytest.mark.slow
def test_each_data_set_is_probed_and_may_be_shown_as_suggested(stored: Path, tmp_path: Path) -> None:
    both = ["--dataset", "q", "--dataset", "speed"]
    made = run("ensemble", stored, "--catalog", tmp_path / "a.cdb", *both, "--size", 16, "--workers", 1)
    assert made.exit_code == 0, made.output
    plan = Catalog.open(tmp_path / "a.cdb").plan
    assert [(a.name, a.field) for a in plan.appearances] == [("dvr-q", "q"), ("dvr-speed", "speed")]
    probed = run("probe", stored, "--array", "q", "--array", "speed", "--preview", tmp_path / "p.png")
    assert probed.exit_code == 0, probed.output
    assert probed.output.index("field q\n") < probed.output.index("field speed\n")
    assert sorted(p.name for p in tmp_path.glob("*.png")) == ["p-dvr-q.png", "p-dvr-speed.png"]
    text = probed.output[probed.output.index("[[appearance]]", probed.output.index("field speed")) :]
    (record,) = tomllib.loads(text.partition(f"\n# {tmp_path}")[0])["appearance"]
    assert appearance_from_json(record) == plan.appearances[1]
    single = run("probe", stored, "--array", "q")
    assert "field" not in single.output.replace("fields", "")
    assert 'name = "dvr"' in single.output


# --- scenes ----------------------------------------------------------------------------------------------------------


def small_scene(folder: Path, *changes: tuple[str, str]) -> Scene:
    """`tiny-fields` with fewer points, members and pictures."""
    text = (PROJECT / "scenes" / "tiny-fields.toml").read_text()
    for old, new in (
        ("resolution = 32", "resolution = 12"),
        ("time = 4.0", "time = 0.5"),
        ("train = [1500.0, 1833.0, 2167.0, 2500.0]", "train = [1500.0, 2500.0]"),
        ("[1667.0, 2333.0]", "[1667.0]"),
        ("width = 64\nheight = 64", "frequency = 1\nwidth = 16\nheight = 16"),
        ("target_decibels = 45.0", "target_decibels = 35.0"),
        *changes,
    ):
        assert old in text
        text = text.replace(old, new)
    return scene(folder, text)


def test_the_scene_of_two_fields_is_made_and_then_left_alone(tmp_path: Path) -> None:
    from insitu.simulations import simulation

    asked = small_scene(tmp_path)
    result = make_dataset(asked, tmp_path / "runs", workers=1)
    assert (result.made, result.failures) == (4, {})
    assert check(result.catalog) == []
    made = Catalog.open(result.catalog)
    assert made.plan.fields == ("q_criterion", "speed")
    assert made.plan.variations == asked.variations
    assert set(made.plan.provenance["sample_distances"]) == {"dvr", "speed-dvr"}
    for member in made.members:
        truth = simulation("taylor_green").run_fields(
            member.parameters, fields=("speed", "q_criterion"), resolution=12, time=0.5
        )
        for name, field in truth.items():
            kept = member.summary(name)
            assert kept is not None
            assert (kept.minimum, kept.maximum) == (float(field.values.min()), float(field.values.max()))
    assert make_dataset(asked, tmp_path / "runs", workers=1).made == 0
    before = tree(result.catalog)
    other = small_scene(tmp_path, ('"speed"', '"vorticity"'))
    with pytest.raises(ValueError, match=r"not the one.*appearances\.speed-dvr\.field"):
        make_dataset(other, tmp_path / "runs")
    assert tree(result.catalog) == before


@pytest.mark.parametrize(
    ("old", "new", "named"),
    [
        (
            'fields = ["q_criterion", "speed"]',
            'fields = ["q_criterion"]',
            "'speed', but the member has ['q_criterion']",
        ),
        ('fields = ["q_criterion", "speed"]', "", "'speed', but the member has ['q_criterion']"),
        ('"q_criterion", "speed"]', '"q_criterion", "speed", "vorticity"]', "['vorticity'], which no appearance shows"),
        ('"q_criterion", "speed"]', '"q_criterion", "sped"]', "['q_criterion', 'speed', 'vorticity'], each once"),
        ('"q_criterion", "speed"]', '"speed", "speed"]', "each once"),
        ('["q_criterion", "speed"]', '"speed"', "source.fields must be a list of names"),
        ('field = "speed"', 'field = "Speed"', "'Speed', but the member has"),
    ],
)
def test_fields_that_a_source_lacks_are_named_before_anything_runs(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, old: str, new: str, named: str
) -> None:
    monkeypatch.setattr("insitu.ensembles.dataset.run_ensemble", lambda *_, **__: pytest.fail("it ran"))
    with pytest.raises(ValueError, match=r"scene\.toml") as caught:
        make_dataset(small_scene(tmp_path, (old, new)), tmp_path / "runs")
    assert named in str(caught.value)
    assert not (tmp_path / "runs").exists()


def test_a_scene_of_a_file_names_its_data_sets(stored: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("GS_SURROGATE_DATA", str(tmp_path))
    text = (
        'name = "stored"\n[source]\nkind = "hdf5"\npath = "ensemble.h5"\nfields = ["speed", "q"]\n'
        f"{LOOK}[views]\nfrequency = 1\nwidth = 16\nheight = 16\n"
    )
    path, asked = tmp_path / "scene.toml", scene(tmp_path, text)
    result = make_dataset(asked, tmp_path / "runs", workers=1)
    assert (result.made, result.failures) == (4, {})
    assert Catalog.open(result.catalog).plan.fields == ("q", "speed")
    probed = run("probe", path, "--array", "speed")
    assert probed.exit_code == 0, probed.output
    assert "['speed', 'q'], got ['p']" in run("probe", path, "--array", "p").output
    with pytest.raises(ValueError, match="leave dataset out"):
        make_dataset(scene(tmp_path, text.replace("fields =", 'dataset = "q"\nfields =')), tmp_path / "other")


def test_surfaces_around_a_named_field(tmp_path: Path) -> None:
    family = isovalue_family("speed-dvr", train=(1.0, 3.0), style={"field": "speed"})
    asked = {"appearances": (SPEED, Q, *family.appearances), "variations": [family.variation]}
    render(tmp_path / "a.cdb", {"q": blob(), "speed": speed()}, **asked)
    made = Catalog.open(tmp_path / "a.cdb")
    areas = [made.images(made.members[0], name)[..., 3].mean() for name in ("iso=1", "iso=3")]
    assert areas[0] > areas[1] > 0
    assert made.plan.fields == ("speed", "q"), "the first appearance's comes first"


def test_appearances_may_come_one_by_one(tmp_path: Path) -> None:
    with insitu.Session(
        tmp_path / "a.cdb", **options(appearances=iter(LOOKS), variations=iter([VARIATION]))
    ) as session:
        session.render_member(
            {"speed": speed(), "q": blob()}, {"Re": 110.0}, spacing=SPACING, appearances=iter(["surface", "dvr"])
        )
    (member,) = Catalog.open(tmp_path / "a.cdb").members
    assert member.appearances == ("dvr", "surface")


@pytest.mark.slow
def test_data_sets_of_similar_names_are_told_apart(tmp_path: Path) -> None:
    """Their names' parts in those of appearances are the same."""
    path, names = tmp_path / "greek.h5", ("α", "β", "x" * 120)
    with h5py.File(path, "w") as file:
        for name in names:
            file[name] = np.stack([blob(w) for w in (0.3, 0.4)])
        file["params"] = np.array([[100.0], [200.0]])
        file.attrs.update(names=["Re"], lower=[100.0], upper=[200.0], spacing=[0.1] * 3, origin=[0, 0, 0])
    asked = [text for name in names for text in ("--array", name)]
    probed = run("probe", path, *asked, "--preview", tmp_path / "p.png")
    assert probed.exit_code == 0, probed.output
    assert len(list(tmp_path.glob("p-*.png"))) == 3
    asked = [text for name in names for text in ("--dataset", name)]
    made = run("ensemble", path, "--catalog", tmp_path / "a.cdb", *asked, "--size", 8, "--workers", 1)
    assert made.exit_code == 0, made.output
    assert Catalog.open(tmp_path / "a.cdb").plan.fields == names


def test_a_pilot_with_nan_is_named_with_its_field(stored: Path, tmp_path: Path) -> None:
    with h5py.File(stored, "a") as file:
        file["speed"][2, 3, 4, 5] = np.nan
    for arguments in (
        ("probe", stored, "--array", "q", "--array", "speed"),
        ("ensemble", stored, "--dataset", "speed"),
    ):
        more = ("--catalog", tmp_path / "a.cdb") if arguments[0] == "ensemble" else ()
        found = run(*arguments, *more)
        assert found.exit_code == 1
        assert "field 'speed' of member-0002: 1 of 1728 values are NaN" in found.output
    assert not (tmp_path / "a.cdb").exists()


def test_a_scene_of_images_made_elsewhere_has_nothing_to_probe() -> None:
    found = run("probe", PROJECT / "scenes" / "nyx.toml")
    assert found.exit_code == 1
    assert "nyx.toml: a source of kind nerf has no fields" in found.output
