"""Damage that leaves every file valid is named by `catalogs check`: each file has a digest."""

from __future__ import annotations

import hashlib
import json
import os
import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from catalogs.cli import main
from catalogs.files.digests import digest_of, digest_of_file, is_sealed, sealed
from catalogs.files.images import write_image
from catalogs.store.catalog import Catalog, CatalogError
from catalogs.tools.check import check
from catalogs.tools.merge import merge
from catalogs.tools.packing import pack, unpack
from catalogs.tools.repair import accept, repair
from catalogs.tools.show import describe
from catalogs.tools.split import split
from catalogs.vocabulary.cameras import orbit
from tests.catalogs.conftest import add_member, make_plan, picture, rewrite_record, small_plan
from tests.support.mortal_disk import contents

FIRST, SECOND = Path("members/first"), Path("members/second")


def swap(one: Path, other: Path) -> None:
    aside = one.with_name("aside")
    one.rename(aside)
    other.rename(one)
    aside.rename(other)


def edit(path: Path, old: str, new: str) -> None:
    text = path.read_bytes().decode()
    assert old in text
    path.write_bytes(text.replace(old, new, 1).encode())


def without_digests(catalog: Path) -> None:
    """Make the catalog one of an earlier version."""
    for path in [catalog / "catalog.json", *catalog.glob("members/*/member.json")]:
        record = json.loads(path.read_text())
        path.write_text(json.dumps({k: v for k, v in record.items() if k not in ("digest", "digests")}, indent=1))


VALID: dict[str, tuple[Callable[[Path], object], str, str]] = {
    "picture of another member": (
        lambda c: swap(c / FIRST / "dvr/003.png", c / SECOND / "dvr/003.png"),
        "members/second/dvr/003.png",
        "is not the file that was written",
    ),
    "picture of another view": (
        lambda c: shutil.copy(c / FIRST / "dvr/004.png", c / FIRST / "dvr/003.png"),
        "members/first/dvr/003.png",
        "is not the file that was written",
    ),
    "picture of another appearance": (
        lambda c: swap(c / FIRST / "dvr/003.png", c / FIRST / "iso/003.png"),
        "members/first/iso/003.png",
        "is not the file that was written",
    ),
    "same pixels, other file": (
        lambda c: write_image(c / FIRST / "dvr/003.png", np.zeros((12, 16, 4), np.uint8)),
        "members/first/dvr/003.png",
        "is not the file that was written",
    ),
    "sidecar of another member": (
        lambda c: shutil.copy(c / SECOND / "field.npz", c / FIRST / "field.npz"),
        "member first",
        "field.npz is not the file that was written",
    ),
    "no sidecar": (lambda c: (c / FIRST / "field.npz").unlink(), "member first", "field.npz is missing"),
    "no description": (lambda c: (c / "catalog.json").unlink(), "catalog.json", "is missing, but there are 2 members"),
    "a bound": (
        lambda c: edit(c / "catalog.json", '"bounds": [\n  [\n   -1.0', '"bounds": [\n  [\n   -1.5'),
        "catalog.json",
        "digest differs",
    ),
    "a camera": (lambda c: edit(c / "catalog.json", '"fx": 2', '"fx": 3'), "catalog.json", "digest differs"),
    "an isovalue": (lambda c: edit(c / "catalog.json", "0.25", "0.35"), "catalog.json", "digest differs"),
    "a parameter's range": (lambda c: edit(c / "catalog.json", "200.0", "300.0"), "catalog.json", "digest differs"),
    "parameters of a record": (
        lambda c: edit(c / FIRST / "member.json", "120.0", "121.0"),
        "member first",
        "rows.csv has Re=120 Pr=1",
    ),
    "split of a record": (
        lambda c: edit(c / SECOND / "member.json", '"test"', '"train"'),
        "member second",
        "digest differs",
    ),
    "parameters of the table": (
        lambda c: (c / "data.csv").write_bytes((c / "data.csv").read_bytes().replace(b"120.0,", b"121.0,")),
        "data.csv",
        "differs from what the members make",
    ),
    "folder renamed": (lambda c: (c / FIRST).rename(c / "members/other"), "member other", "describes first"),
    "members swapped": (lambda c: swap(c / FIRST, c / SECOND), "member second", "describes first"),
    "records swapped": (
        lambda c: swap(c / FIRST / "member.json", c / SECOND / "member.json"),
        "member second",
        "describes first",
    ),
    "folder gone": (lambda c: shutil.rmtree(c / FIRST), "member first", "lists it as missing"),
}


