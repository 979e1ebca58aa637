"""Catalogs whose appearances sample visualization parameters, and members that show some of them."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from catalogs.files import cinema
from catalogs.store.catalog import Catalog, CatalogError
from catalogs.store.members import known_appearances
from catalogs.store.plan import CatalogPlan
from catalogs.tools.check import check
from catalogs.tools.show import describe
from catalogs.vocabulary.appearance import Isosurface
from catalogs.vocabulary.variations import POINT_PARAMETERS, isovalue_family
from tests.catalogs.conftest import make_plan, picture, rewrite_record, summary
from tests.support.transfer_functions import BASE, FUNCTIONS, OLD_CATALOG

ISOVALUES = isovalue_family("dvr", train=(0.2, 0.4, 0.8), validation=(0.3,), test=(0.5,))
SOME = ("dvr", "dvr-train-07", "dvr-train-66", "dvr-test-02", "iso=0.4", "iso=0.5", "iso=0.3")


def varied_plan(**changes: Any) -> CatalogPlan:
    """A plan of one base, 79 transfer functions and 5 isovalues around it, and one more isosurface."""
    values: dict[str, Any] = {
        "appearances": (BASE, *FUNCTIONS.appearances, *ISOVALUES.appearances, Isosurface("plain", 0.25)),
        "variations": (FUNCTIONS.variation, ISOVALUES.variation),
    }
    return make_plan(**{**values, **changes})


def add_some(
    catalog: Catalog, name: str, reynolds: float, appearances: Sequence[str] | None, split: str = "train"
) -> None:
    """Write a member that shows some of the catalog's appearances."""
    with catalog.begin_member(name, {"Re": reynolds, "Pr": 1.0}, split=split, appearances=appearances) as writer:
        for number, (appearance, view) in enumerate(writer.missing()):
            writer.write_image(appearance, view, picture(number))
        writer.write_summaries({"": summary()})


@pytest.fixture
def varied(tmp_path: Path) -> Catalog:
    """Two members, one that shows seven appearances and one that shows the base alone."""
    made = Catalog.create(tmp_path / "varied.cdb", varied_plan())
    add_some(made, "some", 120.0, SOME)
    add_some(made, "base", 180.0, ["dvr"], split="test")
    return made


def table(catalog: Catalog) -> list[dict[str, str]]:
    header, rows = cinema.parse((catalog.path / "data.csv").read_bytes().decode())
    return [dict(zip(header, row, strict=True)) for row in rows]


def test_a_member_shows_what_it_was_begun_with(varied: Catalog) -> None:
    again = Catalog.open(varied.path)
    assert again.plan.differences(varied_plan()) == []
    assert again.plan.variations == varied_plan().variations
    some = again.member("some")
    assert some.appearances == tuple(n for n in again.appearance_names if n in SOME), "in the plan's order"
    assert again.member("base").appearances == ("dvr",)
    assert sorted(p.name for p in some.path.iterdir() if p.is_dir()) == sorted(SOME)
    assert np.array_equal(again.images(some, "dvr"), np.stack([picture(view) for view in range(12)]))
    assert json.loads((some.path / "member.json").read_text())["appearances"] == list(some.appearances)


def test_only_what_a_member_shows_can_be_missing(varied: Catalog) -> None:
    before = sorted(varied.path.rglob("*"))
    writer = varied.begin_member("third", {"Re": 150.0, "Pr": 1.0}, appearances=("iso=0.4", "dvr"))
    assert writer.missing() == [(name, view) for name in ("dvr", "iso=0.4") for view in range(12)]
    with pytest.raises(CatalogError, match=r"no appearance 'plain'; the member has dvr, iso=0\.4"):
        writer.write_image("plain", 0, picture(0))
    with pytest.raises(CatalogError, match=r"lacks 23 images, first \('dvr', 1\)"), writer:
        writer.write_image("dvr", 0, picture(0))
    assert sorted(varied.path.rglob("*")) == before


@pytest.mark.parametrize(
    ("names", "message"),
    [
        ((), "got none"),
        (("dvr", "other"), "which are dvr, dvr-train-01, .*86 in all.*got other"),
        ("other", "got other"),
    ],
)
def test_unknown_appearances_are_refused(varied: Catalog, names: Any, message: str) -> None:
    before = sorted(varied.path.rglob("*"))
    with pytest.raises(CatalogError, match=message):
        varied.begin_member("third", {"Re": 150.0, "Pr": 1.0}, appearances=names)
    assert sorted(varied.path.rglob("*")) == before


def test_one_name_is_one_appearance_and_none_are_all() -> None:
    assert known_appearances("dvr", ["dvr", "d", "v", "r"]) == ("dvr",)
    assert known_appearances(None, ["b", "a"]) == ("b", "a")
    assert known_appearances(["a", "b", "a"], ["b", "a"]) == ("b", "a")


