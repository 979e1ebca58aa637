"""Coarse fields go where their members go, and damage to them is found, as with the other files."""

from __future__ import annotations

import os
import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from catalogs.exchange import export
from catalogs.store.catalog import Catalog
from catalogs.store.coarse import CoarseField
from catalogs.store.members import COARSE, has_coarse_fields
from catalogs.store.sizes import Sizes, bytes_of, sizes_of
from catalogs.tools.check import check
from catalogs.tools.merge import merge
from catalogs.tools.packing import pack, unpack
from catalogs.tools.repair import accept, repair
from catalogs.tools.show import describe
from catalogs.tools.split import split
from tests.catalogs.conftest import add_member, make_plan, picture, small_plan
from tests.support.hooked import tree
from tests.support.mortal_disk import LOSSES, MortalDisk, check_consistent, in_child

FIRST, SECOND = f"members/first/{COARSE}", f"members/second/{COARSE}"


def field(seed: int) -> CoarseField:
    values = np.random.default_rng(seed).random((4, 5, 6)).astype(np.float32)
    return CoarseField(values, (0.1, 0.2, 0.3), (0.0, 0.0, 0.0), whole=True)


@pytest.fixture
def catalog(catalog: Catalog) -> Catalog:
    """The small catalog, with coarse fields."""
    for seed, member in enumerate(catalog.members):
        catalog.add_coarse_fields(member.name, {"": field(seed)})
    return catalog


def coarse_files(path: Path) -> dict[str, bytes]:
    return {name: data for name, data in tree(path).items() if name.endswith(COARSE)}


def test_adding_touches_nothing_else_and_is_recorded(tmp_path: Path) -> None:
    made = Catalog.create(tmp_path / "a.cdb", make_plan())
    add_member(made, "first", 120.0)
    before = tree(made.path)
    made.add_coarse_fields("first", {"": field(0)})
    after = tree(made.path)
    assert {name for name in after if after[name] != before.get(name)} == {FIRST, "members/first/member.json"}
    (member,) = made.members
    stored = member.coarse_field()
    assert stored is not None
    np.testing.assert_allclose(stored.values, field(0).values, atol=1e-5)
    assert has_coarse_fields(member.path, made.plan)
    assert check(made.path) == []


def test_a_writer_stores_them_with_the_images(tmp_path: Path) -> None:
    made = Catalog.create(tmp_path / "a.cdb", make_plan())
    with made.begin_member("first", {"Re": 120.0, "Pr": 1.0}) as writer:
        for appearance in made.appearance_names:
            for view in range(12):
                writer.write_image(appearance, view, picture(view))
        writer.write_coarse_fields({"q": field(1)})
    assert check(made.path) == []
    assert has_coarse_fields(made.path / "members/first", made.plan)


def test_a_record_from_before_digests_stays_as_it_is(tmp_path: Path) -> None:
    made = Catalog.create(tmp_path / "a.cdb", make_plan())
    add_member(made, "first", 120.0)
    record = made.path / "members/first/member.json"
    text = record.read_text()
    record.write_text(text[: text.index(',\n "digests"')] + "\n}")
    made.add_coarse_fields("first", {"": field(0)})
    assert "digests" not in record.read_text()
    assert has_coarse_fields(record.parent, made.plan)


def test_packing_merging_and_splitting_keep_them(catalog: Catalog, tmp_path: Path) -> None:
    expected = coarse_files(catalog.path)
    assert expected.keys() == {FIRST, SECOND}
    pack(catalog.path, tmp_path / "packed.cdb")
    unpack(tmp_path / "packed.cdb", tmp_path / "unpacked.cdb")
    merge(tmp_path / "merged.cdb", [catalog.path, tmp_path / "unpacked.cdb"])
    split(catalog.path, tmp_path / "shards.cdb", rows=24)
    for name in ("packed.cdb", "unpacked.cdb", "merged.cdb"):
        assert coarse_files(tmp_path / name) == expected
        assert check(tmp_path / name) == []
    shards = coarse_files(tmp_path / "shards.cdb")
    assert sorted(shards.values()) == sorted(expected.values())


def test_a_packed_catalog_takes_them(catalog: Catalog, tmp_path: Path) -> None:
    expected = coarse_files(catalog.path)
    for name in ("first", "second"):
        (catalog.path / "members" / name / COARSE).unlink()
    accept(catalog.path)
    assert check(catalog.path) == []
    pack(catalog.path, tmp_path / "packed.cdb")
    packed = Catalog.open(tmp_path / "packed.cdb")
    for seed, member in enumerate(packed.members):
        assert not has_coarse_fields(member.path, packed.plan)
        packed.add_coarse_fields(member.name, {"": field(seed)})
    assert coarse_files(packed.path) == expected
    assert check(packed.path) == []


