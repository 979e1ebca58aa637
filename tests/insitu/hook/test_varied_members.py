"""Members rendered under many transfer functions and isovalues: which, how exactly, and what is refused."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
from click.testing import CliRunner

import insitu
from catalogs.store.catalog import Catalog, CatalogError
from catalogs.tools.check import check
from catalogs.vocabulary.appearance import Isosurface, TransferFunction, VolumeRendering
from catalogs.vocabulary.parameters import Parameter, ParameterSpace
from catalogs.vocabulary.scene import PlannedMember, ViewPlan
from catalogs.vocabulary.variations import isovalue_family, transfer_function_family
from insitu.cli import main
from insitu.ensembles.dataset import make_dataset
from insitu.fields.location import FieldLocation
from insitu.fields.member_fields import as_fields
from insitu.members.agreement import disagreements, misplaced
from insitu.members.planning import Pilot, PlanOptions, measure_pilot, plan_catalog
from tests.support.hooked import blob, tree
from tests.support.scenes import REYNOLDS, SIMULATED, scene

pytestmark = pytest.mark.usefixtures("prepared_workers")

FUNCTION = TransferFunction(
    ((0.0, 0.0, 0.0, 1.0), (1.0, 1.0, 0.0, 0.0)), ((0.0, 0.0), (0.3, 0.2), (0.6, 0.5), (1.0, 1.0)), 0.3
)
BASE = VolumeRendering("dvr", FUNCTION)
FUNCTIONS = transfer_function_family(BASE, first_step=(0.1, 0.1), second_step=(0.1, 0.25), validation=1, test=1)
ISOVALUES = isovalue_family("dvr", train=(0.2, 0.8), test=(0.5,))
SPACE = ParameterSpace((Parameter("Re", 100.0, 200.0),))
SPACING = (0.1, 0.1, 0.1)
SOME = ("dvr", "dvr-train-20", "iso=0.5")


def options(**changes: Any) -> dict[str, Any]:
    """Arguments of `insitu.Session`: one base, 78 transfer functions and 3 isovalues."""
    values: dict[str, Any] = {
        "space": SPACE,
        "appearances": (BASE, *FUNCTIONS.appearances, *ISOVALUES.appearances),
        "variations": (FUNCTIONS.variation, ISOVALUES.variation),
        "views": ViewPlan(frequency=1, width=16, height=16),
        "sample_distance": 0.1,
    }
    return {**values, **changes}


@pytest.fixture
def varied(tmp_path: Path) -> Path:
    """A catalog of one member that shows three appearances."""
    path = tmp_path / "a.cdb"
    with insitu.Session(path, **options()) as session:
        session.render_member(blob(), {"Re": 110.0}, spacing=SPACING, appearances=SOME)
    return path


@pytest.mark.slow
def test_a_member_is_rendered_with_what_it_is_to_show(varied: Path) -> None:
    done: list[int] = []
    with insitu.Session(varied, progress=done.append) as session:
        few = session.render_member(blob(), {"Re": 120.0}, spacing=SPACING, appearances=["iso=0.5"])
        everything = session.render_member(blob(), {"Re": 130.0}, spacing=SPACING)
    assert (few.images, everything.images) == (12, 82 * 12)
    assert done == [*range(1, 13), *range(1, 82 * 12 + 1)]
    made = Catalog.open(varied)
    assert check(varied) == []
    first, second, third = made.members
    assert (first.appearances, second.appearances) == (SOME, ("iso=0.5",))
    assert len(third.appearances) == 82
    for name in SOME:
        assert np.array_equal(made.images(first, name), made.images(third, name))
    assert np.array_equal(made.images(first, "iso=0.5"), made.images(second, "iso=0.5"))


def test_a_setting_is_what_its_transfer_function_shows(tmp_path: Path) -> None:
    """Pictures of a setting equal those of a catalog in which it is an appearance of its own."""
    first = tmp_path / "a.cdb"
    with insitu.Session(first, **options()) as session:
        session.render_member(blob(), {"Re": 110.0}, spacing=SPACING, appearances=["dvr-train-20", "dvr"])
    alone = replace(FUNCTIONS.appearances[19], name="alone")
    insitu.render_member(
        blob(),
        {"Re": 110.0},
        catalog=tmp_path / "b.cdb",
        **options(appearances=alone, variations=None),
        spacing=SPACING,
    )
    one, other = Catalog.open(first), Catalog.open(tmp_path / "b.cdb")
    (member,), (same,) = one.members, other.members
    assert np.array_equal(one.images(member, "dvr-train-20"), other.images(same, "alone"))
    assert not np.array_equal(one.images(member, "dvr"), other.images(same, "alone"))


def test_one_call_renders_all_settings(tmp_path: Path) -> None:
    family = isovalue_family("dvr", train=(0.2, 0.8), test=(0.5,))
    asked = options(appearances=(BASE, *family.appearances), variations=[family.variation])
    result = insitu.render_member(blob(), {"Re": 110.0}, catalog=tmp_path / "a.cdb", spacing=SPACING, **asked)
    assert result.images == 4 * 12
    made = Catalog.open(tmp_path / "a.cdb")
    assert made.plan.variations == (family.variation,)
    areas = [made.images(made.members[0], f"iso={v:g}")[..., 3].mean() for v in (0.2, 0.5, 0.8)]
    assert areas == sorted(areas, reverse=True), "the blob's surface shrinks as the isovalue grows"


def test_points_of_the_field_are_kept_by_the_base_and_the_isosurfaces(varied: Path) -> None:
    """Of the 78 other transfer functions none gets a share of its own: 4000 points over four appearances."""
    kept = Catalog.open(varied).members[0].summary()
    assert kept is not None
    assert len(kept.points) == 4000
    at = {value: int(np.isclose(kept.point_values, value, rtol=0, atol=1e-6).sum()) for value in (0.2, 0.5, 0.8)}
    assert at == {0.2: 1000, 0.5: 1000, 0.8: 1000}
    rest = ~np.isclose(kept.point_values[:, None], (0.2, 0.5, 0.8), rtol=0, atol=1e-6).any(axis=1)
    np.testing.assert_allclose(kept.point_opacities[rest], FUNCTION.opacities(kept.point_values[rest]), atol=1e-6)


@pytest.mark.parametrize(("names", "message"), [(["dvr-train-99"], "dvr-train-99"), ([], "none")])
def test_unknown_appearances_are_refused_and_nothing_is_written(
    varied: Path, tmp_path: Path, names: list[str], message: str
) -> None:
    before = tree(varied)
    for path, asked in ((varied, {}), (tmp_path / "new.cdb", options())):
        with (
            insitu.Session(path, **asked) as session,
            pytest.raises(CatalogError, match=f"82 in all.*got {message}"),
        ):
            session.render_member(blob(), {"Re": 120.0}, spacing=SPACING, appearances=names)
    assert tree(varied) == before
    assert not (tmp_path / "new.cdb").exists()


def test_variations_that_do_not_fit_are_refused_before_anything_is_written(tmp_path: Path) -> None:
    for changes, message in (
        ({"appearances": (BASE, *FUNCTIONS.appearances)}, r"unknown: iso=0\.2, iso=0\.5, iso=0\.8"),
        ({"appearances": (BASE, *FUNCTIONS.appearances, *shifted())}, r"iso=0\.2 does not show"),
    ):
        with pytest.raises(CatalogError, match=message):
            insitu.render_member(
                blob(), {"Re": 1.1e2}, catalog=tmp_path / "a.cdb", spacing=SPACING, **options(**changes)
            )
    assert list(tmp_path.iterdir()) == []


def shifted() -> list[Any]:
    return [Isosurface(a.name, a.isovalue + 0.01) for a in ISOVALUES.appearances if isinstance(a, Isosurface)]


def test_other_variations_than_the_catalogs_are_named(varied: Path) -> None:
    before = tree(varied)
    isovalues = replace(
        ISOVALUES.variation,
        settings=(*ISOVALUES.variation.settings[:2], replace(ISOVALUES.variation.settings[2], split="validation")),
    )
    for variations, message in (
        ((FUNCTIONS.variation, isovalues), 'variations.1.settings.2.split: "validation" here, "test" in the catalog'),
        ((FUNCTIONS.variation,), "variations: "),
        ((), r"variations: \[\] here"),
    ):
        with pytest.raises(ValueError, match=message):
            insitu.Session(varied, variations=variations)
    assert insitu.Session(varied, variations=(FUNCTIONS.variation, ISOVALUES.variation)).catalog is not None
    assert insitu.Session(varied).catalog is not None, "what is left out is the catalog's"
    assert tree(varied) == before


def test_a_plan_with_variations_agrees_with_its_wishes() -> None:
    asked = PlanOptions(**options(bounds=((0, 0, 0), (1, 1, 1))))
    plan = plan_catalog(Pilot(((0, 0, 0), (1, 1, 1)), {"": (0.0, 1.0)}), asked)
    assert disagreements(plan, asked) == []
    assert disagreements(plan, replace(asked, variations=None)) == []
    assert disagreements(plan, replace(asked, variations=()))[0].startswith("variations: [] here")


def test_a_variation_is_sampled_as_finely_as_its_measured_settings_need(monkeypatch: pytest.MonkeyPatch) -> None:
    """Few settings are measured; every one of the family, the base included, takes the finest distance among them."""
    from render import quality

    measured: dict[str, float] = {}
    choose = quality.choose_sample_distance

    def remember(grid: Any, appearance: VolumeRendering, *rest: Any, **how: Any) -> Any:
        chosen = choose(grid, appearance, *rest, **how)
        measured[appearance.name] = chosen.distance
        return chosen

    monkeypatch.setattr(quality, "choose_sample_distance", remember)
    other = replace(BASE, name="other")
    appearances = (BASE, other, *ISOVALUES.appearances, *FUNCTIONS.appearances)
    variations = (ISOVALUES.variation, FUNCTIONS.variation)
    asked = PlanOptions(
        **options(appearances=appearances, variations=variations, sample_distance=None, target_decibels=35.0)
    )
    pilot = measure_pilot(as_fields(blob(), appearances, FieldLocation(spacing=SPACING)), asked)
    assert 5 <= len(measured) <= 10
    assert {"dvr", "other"} < set(measured)
    assert set(pilot.distances) == {a.name for a in appearances if a not in ISOVALUES.appearances}
    distances = {name: found.distance for name, found in pilot.distances.items()}
    family = {"dvr", *FUNCTIONS.variation.named("train", "validation", "test")}
    finest = min(distance for name, distance in measured.items() if name in family)
    assert {distances[name] for name in family} == {finest}
    assert distances["other"] == measured["other"]
    assert plan_catalog(pilot, asked).provenance["sample_distances"] == distances


def test_a_stored_member_that_shows_something_else_is_named(varied: Path) -> None:
    stored = Catalog.open(varied)
    (member,) = stored.members

    def planned(appearances: tuple[str, ...] | None) -> list[PlannedMember]:
        return [PlannedMember(member.name, member.parameters, member.split, appearances)]

    assert misplaced(stored, planned(SOME)) == misplaced(stored, planned(None)) == []
    assert misplaced(stored, planned(SOME[::-1])) == []
    (difference,) = misplaced(stored, planned(("dvr", "iso=0.2")))
    assert difference == f"{member.name} appearances: iso=0.2 only here, dvr-train-20, iso=0.5 only in the catalog"
    (difference,) = misplaced(stored, planned(tuple(stored.appearance_names)))
    assert "(79 in all) only here, none only in the catalog" in difference


SCENE = f"""
name = "flow"
{SIMULATED}resolution = 12
time = 0.2
{REYNOLDS}[members]
train = [100.0, 130.0, 170.0, 200.0]
validation = [120.0]
test = [150.0]
[[appearance]]
kind = "volume"
name = "dvr"
[appearance.transfer_function]
color_points = [[-1.0, 0.0, 0.0, 1.0], [1.0, 1.0, 0.0, 0.0]]
opacity_points = [[-1.0, 0.0], [-0.2, 0.2], [0.3, 0.5], [1.0, 1.0]]
opacity_unit_distance = 2.0
[[variation]]
kind = "transfer_function"
of = "dvr"
first_step = [0.1, 0.1]
second_step = [0.1, 0.1]
validation = 2
test = 1
members = 0.25
compared = 4
[[variation]]
kind = "isovalue"
of = "dvr"
train = [-0.1, 0.1]
test = [0.0]
[views]
frequency = 1
width = 8
height = 8
[render]
sample_distance = 0.5
"""


@pytest.mark.slow
def test_the_members_of_a_scene_show_what_they_are_assigned(tmp_path: Path) -> None:
    asked = scene(tmp_path, SCENE)
    result = make_dataset(asked, tmp_path / "runs", workers=1)
    assert (result.made, result.failures) == (6, {})
    assert check(result.catalog) == []
    made = Catalog.open(result.catalog)
    assert made.plan.variations == asked.variations
    assigned = {m.name: m.appearances for m in asked.assigned(asked.members)}
    for member in made.members:
        assert set(member.appearances) == set(assigned[member.name] or ())
    counts = {m.name: len(m.appearances) for m in made.members}
    assert sorted(counts[f"train-00{i}"] for i in range(4)) == [4, 4, 4, 81]
    assert (counts["validation-000"], counts["test-000"]) == (3, 1 + 5 + 3)
    assert make_dataset(asked, tmp_path / "runs", workers=1).made == 0
    before = tree(result.catalog)
    for old, new, named in (
        ("members = 0.25", "members = 0.5", "appearances: dvr-test-01"),
        ("compared = 4", "compared = 5", "test-000 appearances: "),
        ("test = [0.0]", "test = [0.05]", "variations.1.settings.2"),
        (SCENE[SCENE.index("[[variation]]") : SCENE.index("[views]")], "", "variations: [] here"),
    ):
        with pytest.raises(ValueError, match="not the one") as caught:
            make_dataset(scene(tmp_path, SCENE.replace(old, new, 1)), tmp_path / "runs")
        assert named in str(caught.value)
    assert tree(result.catalog) == before


@pytest.mark.slow
def test_a_stored_ensemble_shown_as_a_scene_says(tmp_path: Path) -> None:
    path = tmp_path / "ensemble.h5"
    with h5py.File(path, "w") as file:
        file["field"] = np.random.default_rng(0).uniform(-1, 1, (5, 6, 7, 8)).astype(np.float16)
        file["params"] = np.linspace(100.0, 200.0, 5)[:, None]
        file["split"] = np.array(["train"] * 4 + ["test"], dtype="S")
        file.attrs.update(names=["Re"], lower=[100.0], upper=[200.0], spacing=[1, 1, 1], origin=[0, 0, 0])
    asked = scene(tmp_path, SCENE)
    out = tmp_path / "out.cdb"
    arguments = ["ensemble", str(path), "--catalog", str(out), "--scene", str(asked.path), "--validation", "1"]
    result = CliRunner().invoke(main, [*arguments, "--workers", "1"])
    assert result.exit_code == 0, result.output
    assert check(out) == []
    counts = {m.split: set[int]() for m in Catalog.open(out).members}
    for member in Catalog.open(out).members:
        counts[member.split].add(len(member.appearances))
    assert counts == {"train": {4, 81}, "validation": {3}, "test": {9}}
    again = CliRunner().invoke(main, [*arguments, "--workers", "1"])
    assert again.exit_code == 0, again.output
    assert "5 were there already" in again.output