def test_a_member_of_all_appearances_says_nothing_of_them(tmp_path: Path) -> None:
    made = Catalog.create(tmp_path / "all.cdb", make_plan())
    add_some(made, "all", 120.0, ["iso", "dvr"])
    assert "appearances" not in json.loads((made.path / "members/all/member.json").read_text())
    assert made.member("all").appearances == ("dvr", "iso")


def test_an_image_that_a_member_does_not_show_is_told_from_a_lost_one(varied: Catalog) -> None:
    with pytest.raises(CatalogError, match=r"member base of .*varied\.cdb does not show 'iso=0\.4'; it shows dvr$"):
        varied.image("base", "iso=0.4", 0)
    with pytest.raises(CatalogError, match="does not show 'plain'"):
        varied.images("some", "plain")


def test_nothing_is_wrong_with_it_until_a_file_is_gone(varied: Catalog) -> None:
    assert check(varied.path) == []
    varied.image_path("some", "iso=0.5", 3).unlink()
    (finding,) = check(varied.path)
    assert finding.problem == "members/some/iso=0.5/003.png is missing"


def test_a_member_that_claims_more_than_it_has_is_found(varied: Catalog) -> None:
    shown = json.loads((varied.path / "members/base/member.json").read_text())["appearances"]
    rewrite_record(varied.path / "members/base", appearances=[*shown, "plain"])
    problems = [str(finding) for finding in check(varied.path)]
    assert any("rows.csv differs from what member.json" in problem for problem in problems)
    assert sum("members/base/plain/" in problem and "missing" in problem for problem in problems) == 12


@pytest.mark.parametrize("appearances", [[], ["none"], 5, [["dvr"]]])
def test_a_damaged_list_of_appearances_is_named(varied: Catalog, appearances: Any) -> None:
    path = varied.path / "members/base/member.json"
    path.write_text(json.dumps({**json.loads(path.read_text()), "appearances": appearances}))
    with pytest.raises(CatalogError, match=r"base/member\.json is damaged"):
        varied.member("base")
    assert any("base" in finding.place for finding in check(varied.path))


def test_the_table_has_a_column_per_visualization_parameter(varied: Catalog) -> None:
    header, rows = cinema.parse((varied.path / "data.csv").read_bytes().decode())
    views = ["member", "view", "phi", "theta", "split", "member_split", "view_split", "FILE"]
    assert header == ["Re", "Pr", "appearance", "isovalue", *POINT_PARAMETERS, *views]
    assert cinema.header_problems(header) == cinema.column_problems(header, rows) == []
    assert len(rows) == (len(SOME) + 1) * 12
    assert all((varied.path / row[-1]).is_file() for row in rows)
    of = {row["appearance"]: row for row in table(varied) if row["member"] == "some"}
    parameters = {name: [float(row[p]) for p in ("isovalue", *POINT_PARAMETERS)] for name, row in of.items()}
    assert set(parameters) == set(SOME)
    assert parameters["dvr"] == [0.0] * 5
    assert parameters["iso=0.4"] == [0.4, 0.0, 0.0, 0.0, 0.0]
    assert parameters["dvr-train-66"] == pytest.approx([0.0, 0.05, 0.0, 0.0, 0.0])
    moved = FUNCTIONS.variation.setting("dvr-train-07")
    assert moved is not None
    assert parameters["dvr-train-07"] == [0.0, *moved.values]


def test_an_image_is_for_training_only_if_its_setting_is_too(varied: Catalog) -> None:
    of = {(row["member"], row["appearance"], int(row["view"])): row["split"] for row in table(varied)}
    assert of["some", "dvr", 1] == of["some", "dvr-train-07", 1] == of["some", "iso=0.4", 1] == "train"
    assert of["some", "iso=0.3", 1] == "validation"
    assert of["some", "dvr-test-02", 1] == of["some", "iso=0.5", 1] == "test"
    assert of["some", "iso=0.3", 0] == of["some", "dvr", 0] == "test", "a view for testing"
    assert of["some", "dvr-train-07", 9] == "validation", "a view for validation"
    assert of["base", "dvr", 1] == "test", "a member for testing"


def test_a_plan_knows_what_varies() -> None:
    plan = varied_plan()
    assert plan.varied_names == ["isovalue", *POINT_PARAMETERS]
    assert [a.name for a in plan.plain_appearances] == ["dvr", "plain"]
    assert plan.setting("dvr") is plan.setting("plain") is None
    setting = plan.setting("iso=0.5")
    assert setting is not None
    assert setting.split == "test"
    assert plan.varied("iso=0.5") == {**dict.fromkeys(POINT_PARAMETERS, 0.0), "isovalue": 0.5}
    read = CatalogPlan.from_json(json.loads(json.dumps(plan.to_json())))
    assert (read.appearances, read.variations) == (plan.appearances, plan.variations)