@pytest.mark.parametrize("case", VALID)
def test_valid_files_in_wrong_places_are_named(catalog: Catalog, case: str) -> None:
    damage, place, problem = VALID[case]
    damage(catalog.path)
    findings = [str(finding) for finding in check(catalog.path)]
    assert any(place in finding and problem in finding for finding in findings), findings


def test_a_digest_is_what_common_tools_print(tmp_path: Path) -> None:
    (tmp_path / "a").write_bytes(b"abc")
    expected = hashlib.blake2b(b"abc", digest_size=8).hexdigest()  # `b2sum --length 64`
    assert digest_of(b"abc") == digest_of_file(tmp_path / "a") == expected
    data = sealed({"b": [1.5], "a": {}})
    assert is_sealed(data)
    assert {**json.loads(data), "digest": ""} == {"b": [1.5], "a": {}, "digest": ""}
    assert not is_sealed(data.replace(b"1.5", b"1.6"))


@pytest.mark.parametrize("case", ["no description", "a bound", "an isovalue", "another catalog's"])
def test_a_damaged_description_is_no_reason_to_rewrite_rows(catalog: Catalog, tmp_path: Path, case: str) -> None:
    if case == "another catalog's":
        other = Catalog.create(tmp_path / "other.cdb", make_plan(bounds=((-2, -2, -2), (1, 1, 1))))
        shutil.copy(other.path / "catalog.json", catalog.path / "catalog.json")
        told = "is another than 2 of 2 members were written for: restore it from a copy"
        assert [(f.place, told in f.problem) for f in check(catalog.path)] == [("catalog.json", True)]
    else:
        VALID[case][0](catalog.path)
    before = contents(catalog.path)
    with pytest.raises(CatalogError, match=r"catalog\.json"):
        repair(catalog.path)
    assert contents(catalog.path) == before


def test_a_description_restored_from_an_empty_catalog_is_as_good(catalog: Catalog, tmp_path: Path) -> None:
    (catalog.path / "catalog.json").unlink()
    other = Catalog.create(tmp_path / "other.cdb", make_plan(provenance={"software": "later"}))
    shutil.copy(other.path / "catalog.json", catalog.path / "catalog.json")
    assert check(catalog.path) == []


def test_a_member_from_a_catalog_of_another_plan_is_named_and_set_aside(catalog: Catalog, tmp_path: Path) -> None:
    other = Catalog.create(tmp_path / "other.cdb", make_plan(bounds=((-2, -2, -2), (1, 1, 1))))
    add_member(other, "third", 150.0)
    shutil.copytree(other.path / "members/third", catalog.path / "members/third")
    assert any("member third: member.json was written for another" in str(f) for f in check(catalog.path))
    assert [member.name for member in repair(catalog.path).set_aside] == ["third"]
    assert check(catalog.path) == []


def test_a_later_catalog_and_blanks_in_its_description_are_no_damage(catalog: Catalog) -> None:
    record = json.loads((catalog.path / "catalog.json").read_text())
    (catalog.path / "catalog.json").write_text(json.dumps({"comment": "new", **record}, indent=4))
    assert check(catalog.path) == []


@pytest.mark.parametrize("case", ["folder renamed", "members swapped", "parameters of a record"])
def test_what_a_digest_proves_is_mended_without_rendering(catalog: Catalog, case: str) -> None:
    whole = contents(catalog.path)
    VALID[case][0](catalog.path)
    result = CliRunner().invoke(main, ["check", "--repair", str(catalog.path)])
    assert (result.exit_code, " back" in result.output) == (0, True), result.output
    assert contents(catalog.path) == whole


