"""Members of several fields, end to end: each field looks, is measured and is kept as if it were alone."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import insitu
from catalogs.store.catalog import Catalog
from catalogs.store.members import Member
from catalogs.tools.check import check
from catalogs.vocabulary.appearance import (
    Appearance,
    Isosurface,
    TransferFunction,
    VolumeRendering,
)
from catalogs.vocabulary.parameters import Parameter, ParameterSpace
from catalogs.vocabulary.scene import PlannedMember, ViewPlan
from catalogs.vocabulary.variations import field_variation, isovalue_family
from insitu.ensembles.ensemble import run_ensemble
from insitu.fields.cache import load_field, save_field
from insitu.fields.field import Field
from insitu.fields.summarize import value_range_of
from insitu.members.planning import PlanOptions
from tests.support.hooked import FUNCTION, SPACING, blob, speed, tree

WIDE = TransferFunction(((0.0, 0.0, 1.0, 0.0), (8.0, 1.0, 0.0, 1.0)), ((1.0, 0.0), (8.0, 0.9)), 0.2)
Q = VolumeRendering("dvr", FUNCTION, field="q")
SPEED = VolumeRendering("speed-dvr", WIDE, field="speed")
SURFACE = Isosurface("surface", 4.0, field="speed")
LOOKS = (Q, SPEED, SURFACE)
VARIATION = field_variation("dvr", appearances=["speed-dvr", "surface"])


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
    "a field too many": (lambda: {"q": blob(), "speed": speed(), "p": blob()}, {}, r"p, which no appearance"),
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