def test_plans_differ_by_their_variations(varied: Catalog) -> None:
    plan, fewer = varied_plan(), varied_plan(variations=(FUNCTIONS.variation,))
    without = varied_plan(variations=())
    assert plan.differences(varied_plan()) == []
    assert plan.differences(fewer) == fewer.differences(plan) == ["variations"]
    assert plan.differences(without) == without.differences(plan) == ["variations"]
    assert "variations" not in without.to_json()
    with pytest.raises(CatalogError, match="made with other variations"):
        Catalog.create(varied.path, without)


SWAPPED = (BASE, replace(FUNCTIONS.appearances[1], name="dvr-train-01"), *FUNCTIONS.appearances[1:])
MISMATCHED: dict[str, tuple[dict[str, Any], str]] = {
    "absent settings": (
        {"appearances": (BASE, *ISOVALUES.appearances)},
        r"unknown: dvr-test-01, .* \(79 in all\)",
    ),
    "absent base": ({"appearances": FUNCTIONS.appearances, "variations": (FUNCTIONS.variation,)}, "unknown: dvr"),
    "two of a kind": ({"variations": (FUNCTIONS.variation, FUNCTIONS.variation)}, "one variation of each kind"),
    "another transfer function": (
        {"appearances": SWAPPED, "variations": (FUNCTIONS.variation,)},
        "dvr-train-01 does not show",
    ),
    "another isovalue": (
        {
            "appearances": (BASE, Isosurface("iso=0.2", 0.21), *ISOVALUES.appearances[1:]),
            "variations": (ISOVALUES.variation,),
        },
        r"iso=0\.2 does not show \{'isovalue': 0\.2\}",
    ),
    "a setting twice": (
        {
            "variations": (
                replace(ISOVALUES.variation, settings=(*ISOVALUES.variation.settings, ISOVALUES.variation.settings[4])),
            )
        },
        r"repeated: iso=0\.5",
    ),
}


@pytest.mark.parametrize("case", MISMATCHED)
def test_variations_and_appearances_must_fit(case: str) -> None:
    changes, message = MISMATCHED[case]
    with pytest.raises(CatalogError, match=message):
        varied_plan(**changes)


def test_a_parameter_of_the_simulation_can_not_have_a_varied_name(tmp_path: Path) -> None:
    from catalogs.vocabulary.parameters import Parameter, ParameterSpace

    with pytest.raises(CatalogError, match="'c1_value' has the name of a visualization parameter"):
        varied_plan(space=ParameterSpace((Parameter("c1_value", 0.0, 1.0),)))


def test_it_is_shown_in_a_few_lines(varied: Catalog) -> None:
    shown = describe(varied.path)
    for text in (
        "dvr: volume rendering",
        "plain: isosurface at 0.25",
        "transfer_function of dvr: 79 settings (76 train, 1 validation, 2 test), c1_value in [-0.1, 0.1]",
        "isovalue of dvr: 5 settings (3 train, 1 validation, 1 test), isovalue in [0.2, 0.8]",
        "96 of 16x12",
    ):
        assert text in shown, shown
    assert "dvr-train-07" not in shown
    assert "(86 in all)" in repr(varied)


OLD_MEMBER = """{
 "name": "first",
 "parameters": {"Re": 120.0},
 "split": "train",
 "own_cameras": false,
 "view_splits": ["train"],
 "provenance": {"time": 2.5}
}"""
OLD_TABLE = (
    "Re,appearance,isovalue,member,view,phi,theta,split,member_split,view_split,FILE\r\n"
    "120.0,dvr,0.0,first,0,0.0,180.0,train,train,train,members/first/dvr/000.png\r\n"
    "120.0,iso,0.25,first,0,0.0,180.0,train,train,train,members/first/iso/000.png\r\n"
)


@pytest.fixture
def old(tmp_path: Path) -> Path:
    """A catalog of the oldest schema that is read, literally."""
    from catalogs.files.images import write_image

    path = tmp_path / "old.cdb"
    member = path / "members" / "first"
    for number, appearance in enumerate(("dvr", "iso")):
        (member / appearance).mkdir(parents=True)
        write_image(member / appearance / "000.png", picture(number))
    (path / "catalog.json").write_text(OLD_CATALOG)
    (path / "data.csv").write_bytes(OLD_TABLE.encode())
    (member / "member.json").write_text(OLD_MEMBER)
    (member / "rows.csv").write_bytes(OLD_TABLE.partition("\r\n")[2].encode())
    return path


def test_a_catalog_of_an_earlier_schema_opens_and_goes_on(old: Path) -> None:
    assert check(old) == []
    opened = Catalog.open(old)
    assert opened.plan.variations == ()
    (member,) = opened.members
    assert member.appearances == ("dvr", "iso")
    assert np.array_equal(opened.image(member, "iso", 0), picture(1))
    assert "iso: isosurface at 0.25" in describe(old)
    assert len(Catalog.create(old, opened.plan).members) == 1
    with opened.begin_member("second", {"Re": 150.0}) as writer:
        for appearance, view in writer.missing():
            writer.write_image(appearance, view, picture(view))
    assert check(old) == []
    assert len(table(opened)) == 4
    assert (old / "catalog.json").read_text() == OLD_CATALOG
