"""Members of several catalogs come together in one, once each, or nothing is written."""

from __future__ import annotations

import errno
import os
import shutil
import signal
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner
from PIL import Image

from catalogs.cli import main
from catalogs.files import cinema, durable
from catalogs.files.packed import PACK, PackError
from catalogs.store.catalog import Catalog
from catalogs.store.missing import report_missing
from catalogs.store.plan import CatalogError
from catalogs.tools.check import check
from catalogs.tools.merge import Merged, merge
from catalogs.tools.packing import pack
from catalogs.vocabulary.appearance import Isosurface
from catalogs.vocabulary.cameras import orbit, view_splits
from catalogs.vocabulary.parameters import Parameter, ParameterSpace
from catalogs.vocabulary.quantity import Quantity
from tests.catalogs.conftest import add_member, make_plan, small_plan
from tests.support.mortal_disk import IN_TURN, MortalDisk, check_consistent, contents, in_child, in_small_process


def small(path: Path, members: dict[str, float], **options: Any) -> Catalog:
    """A catalog of members of two views, whose pictures follow from their parameters."""
    catalog = Catalog.create(path, small_plan())
    for name, reynolds in members.items():
        add_member(catalog, name, reynolds, **{"seed": int(reynolds), **options})
    return catalog


def test_members_of_all_are_in_one(tmp_path: Path) -> None:
    one = small(tmp_path / "one.cdb", {"b": 120.0, "d": 140.0})
    two = small(tmp_path / "two.cdb", {"c": 130.0, "a": 110.0}, split="test")
    before = contents(one.path), contents(two.path)
    assert merge(tmp_path / "all.cdb", [one.path, two.path]) == Merged(added=4, same=0, copied=0)
    assert check(tmp_path / "all.cdb") == []
    merged = Catalog.open(tmp_path / "all.cdb")
    assert [m.name for m in merged.members] == ["a", "b", "c", "d"]
    for source in (one, two):
        for member in source.members:
            stored = merged.member(member.name)
            assert (stored.parameters, stored.split) == (member.parameters, member.split)
            assert stored.provenance == member.provenance
            for appearance in member.appearances:
                np.testing.assert_array_equal(merged.images(stored, appearance), source.images(member, appearance))
    rows = {
        tuple(row)
        for catalog in (one, two)
        for row in cinema.parse((catalog.path / "data.csv").read_bytes().decode())[1]
    }
    assert {tuple(row) for row in cinema.parse((merged.path / "data.csv").read_bytes().decode())[1]} == rows
    assert merged.find({"Re": 130.0, "Pr": 1.0}) == "c"
    assert (contents(one.path), contents(two.path)) == before


def test_a_merged_catalog_equals_one_that_was_rendered_whole(tmp_path: Path) -> None:
    whole = small(tmp_path / "whole.cdb", {"a": 110.0, "b": 120.0, "c": 130.0})
    small(tmp_path / "one.cdb", {"b": 120.0})
    small(tmp_path / "two.cdb", {"c": 130.0, "a": 110.0})
    merge(tmp_path / "one.cdb", [tmp_path / "two.cdb"])
    assert contents(tmp_path / "one.cdb") == contents(whole.path)


def test_a_member_of_several_is_once_there(tmp_path: Path) -> None:
    small(tmp_path / "one.cdb", {"a": 110.0, "b": 120.0})
    small(tmp_path / "two.cdb", {"other": 120.0, "c": 130.0})
    assert merge(tmp_path / "one.cdb", [tmp_path / "two.cdb"]) == Merged(added=1, same=1, copied=0)
    assert [m.name for m in Catalog.open(tmp_path / "one.cdb").members] == ["a", "b", "c"]
    assert merge(tmp_path / "one.cdb", [tmp_path / "two.cdb"]) == Merged(added=0, same=2, copied=0)


def test_equal_pixels_in_other_bytes_are_the_same(tmp_path: Path) -> None:
    one, two = (small(tmp_path / f"{name}.cdb", {"a": 110.0}) for name in ("one", "two"))
    path = two.image_path("a", "dvr", 1)
    before = path.read_bytes()
    Image.open(path).save(path, compress_level=9)
    assert path.read_bytes() != before
    assert merge(one.path, [two.path]).same == 1


def change_pixel(catalog: Catalog) -> None:
    path = catalog.image_path("a", "dvr", 1)
    picture = np.asarray(Image.open(path)).copy()
    picture[3, 4, 3] ^= 1
    Image.fromarray(picture).save(path)


