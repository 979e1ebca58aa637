"""A packed catalog is the same catalog: for every command, for training, for pycinema, and when it is unpacked."""

from __future__ import annotations

import csv
import os
import shutil
import signal
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from catalogs.cli import main
from catalogs.exchange import export
from catalogs.files.images import ImageError
from catalogs.files.packed import PACK
from catalogs.store.catalog import Catalog, CatalogError
from catalogs.tools.check import check
from catalogs.tools.merge import merge
from catalogs.tools.packing import Transferred, pack, unpack
from catalogs.tools.repair import repair
from catalogs.tools.show import describe
from catalogs.vocabulary.cameras import orbit
from tests.catalogs.conftest import add_member, make_plan, picture, small_plan
from tests.support.mortal_disk import IN_TURN, MortalDisk, contents, in_child, in_small_process

OTHERWISE = "Catalog", "  images", "  on disk", "  of these"  # lines of `catalogs show` that packing changes


@pytest.fixture
def packed(catalog: Catalog, tmp_path: Path) -> Catalog:
    pack(catalog.path, tmp_path / "packed.cdb")
    return Catalog.open(tmp_path / "packed.cdb")


def table(path: Path) -> list[dict[str, str]]:
    with (path / "data.csv").open(newline="") as stream:
        return list(csv.DictReader(stream))


def test_every_picture_and_every_column_but_one_is_the_same(catalog: Catalog, packed: Catalog) -> None:
    assert packed.plan.packed
    assert len(list(packed.path.rglob("*.png"))) == 0
    assert len(list(packed.path.rglob(PACK))) == 2
    for member in catalog.members:
        stored = packed.member(member.name)
        assert (stored.parameters, stored.split, stored.provenance) == (
            member.parameters,
            member.split,
            member.provenance,
        )
        assert (stored.path / "field.npz").read_bytes() == (member.path / "field.npz").read_bytes()
        for appearance in member.appearances:
            for dtype in ("uint8", "float32"):
                images = (c.images(c.member(member.name), appearance, dtype=dtype) for c in (catalog, packed))
                np.testing.assert_array_equal(*images)
    folder_rows, rows = table(catalog.path), table(packed.path)
    assert [{**row, "FILE": ""} for row in rows] == [{**row, "FILE": ""} for row in folder_rows]
    assert {row["FILE"] for row in rows} == {f"members/{name}/{PACK}" for name in ("first", "second")}


@pytest.mark.parametrize("encoding", ["png", "exr"])
def test_unpacked_every_byte_is_as_it_was(tmp_path: Path, encoding: str) -> None:
    catalog = Catalog.create(tmp_path / "whole.cdb", make_plan(image_format=encoding))
    add_member(catalog, "first", 120.0)
    catalog.rebuild_table()
    assert pack(catalog.path, tmp_path / "packed.cdb") == Transferred(1, 0)
    assert unpack(tmp_path / "packed.cdb", tmp_path / "again.cdb") == Transferred(1, 0, 0)
    assert contents(tmp_path / "again.cdb") == contents(catalog.path)


def test_members_with_cameras_of_their_own_and_some_appearances(tmp_path: Path) -> None:
    catalog = Catalog.create(tmp_path / "own.cdb", make_plan(cameras=(), view_splits=()))
    for number, shown in enumerate((["iso"], ["dvr", "iso"])):
        size = 10 + number
        cameras = orbit((0.0, 0.0, 0.0), 1.7, width=size, height=12, frequency=1)[: 2 + number]
        with catalog.begin_member(
            f"m{number}",
            {"Re": 110.0 + number, "Pr": 1.0},
            cameras=cameras,
            view_splits=["train"] * len(cameras),
            appearances=shown,
        ) as writer:
            for seed, (appearance, view) in enumerate(writer.missing()):
                writer.write_image(appearance, view, picture(seed, 12, size))
    catalog.rebuild_table()
    pack(catalog.path, tmp_path / "packed.cdb")
    assert check(tmp_path / "packed.cdb") == []
    unpack(tmp_path / "packed.cdb", tmp_path / "again.cdb")
    assert contents(tmp_path / "again.cdb") == contents(catalog.path)


def test_views_of_several_sizes_are_refused(tmp_path: Path) -> None:
    catalog = Catalog.create(tmp_path / "own.cdb", make_plan(cameras=(), view_splits=()))
    cameras = [orbit((0.0, 0.0, 0.0), 1.7, width=w, height=12, frequency=1)[0] for w in (8, 9)]
    with catalog.begin_member("m", {"Re": 110.0, "Pr": 1.0}, cameras=cameras, view_splits=["train"] * 2) as writer:
        for appearance, view in writer.missing():
            writer.write_image(appearance, view, picture(0, 12, 8 + view))
    with pytest.raises(CatalogError, match="differ in size"):
        pack(catalog.path, tmp_path / "packed.cdb")
    assert Catalog.open(tmp_path / "packed.cdb").members == ()


def test_commands_read_it_as_the_folder(catalog: Catalog, packed: Catalog, tmp_path: Path) -> None:
    assert check(packed.path) == []
    told, again = (
        [line for line in describe(path).splitlines() if not line.startswith(OTHERWISE)]
        for path in (catalog.path, packed.path)
    )
    assert told == again
    assert "one HDF5 file for each member" in describe(packed.path)
    for number, of in enumerate((catalog, packed)):
        export(of, tmp_path / f"{number}", "nerf", appearance="dvr")
    assert contents(tmp_path / "0") == contents(tmp_path / "1")
    assert packed._repr_html_().count("<img") == catalog._repr_html_().count("<img") > 0


