"""Catalogs whose members have several fields: what is recorded, shown and checked, and what older programs make of it."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from catalogs.browse.page import describe as page_data
from catalogs.files import cinema
from catalogs.store.catalog import Catalog, CatalogError
from catalogs.store.members import Member
from catalogs.store.plan import CatalogPlan
from catalogs.tools.check import check
from catalogs.tools.show import describe
from catalogs.vocabulary.appearance import Isosurface, VolumeRendering
from catalogs.vocabulary.variations import field_variation
from tests.catalogs.conftest import make_plan, picture, summary
from tests.support.transfer_functions import BASE, FUNCTION, FUNCTIONS

Q = VolumeRendering("dvr", FUNCTION, field="q")
SPEED = VolumeRendering("speed-dvr", FUNCTION, field="speed")
SURFACE = Isosurface("surface", 0.25, field="speed")
FIELDS = field_variation("dvr", appearances=["speed-dvr", "surface"])


def fields_plan(**changes: Any) -> CatalogPlan:
    return make_plan(**{"appearances": (Q, SPEED, SURFACE), "variations": (FIELDS,), **changes})


def add(catalog: Catalog, name: str, reynolds: float, shown: list[str], kept: dict[str, int] | None) -> Member:
    """Write a member that shows some appearances and keeps summaries of some fields, by seed."""
    with catalog.begin_member(name, {"Re": reynolds, "Pr": 1.0}, appearances=shown) as writer:
        for number, (appearance, view) in enumerate(writer.missing()):
            writer.write_image(appearance, view, picture(number))
        if kept is not None:
            writer.write_summaries({field: summary(seed) for field, seed in kept.items()})
    return catalog.member(name)


@pytest.fixture
def fields(tmp_path: Path) -> Catalog:
    """A member of two fields, and one that shows only the second."""
    made = Catalog.create(tmp_path / "fields.cdb", fields_plan())
    add(made, "both", 120.0, ["dvr", "speed-dvr", "surface"], {"q": 1, "speed": 2})
    add(made, "one", 180.0, ["surface"], {"speed": 3})
    return made


def test_a_plan_knows_its_fields_and_reads_itself(fields: Catalog) -> None:
    plan = Catalog.open(fields.path).plan
    assert plan.fields == ("q", "speed")
    assert plan.differences(fields_plan()) == []
    assert plan.appearances == (Q, SPEED, SURFACE)
    assert plan.variations == (FIELDS,)
    assert plan.plain_appearances == plan.appearances
    other = fields_plan(appearances=(Q, SPEED, replace(SURFACE, field="q")))
    assert plan.differences(other) == ["appearances"]
    assert make_plan().fields == ("",)


def test_the_table_has_no_column_for_what_the_appearance_says(fields: Catalog) -> None:
    header, rows = cinema.parse((fields.path / "data.csv").read_bytes().decode())
    assert header == ["Re", "Pr", "appearance", "isovalue", *header[4:]]
    assert header[4:] == ["member", "view", "phi", "theta", "split", "member_split", "view_split", "FILE"]
    assert cinema.column_problems(header, rows) == []
    both = fields_plan(
        appearances=(*(replace(a, field="q") for a in (BASE, *FUNCTIONS.appearances)), SPEED, SURFACE),
        variations=(FUNCTIONS.variation, FIELDS),
    )
    assert both.varied_names == ["isovalue", *FUNCTIONS.variation.space.names]
    assert both.varied("speed-dvr") == dict.fromkeys(both.varied_names, 0.0)
    assert [a.name for a in both.plain_appearances] == ["dvr", "speed-dvr", "surface"]


def test_summaries_are_found_by_field(fields: Catalog) -> None:
    both, one = fields.member("both"), fields.member("one")
    for member, field, seed in ((both, "q", 1), (both, "speed", 2), (both, "", 1), (one, "speed", 3), (one, "", 3)):
        kept = member.summary(field)
        assert kept is not None
        assert kept.points.tolist() == summary(seed).points.tolist()
    assert one.summary("q") is both.summary("pressure") is None
    assert list(both.summaries()) == ["q", "speed"]


def test_the_only_field_needs_no_name(tmp_path: Path) -> None:
    made = Catalog.create(tmp_path / "a.cdb", make_plan(appearances=(SPEED,)))
    with made.begin_member("first", {"Re": 120.0, "Pr": 1.0}) as writer:
        for appearance, view in writer.missing():
            writer.write_image(appearance, view, picture(view))
        writer.write_summaries({"": summary(1)})
    (member,) = made.members
    assert member.summary("speed") is not None
    assert member.summary() is not None
    assert list(member.summaries()) == [""]
    assert check(made.path) == []


MIXED: dict[str, tuple[dict[str, Any], str]] = {
    "some do not say": ({"appearances": (Q, SPEED, replace(SURFACE, field=""))}, r"surface do not"),
    "an absent appearance": ({"appearances": (Q, SPEED)}, "unknown: surface"),
    "two of a kind": (
        {
            "variations": (
                field_variation("dvr", appearances=["speed-dvr"]),
                field_variation("dvr", appearances=["surface"]),
            )
        },
        "one variation of each kind",
    ),
    "functions of another field": (
        {
            "appearances": (replace(BASE, field="q"), *(replace(a, field="speed") for a in FUNCTIONS.appearances)),
            "variations": (FUNCTIONS.variation,),
        },
        "dvr-train-01 shows the field 'speed', its base 'q'",
    ),
}


@pytest.mark.parametrize("case", MIXED)
def test_fields_that_do_not_fit_are_refused(case: str) -> None:
    changes, message = MIXED[case]
    with pytest.raises(CatalogError, match=message):
        fields_plan(**changes)


@pytest.mark.parametrize("kept", [{"q": 1}, {"q": 1, "speed": 2, "p": 3}])
def test_a_sidecar_of_other_fields_is_found(fields: Catalog, kept: dict[str, int]) -> None:
    assert check(fields.path) == []
    add(fields, "third", 150.0, ["dvr", "surface"], kept)
    (finding,) = check(fields.path)
    assert str(finding) == (f"member third: field.npz is of the fields {list(kept)}, the images of ['q', 'speed']")


def test_a_member_without_a_sidecar_is_as_good_as_ever(fields: Catalog) -> None:
    assert add(fields, "third", 150.0, ["dvr"], None).summary("q") is None
    assert check(fields.path) == []


def test_it_is_shown_which_field_is_which(fields: Catalog) -> None:
    shown = describe(fields.path)
    for text in (
        "dvr: volume rendering of q over [0, 1], unshaded",
        "speed-dvr: volume rendering of speed over [0, 1], unshaded",
        "surface: isosurface of speed at 0.25",
        "field: dvr, or speed-dvr, surface",
        "q minimum  q maximum  q clipped  speed minimum  speed maximum  speed clipped",
    ):
        assert text in shown, shown
    rows = [" ".join(line.split()) for line in shown.splitlines()]
    assert "both train 120 1 12 0 1 1.00 % 0 1 1.00 %" in rows
    assert "one train 180 1 12 - - - 0 1 1.00 %" in rows


def test_the_page_names_the_field(fields: Catalog) -> None:
    titles = {appearance["name"]: appearance["title"] for appearance in page_data(fields)["appearances"]}
    assert titles == {
        "dvr": "dvr (q)",
        "speed-dvr": "speed-dvr (speed)",
        "surface": "surface (speed, isovalue 0.25)",
    }