CONFLICTS: dict[str, tuple[Callable[[Path], Catalog], str]] = {
    "a pixel": (lambda path: changed(path, change_pixel), "a of .*two.cdb and a of .*one.cdb.*dvr/001.png"),
    "the split": (lambda path: small(path, {"a": 110.0}, split="test"), "a of .* differ in split"),
    "the parameters": (lambda path: small(path, {"a": 111.0}), "a of .*two.cdb has the name of a member"),
    "a missing picture": (
        lambda path: changed(
            path,
            lambda c: c.image_path("c", "iso", 0).unlink(),
        ),
        "c/iso/000.png is missing",
    ),
    "a picture that is a link": (lambda path: changed(path, link_out), "c/iso/000.png is a link"),
    "a damaged record": (
        lambda path: changed(path, lambda c: (c.path / "members/c/member.json").write_text("{}")),
        "damaged",
    ),
}


def changed(path: Path, change: Callable[[Catalog], object]) -> Catalog:
    catalog = small(path, {"a": 110.0, "c": 130.0})
    change(catalog)
    return catalog


def link_out(catalog: Catalog) -> None:
    path = catalog.image_path("c", "iso", 0)
    outside = catalog.path.parent / "outside.png"
    path.rename(outside)
    path.symlink_to(outside)


@pytest.mark.parametrize("case", CONFLICTS)
def test_what_conflicts_is_named_and_nothing_written(tmp_path: Path, case: str) -> None:
    make, told = CONFLICTS[case]
    one = small(tmp_path / "one.cdb", {"a": 110.0, "b": 120.0})
    two = make(tmp_path / "two.cdb")
    before = contents(one.path), contents(two.path)
    with pytest.raises(CatalogError, match=told):
        merge(one.path, [two.path])
    assert (contents(one.path), contents(two.path)) == before
    with pytest.raises(CatalogError, match=told):
        merge(tmp_path / "new.cdb", [one.path, two.path])
    assert not (tmp_path / "new.cdb").exists()


SPACE = make_plan().space
SURFACE = make_plan().appearances[1]
OTHER_PLANS: dict[str, tuple[dict[str, Any], str]] = {
    "views": ({"cameras": small_plan().cameras, "view_splits": small_plan().view_splits}, "views: 12 against 2"),
    "size": ({"cameras": tuple(orbit((0, 0, 0), 1.7, width=8, height=8, frequency=1))}, "16x12 against 8x8 pixels"),
    "places": ({"cameras": tuple(orbit((0, 0, 0), 1.8, width=16, height=12, frequency=1))}, "view 0 and maybe others"),
    "own cameras": ({"cameras": (), "view_splits": ()}, "views: 12 against those of each member"),
    "splits": ({"view_splits": tuple(reversed(view_splits(12)))}, "splits of views"),
    "bounds of a parameter": (
        {"space": ParameterSpace((Parameter("Re", 100.0, 300.0), SPACE.parameters[1]))},
        r"parameters: Re in \[100, 200\].* against Re in \[100, 300\]",
    ),
    "appearances": ({"appearances": (SURFACE,)}, "appearances: dvr, iso against iso"),
    "isovalue": (
        {"appearances": (make_plan().appearances[0], Isosurface("iso", 0.5))},
        "appearances: definition of iso",
    ),
    "order": ({"appearances": tuple(reversed(make_plan().appearances))}, "appearances: order"),
    "bounds": ({"bounds": ((-1, -1, -1), (1, 1, 2))}, "bounds: .*-1.* against .*2.0"),
    "background": ({"background": (1, 1, 1)}, r"background: None against \[1.0"),
    "encoding": ({"image_format": "exr"}, "encoding: png against exr"),
    "fields": ({"quantities": {"": Quantity("Q", "1/s²")}}, "units of fields: None against .*1/s²"),
}


@pytest.mark.parametrize("case", OTHER_PLANS)
def test_other_scenes_are_refused_by_what_differs(tmp_path: Path, case: str) -> None:
    changes, told = OTHER_PLANS[case]
    Catalog.create(tmp_path / "one.cdb", make_plan())
    Catalog.create(tmp_path / "two.cdb", make_plan(**changes))
    with pytest.raises(CatalogError, match=told) as refused:
        merge(tmp_path / "all.cdb", [tmp_path / "one.cdb", tmp_path / "two.cdb"])
    assert "two.cdb" in str(refused.value)
    assert not (tmp_path / "all.cdb").exists()


def test_provenance_may_differ(tmp_path: Path) -> None:
    Catalog.create(tmp_path / "one.cdb", make_plan(provenance={"machine": "a"}))
    Catalog.create(tmp_path / "two.cdb", make_plan(provenance={"machine": "b"}))
    merge(tmp_path / "all.cdb", [tmp_path / "one.cdb", tmp_path / "two.cdb"])
    assert Catalog.open(tmp_path / "all.cdb").plan.provenance == {"machine": "a"}