def test_folders_of_three_members_in_each_others_places(catalog: Catalog) -> None:
    add_member(catalog, "third", 150.0)
    catalog.rebuild_table()
    whole = contents(catalog.path)
    swap(catalog.path / FIRST, catalog.path / SECOND)
    swap(catalog.path / SECOND, catalog.path / "members/third")
    assert repair(catalog.path).findings == ()
    assert contents(catalog.path) == whole


@pytest.mark.parametrize("by", ["repair", "next member"])
def test_a_member_whose_folder_is_gone_stays_as_missing(catalog: Catalog, by: str) -> None:
    shutil.rmtree(catalog.path / FIRST)
    if by == "repair":
        assert repair(catalog.path).findings == ()
    else:
        add_member(catalog, "third", 150.0)
    (missing,) = catalog.missing
    assert (missing.name, missing.parameters) == ("first", {"Re": 120.0, "Pr": 1.0})
    line = next(line for line in describe(catalog.path).splitlines() if line.startswith("  missing"))
    assert "first: its folder is gone" in line
    assert line.endswith(" (at Re=120 Pr=1)")
    add_member(catalog, "first", 120.0, seed=1)
    assert catalog.missing == ()
    assert check(catalog.path) == []


def test_a_folder_gone_beside_a_damaged_member(catalog: Catalog) -> None:
    add_member(catalog, "third", 150.0)
    shutil.rmtree(catalog.path / FIRST)
    (catalog.path / SECOND / "member.json").write_text("{")
    assert [member.name for member in repair(catalog.path).set_aside] == ["second"]
    assert {m.name: m.parameters["Re"] for m in catalog.missing} == {"first": 120.0, "second": 180.0}


def test_one_of_two_equal_members_taken_out_is_not_missing(catalog: Catalog) -> None:
    rewrite_record(catalog.path / SECOND, parameters={"Re": 120.0, "Pr": 1.0})
    repair(catalog.path)
    shutil.rmtree(catalog.path / SECOND)
    assert repair(catalog.path).findings == ()
    assert catalog.missing == ()


def test_catalogs_from_before_have_no_digests_and_can_get_them(catalog: Catalog) -> None:
    whole = contents(catalog.path)
    without_digests(catalog.path)
    assert len(Catalog.open(catalog.path).members) == 2
    result = CliRunner().invoke(main, ["check", str(catalog.path)])
    assert (result.exit_code, result.output.count("have no digests")) == (0, 1)
    add_member(Catalog.open(catalog.path), "third", 150.0)
    assert check(catalog.path) == []
    shutil.rmtree(catalog.path / "members/third")
    assert CliRunner().invoke(main, ["check", "--accept", str(catalog.path)]).exit_code == 0
    shutil.rmtree(catalog.path / ".missing")
    assert contents(catalog.path) == whole


def test_an_edit_on_purpose_can_be_accepted(catalog: Catalog) -> None:
    edit(catalog.path / "catalog.json", "200.0", "300.0")
    edit(catalog.path / FIRST / "member.json", "120.0", "121.0")
    with pytest.raises(CatalogError, match="`catalogs check --accept` takes it as it is"):
        Catalog.open(catalog.path)
    result = CliRunner().invoke(main, ["check", "--accept", str(catalog.path)])
    assert (result.exit_code, "nothing wrong" in result.output) == (0, True), result.output
    opened = Catalog.open(catalog.path)
    assert opened.plan.space.parameters[0].high == 300.0
    assert opened.find({"Re": 121.0, "Pr": 1.0}) == "first"
    assert b"121.0" in (catalog.path / "data.csv").read_bytes()