def test_it_takes_no_members_and_is_merged_with_packed_ones_alone(
    catalog: Catalog, packed: Catalog, tmp_path: Path
) -> None:
    with pytest.raises(CatalogError, match="is packed"):
        add_member(packed, "third", 150.0)
    for pair in ((catalog.path, packed.path), (packed.path, catalog.path)):
        with pytest.raises(CatalogError, match=r"packed\.cdb is packed and .* is not: `catalogs unpack`"):
            merge(tmp_path / "all.cdb", pair)
    with pytest.raises(CatalogError, match="packed already"):
        pack(packed.path, tmp_path / "twice.cdb")
    with pytest.raises(CatalogError, match="not packed"):
        unpack(catalog.path, tmp_path / "twice.cdb")


def test_new_members_are_taken_in_and_strangers_refused(catalog: Catalog, packed: Catalog, tmp_path: Path) -> None:
    assert pack(catalog.path, packed.path) == Transferred(0, 2)
    add_member(catalog, "third", 150.0)
    assert pack(catalog.path, packed.path) == Transferred(1, 2)
    assert [m.name for m in packed.members] == ["first", "second", "third"]
    other = Catalog.create(tmp_path / "other.cdb", make_plan())
    add_member(other, "first", 121.0)
    with pytest.raises(CatalogError, match="has a member first that"):
        pack(other.path, packed.path)
    with pytest.raises(CatalogError, match="was made with other"):
        pack(Catalog.create(tmp_path / "small.cdb", small_plan()).path, packed.path)
    with pytest.raises(CatalogError, match="was made with other layout"):
        unpack(packed.path, Catalog.create(tmp_path / "p.cdb", packed.plan).path)
    with pytest.raises(CatalogError, match="the catalog itself"):
        pack(catalog.path, catalog.path)


def test_a_damaged_picture_is_not_packed(catalog: Catalog, tmp_path: Path) -> None:
    path = catalog.image_path("second", "iso", 3)
    path.write_bytes(path.read_bytes()[:-20])
    with pytest.raises(ImageError, match=r"members/second/iso/003\.png is damaged"):
        pack(catalog.path, tmp_path / "packed.cdb")
    assert Catalog.open(tmp_path / "packed.cdb").unfinished() == []


def test_damage_is_found_and_set_aside(catalog: Catalog, packed: Catalog) -> None:
    path = packed.path / "members/first" / PACK
    data = bytearray(path.read_bytes())
    data[len(data) // 2] ^= 1
    path.write_bytes(bytes(data))
    (finding,) = check(packed.path)
    assert (finding.member, "damaged" in finding.problem) == ("first", True)
    with pytest.raises(ImageError, match=PACK):
        _ = [packed.images("first", appearance) for appearance in packed.appearance_names]
    repaired = repair(packed.path)
    assert [member.name for member in repaired.set_aside] == ["first"]
    assert repaired.findings == ()
    assert pack(catalog.path, packed.path) == Transferred(1, 1)
    assert check(packed.path) == []


def test_the_command_says_what_it_did(catalog: Catalog, tmp_path: Path) -> None:
    paths = [str(tmp_path / name) for name in ("packed.cdb", "again.cdb")]
    result = CliRunner().invoke(main, ["pack", str(catalog.path), paths[0]])
    assert (result.exit_code, "2 members packed, 0 were there" in result.output) == (0, True)
    result = CliRunner().invoke(main, ["unpack", *paths])
    assert (result.exit_code, "2 members unpacked, 0 were there" in result.output) == (0, True)
    result = CliRunner().invoke(main, ["unpack", *paths[::-1]])
    assert (result.exit_code, "Error: " in result.output, "Traceback" in result.output) == (1, True, False)


@pytest.mark.slow
@pytest.mark.parametrize("loss", ["everything", IN_TURN])
@in_small_process
def test_dead_at_every_operation_the_same_command_completes_it(folder: Path, loss: str) -> None:
    catalog = Catalog.create(folder / "whole.cdb", small_plan())
    for number, name in enumerate("ab"):
        add_member(catalog, name, 110.0 + number, seed=number)
    pack(catalog.path, folder / "packed.cdb")
    undisturbed = contents(folder / "packed.cdb")
    disk = MortalDisk(-1, "after", folder)
    disk.install()
    pack(catalog.path, folder / "count.cdb")
    disk.remove()
    assert disk.count > 20
    for step in range(1, disk.count + 1):
        path = folder / f"{step}.cdb"

        def work(path: Path = path, step: int = step) -> None:
            MortalDisk(step, loss, path).install()
            pack(catalog.path, path)

        assert os.WTERMSIG(in_child(work)[1]()) == signal.SIGKILL, f"{step} of {disk.count}"
        if (path / "catalog.json").is_file():
            for member in Catalog.open(path).members:
                for appearance in member.appearances:
                    Catalog.open(path).images(member, appearance)
        pack(catalog.path, path)
        assert contents(path) == undisturbed, f"{loss} operation {step} of {disk.count}"
        shutil.rmtree(path)