DAMAGE: dict[str, tuple[Callable[[Path], object], str]] = {
    "cut": (lambda c: (c / FIRST).write_bytes((c / FIRST).read_bytes()[:100]), "is not a file of coarse fields"),
    "that of another member": (lambda c: shutil.copy(c / SECOND, c / FIRST), "is not the file that was written"),
    "missing": (lambda c: (c / FIRST).unlink(), "is missing"),
}


@pytest.mark.parametrize("name", DAMAGE)
def test_damage_is_found_and_the_member_set_aside(catalog: Catalog, name: str) -> None:
    damage, problem = DAMAGE[name]
    damage(catalog.path)
    (finding,) = check(catalog.path)
    assert (finding.member, COARSE in str(finding), problem in str(finding)) == ("first", True, True)
    assert [member.name for member in repair(catalog.path).set_aside] == ["first"]


def test_files_as_they_are_can_be_accepted(catalog: Catalog) -> None:
    shutil.copy(catalog.path / SECOND, catalog.path / FIRST)
    assert accept(catalog.path) == ()
    assert check(catalog.path) == []


def test_exports_have_no_need_of_them(catalog: Catalog, tmp_path: Path) -> None:
    bare = Catalog.create(tmp_path / "bare.cdb", make_plan())
    add_member(bare, "first", 120.0, seed=1)
    for made, folder in ((catalog, "with"), (bare, "without")):
        export(made, tmp_path / folder, "nerf", members=["first"], appearance="dvr")
    assert tree(tmp_path / "with") == tree(tmp_path / "without")


def test_sizes_stand_side_by_side(catalog: Catalog) -> None:
    first, second = map(sizes_of, catalog.members)
    images = sum(path.stat().st_size for path in catalog.path.rglob("*.png"))
    fields = sum(path.stat().st_size for path in catalog.path.rglob(COARSE))
    assert first + second == Sizes(images, fields, 12, True)
    assert f"of these    {images / 1e3:.3g} kB of images, {fields / 1e3:.3g} kB of fields" in describe(catalog.path)
    all_files = sum(path.stat().st_size for path in catalog.path.rglob("*") if path.is_file())
    outside = bytes_of(catalog.path, {str(member.path) for member in catalog.members})
    assert outside + images + fields + first.others + second.others == bytes_of(catalog.path) == all_files
    (catalog.path / SECOND).unlink()
    assert not (first + sizes_of(catalog.members[1])).whole


def test_fewer_views_are_advised_only_where_they_may_do() -> None:
    many = Sizes(1_270_000, 78_000, 252, True)
    assert str(many) == "1.27 MB of images, 78 kB of fields"
    assert many.advice.startswith("the fields are kept whole: fewer than 252 views may do (42, frequency 2,")
    for other in (Sizes(1_270_000, 0, 252), Sizes(10, 20, 252, True), Sizes(100, 20, 42, True), Sizes(100, 20, 252)):
        assert other.advice == ""
    assert str(Sizes(999)) == "999 bytes of images, no coarse fields"


@pytest.mark.slow
@pytest.mark.parametrize("loss", LOSSES)
def test_whoever_is_killed_while_adding_leaves_a_whole_catalog(tmp_path: Path, loss: str) -> None:
    made = Catalog.create(tmp_path / "a.cdb", small_plan())
    add_member(made, "first", 120.0)
    shutil.copytree(made.path, tmp_path / "b.cdb")
    other = Catalog.open(tmp_path / "b.cdb")
    other.add_coarse_fields("first", {"": field(0)})
    for step in range(1, 100):
        path = tmp_path / f"{step}.cdb"
        shutil.copytree(made.path, path)
        disk = MortalDisk(step, loss, path)

        def add(disk: MortalDisk = disk, path: Path = path) -> None:
            disk.install()
            Catalog.open(path).add_coarse_fields("first", {"": field(0)})

        _, wait = in_child(add)
        status = wait()
        check_consistent(path)
        assert check(path) == []
        if not has_coarse_fields(path / "members/first", made.plan):
            Catalog.open(path).add_coarse_fields("first", {"": field(0)})
        assert coarse_files(path) == coarse_files(other.path)
        assert check(path) == []
        if os.WIFEXITED(status):
            break
    assert os.WEXITSTATUS(status) == 0
    assert step > 4