def test_a_catalog_is_named_once(tmp_path: Path) -> None:
    one = small(tmp_path / "one.cdb", {"a": 110.0})
    for sources in ([one.path], [tmp_path / "." / "one.cdb"], []):
        with pytest.raises(CatalogError, match="each once"):
            merge(one.path, sources)
    with pytest.raises(CatalogError, match=r"nothing\.cdb"):
        merge(tmp_path / "new.cdb", [one.path, tmp_path / "nothing.cdb"])
    assert not (tmp_path / "new.cdb").exists()


def test_members_of_some_appearances_and_cameras_of_their_own(tmp_path: Path) -> None:
    plan = make_plan(cameras=(), view_splits=())
    for number in range(2):
        catalog = Catalog.create(tmp_path / f"{number}.cdb", plan)
        cameras = orbit((0.0, 0.0, 0.0), 1.7 + number, width=16, height=12, frequency=1)[:2]
        name, shown = f"m{number}", ["iso"]
        with catalog.begin_member(
            name,
            {"Re": 110.0 + number, "Pr": 1.0},
            cameras=cameras,
            view_splits=["train", "test"],
            appearances=shown,
        ) as writer:
            for view in range(2):
                writer.write_image("iso", view, np.full((12, 16, 4), 10 * number, np.uint8))
    merge(tmp_path / "all.cdb", [tmp_path / "0.cdb", tmp_path / "1.cdb"])
    assert check(tmp_path / "all.cdb") == []
    merged = Catalog.open(tmp_path / "all.cdb").members
    assert [m.appearances for m in merged] == [("iso",), ("iso",)]
    assert merged[0].cameras != merged[1].cameras