def test_what_is_damaged_is_not_accepted(catalog: Catalog) -> None:
    os.truncate(catalog.path / FIRST / "dvr/003.png", 60)
    before = (catalog.path / FIRST / "member.json").read_bytes()
    assert [str(f).split(": ", 1)[1][:26] for f in accept(catalog.path)] == ["members/first/dvr/003.png "]
    assert (catalog.path / FIRST / "member.json").read_bytes() == before
    assert CliRunner().invoke(main, ["check", "--accept", "--repair", str(catalog.path)]).exit_code == 2


@pytest.mark.parametrize("old", [False, True])
def test_every_way_into_another_catalog_keeps_digests(catalog: Catalog, tmp_path: Path, old: bool) -> None:
    if old:
        without_digests(catalog.path)
    made = [tmp_path / name for name in ("merged.cdb", "packed.cdb", "unpacked.cdb")]
    extra = Catalog.create(tmp_path / "extra.cdb", make_plan())
    add_member(extra, "third", 150.0)
    merge(made[0], [catalog.path, extra.path])
    pack(catalog.path, made[1])
    unpack(made[1], made[2])
    split(catalog.path, tmp_path / "index.cdb", rows=24)
    for path in [*made, *(tmp_path / "index.cdb/shards").iterdir()]:
        notes: list[str] = []
        assert check(path, note=notes.append) == []
        assert bool(notes) == (old and path.name != "packed.cdb")
    if not old:
        assert (made[2] / FIRST / "member.json").read_bytes() == (catalog.path / FIRST / "member.json").read_bytes()
    swap(made[1] / FIRST / "pictures.h5", made[1] / SECOND / "pictures.h5")
    assert [finding.member for finding in check(made[1])] == ["first", "second"]


def test_a_damaged_picture_does_not_become_right_by_being_packed_or_merged(catalog: Catalog, tmp_path: Path) -> None:
    swap(catalog.path / FIRST / "dvr/003.png", catalog.path / SECOND / "dvr/003.png")
    with pytest.raises(ValueError, match="is not the file that was written"):
        pack(catalog.path, tmp_path / "packed.cdb")
    other = Catalog.create(tmp_path / "other.cdb", make_plan())
    merge(other.path, [catalog.path])
    assert len(check(other.path)) == 2


def test_cameras_of_members_have_a_digest_too(tmp_path: Path) -> None:
    made = Catalog.create(tmp_path / "own.cdb", make_plan(cameras=(), view_splits=()))
    cameras = orbit((0, 0, 0), 2, width=8, height=8, frequency=1)[:2]
    with made.begin_member("a", {"Re": 110.0, "Pr": 1.0}, cameras=cameras, view_splits=["train"] * 2) as writer:
        for appearance, view in writer.missing():
            writer.write_image(appearance, view, picture(view, 8, 8))
    assert check(made.path) == []
    edit(made.path / "members/a/cameras.json", '"fx": ', '"fx": 1')
    assert "cameras.json is damaged: it is not as it was written" in str(check(made.path)[0])
    accept(made.path)
    assert check(made.path) == []


def test_float_images_have_digests(tmp_path: Path) -> None:
    plan = small_plan()
    made = Catalog.create(
        tmp_path / "float.cdb", make_plan(image_format="exr", cameras=plan.cameras, view_splits=plan.view_splits)
    )
    add_member(made, "a", 110.0)
    assert check(made.path) == []
    swap(made.path / "members/a/dvr/000.exr", made.path / "members/a/dvr/001.exr")
    assert len(check(made.path)) == 2


def test_a_damaged_report_of_a_missing_member_is_named(catalog: Catalog) -> None:
    shutil.rmtree(catalog.path / FIRST)
    repair(catalog.path)
    report = catalog.path / ".missing/first.json"
    edit(report, "120.0", "130.0")
    assert [str(f) for f in check(catalog.path)] == [
        ".missing/first.json: is damaged: delete it, or render the member again"
    ]
    edit(report, "130.0", "120.0")
    report.rename(report.with_name("other.json"))
    assert len(check(catalog.path)) == 1