def test_pictures_are_links_where_that_is_possible_else_copies(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    one = small(tmp_path / "one.cdb", {"a": 110.0})
    merge(tmp_path / "linked.cdb", [one.path])
    linked = Catalog.open(tmp_path / "linked.cdb").image_path("a", "dvr", 0)
    assert linked.samefile(one.image_path("a", "dvr", 0))

    def no_links(source: Path, target: Path) -> None:
        raise OSError(errno.EXDEV, os.strerror(errno.EXDEV), str(source), None, str(target))

    monkeypatch.setattr(durable, "link", no_links)
    assert merge(tmp_path / "copied.cdb", [one.path]).copied == 4
    copied = Catalog.open(tmp_path / "copied.cdb").image_path("a", "dvr", 0)
    assert not copied.samefile(one.image_path("a", "dvr", 0))
    assert contents(tmp_path / "copied.cdb") == contents(tmp_path / "linked.cdb")


def test_many_members_come_in_few_commits(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("catalogs.tools.transfer.AT_ONCE", 2)
    names = {f"m{n}": 100.0 + n for n in range(5)}
    source, commits = small(tmp_path / "one.cdb", names), []
    adopt = Catalog.adopt
    monkeypatch.setattr(Catalog, "adopt", lambda self, members: (commits.append(len(members)), adopt(self, members))[1])
    merge(tmp_path / "all.cdb", [source.path])
    assert commits == [2, 2, 1]
    assert check(tmp_path / "all.cdb") == []


def test_what_catalogs_miss_is_kept_where_no_other_has_it(tmp_path: Path) -> None:
    one, two = small(tmp_path / "one.cdb", {"a": 110.0}), small(tmp_path / "two.cdb", {"b": 120.0})
    report_missing(one.path, "b", {"Re": 120.0, "Pr": 1.0}, "a full disk")
    report_missing(one.path, "c", {"Re": 130.0, "Pr": 1.0}, "a full disk")
    merge(tmp_path / "all.cdb", [one.path, two.path])
    assert [(m.name, m.reason) for m in Catalog.open(tmp_path / "all.cdb").missing] == [("c", "a full disk")]


def sources(folder: Path) -> list[Path]:
    small(folder / "one.cdb", {"a": 110.0})
    small(folder / "two.cdb", {"b": 120.0, "c": 130.0})
    return [folder / "one.cdb", folder / "two.cdb"]


def operations(folder: Path, given: list[Path]) -> int:
    disk = MortalDisk(-1, "after", folder)
    disk.install()
    try:
        merge(folder / "count.cdb", given)
    finally:
        disk.remove()
    return disk.count


@pytest.mark.slow
@pytest.mark.parametrize("loss", ["everything", IN_TURN])
@in_small_process
def test_dead_at_every_operation_the_same_command_completes_it(folder: Path, loss: str) -> None:
    given = sources(folder)
    merge(folder / "whole.cdb", given)
    undisturbed, kept = contents(folder / "whole.cdb"), [contents(path) for path in given]
    total = operations(folder, given)
    assert total > 50
    for step in range(1, total + 1):
        path = folder / f"{step}.cdb"

        def work(path: Path = path, step: int = step) -> None:
            MortalDisk(step, loss, path).install()
            merge(path, given)

        assert os.WTERMSIG(in_child(work)[1]()) == signal.SIGKILL, f"{step} of {total}"
        check_consistent(path)
        merge(path, given)
        assert contents(path) == undisturbed, f"{loss} operation {step} of {total}"
        assert [contents(source) for source in given] == kept
        shutil.rmtree(path)


def test_interrupted_it_goes_on(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("catalogs.tools.transfer.AT_ONCE", 1)
    given, seen = sources(folder), []

    def interrupt(stage: str, done: int, total: int) -> None:
        seen.append((stage, done, total))
        if (stage, done) == ("merging", 2):
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        merge(folder / "all.cdb", given, progress=interrupt)
    assert seen == [("comparing", n, 3) for n in (1, 2, 3)] + [("merging", 1, 3), ("merging", 2, 3)]
    assert Catalog.open(folder / "all.cdb").unfinished() == []
    assert [m.name for m in Catalog.open(folder / "all.cdb").members] == ["a"]
    assert merge(folder / "all.cdb", given) == Merged(added=2, same=1, copied=0)
    merge(folder / "whole.cdb", given)
    assert contents(folder / "all.cdb") == contents(folder / "whole.cdb")


def test_the_command_says_what_it_did(tmp_path: Path) -> None:
    small(tmp_path / "one.cdb", {"a": 110.0})
    small(tmp_path / "two.cdb", {"a": 110.0, "b": 120.0})
    arguments = ["merge", str(tmp_path / "all.cdb"), str(tmp_path / "one.cdb"), str(tmp_path / "two.cdb")]
    result = CliRunner().invoke(main, arguments)
    assert result.exit_code == 0, result.output
    assert "all.cdb: 2 members added, 1 found in several catalogs\n" in result.output
    assert CliRunner().invoke(main, ["merge", str(tmp_path / "all.cdb")]).exit_code == 2
    result = CliRunner().invoke(main, ["merge", str(tmp_path / "all"), str(tmp_path / "one.cdb")])
    assert result.exit_code == 1
    assert ".cdb" in result.output
    assert "Traceback" not in result.output


def small_pack(path: Path, members: dict[str, float], **options: Any) -> Catalog:
    """The same packed."""
    source = small(path.with_suffix(".unpacked.cdb"), members, **options)
    pack(source.path, path)
    return Catalog.open(path)


def test_packed_catalogs_become_one_without_further_space(tmp_path: Path) -> None:
    one = small_pack(tmp_path / "one.cdb", {"b": 120.0, "d": 140.0})
    two = small_pack(tmp_path / "two.cdb", {"c": 130.0, "d": 140.0}, split="test")
    with pytest.raises(CatalogError, match="differ in split"):
        merge(tmp_path / "all.cdb", [one.path, two.path])
    three = small_pack(tmp_path / "three.cdb", {"c": 130.0, "d": 140.0})
    assert merge(tmp_path / "all.cdb", [one.path, three.path]) == Merged(added=3, same=1, copied=0)
    assert check(tmp_path / "all.cdb") == []
    whole = small_pack(tmp_path / "whole.cdb", {"b": 120.0, "c": 130.0, "d": 140.0})
    assert contents(tmp_path / "all.cdb") == contents(whole.path)
    assert (tmp_path / "all.cdb/members/b" / PACK).samefile(one.path / "members/b" / PACK)
    assert merge(tmp_path / "all.cdb", [three.path]) == Merged(added=0, same=2, copied=0)


@pytest.mark.parametrize("harm", ["gone", "cut", "link"])
def test_nothing_is_merged_with_a_pack_that_is_damaged(tmp_path: Path, harm: str) -> None:
    one = small_pack(tmp_path / "one.cdb", {"b": 120.0})
    two = small_pack(tmp_path / "two.cdb", {"c": 130.0})
    damaged = two.path / "members/c" / PACK
    data = damaged.read_bytes()
    damaged.unlink()
    if harm == "cut":
        damaged.write_bytes(data[:100])
    elif harm == "link":
        damaged.symlink_to(one.path / "members/b" / PACK)
    with pytest.raises((CatalogError, PackError), match=str(damaged)):
        merge(tmp_path / "all.cdb", [one.path, two.path])
    assert not (tmp_path / "all.cdb").exists()


def test_packs_of_equal_parameters_but_other_pictures_are_told(tmp_path: Path) -> None:
    one = small_pack(tmp_path / "one.cdb", {"b": 120.0})
    two = small_pack(tmp_path / "two.cdb", {"b": 120.0}, seed=7)
    with pytest.raises(
        CatalogError, match=r"nothing was merged: b of .*two\.cdb and b of .*one\.cdb differ in the image"
    ):
        merge(tmp_path / "all.cdb", [one.path, two.path])
