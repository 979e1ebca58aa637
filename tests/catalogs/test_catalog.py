"""Members are there whole or not at all, and what disagrees is named before anything is written."""

from __future__ import annotations

import errno
import json
import os
from pathlib import Path

import numpy as np
import pytest

from catalogs import cinema, durable
from catalogs.cameras import orbit
from catalogs.catalog import Catalog, CatalogError
from catalogs.images import ImageError
from catalogs.parameters import Parameter, ParameterSpace
from tests.catalogs.conftest import add_member, make_plan, picture


def tree(path: Path) -> dict[str, bytes]:
    """Every file below `path` but the lock."""
    return {str(p.relative_to(path)): p.read_bytes() for p in path.rglob("*") if p.is_file() and p.name != ".lock"}


def test_what_was_written_is_read(catalog: Catalog) -> None:
    again = Catalog.open(catalog.path)
    assert [m.name for m in again.members] == ["first", "second"]
    member = again.member("first")
    assert member.parameters == {"Re": 120.0, "Pr": 1.0}
    assert np.array_equal(again.image(member, "iso", 7), picture(1107))
    assert np.array_equal(again.images("second", "dvr", [3, 1]), np.stack([picture(2003), picture(2001)]))
    kept = member.summary()
    assert kept is not None
    assert kept.clipped_fraction == 0.01
    assert again.plan.differences(make_plan()) == []


def test_the_table_names_every_image_in_the_agreed_order(catalog: Catalog) -> None:
    header, rows = cinema.parse((catalog.path / "data.csv").read_bytes().decode())
    views = ["member", "view", "phi", "theta", "split", "member_split", "view_split"]
    assert header == ["Re", "Pr", "appearance", "isovalue", *views, "FILE"]
    assert len(rows) == 2 * 2 * 12
    assert all((catalog.path / row[-1]).is_file() for row in rows)
    assert cinema.header_problems(header) == cinema.column_problems(header, rows) == []
    of = {(row[4], int(row[5])): row[8] for row in rows}
    assert of["first", 0] == "test"
    assert of["first", 1] == "train"
    assert of["first", 9] == "validation"
    assert {split for (name, _), split in of.items() if name == "second"} == {"test"}


def test_creating_twice_opens_and_another_plan_is_refused(catalog: Catalog) -> None:
    before = tree(catalog.path)
    assert len(Catalog.create(catalog.path, make_plan()).members) == 2
    with pytest.raises(CatalogError, match="bounds"):
        Catalog.create(catalog.path, make_plan(bounds=((0, 0, 0), (1, 1, 1))))
    assert tree(catalog.path) == before


@pytest.mark.parametrize(
    ("name", "parameters", "options", "message"),
    [
        ("first", {"Re": 150.0, "Pr": 1.0}, {}, "already"),
        ("third", {"Re": 120.0, "Pr": 1.0}, {}, "already"),
        ("third", {"Re": 150.0}, {}, "missing"),
        ("third", {"Re": 150.0, "Pr": 1.0, "Ma": 0.1}, {}, "unknown"),
        ("third", {"Re": float("nan"), "Pr": 1.0}, {}, "finite"),
        ("../third", {"Re": 150.0, "Pr": 1.0}, {}, "name"),
        (".third", {"Re": 150.0, "Pr": 1.0}, {}, "name"),
        ("third", {"Re": 150.0, "Pr": 1.0}, {"split": "tets"}, "split"),
        ("third", {"Re": 150.0, "Pr": 1.0}, {"cameras": orbit((0, 0, 0), 1, width=4, height=4)}, "shared"),
    ],
)
def test_a_wrong_member_is_refused_and_nothing_changes(
    catalog: Catalog, name: str, parameters: dict[str, float], options: dict[str, object], message: str
) -> None:
    before = tree(catalog.path)
    with pytest.raises(ValueError, match=message):
        catalog.begin_member(name, parameters, **options)  # type: ignore[arg-type]
    assert tree(catalog.path) == before


def test_parameters_out_of_bounds_warn_and_are_recorded(catalog: Catalog) -> None:
    with pytest.warns(UserWarning, match="outside its bounds"):
        add_member(catalog, "wild", 250.0)
    assert catalog.member("wild").parameters["Re"] == 250.0


@pytest.mark.parametrize("bad", [np.zeros((12, 15, 4), np.uint8), np.zeros((12, 16, 3), np.uint8)])
def test_an_image_of_the_wrong_size_leaves_no_member(catalog: Catalog, bad: np.ndarray) -> None:
    before = tree(catalog.path)
    with pytest.raises(CatalogError, match="view 0"), catalog.begin_member("third", {"Re": 150.0, "Pr": 1.0}) as writer:
        writer.write_image("dvr", 0, bad)
    assert tree(catalog.path) == before


def test_an_incomplete_member_is_not_stored(catalog: Catalog) -> None:
    before = tree(catalog.path)
    with (
        pytest.raises(CatalogError, match="lacks 23 images"),
        catalog.begin_member("third", {"Re": 150.0, "Pr": 1.0}) as w,
    ):
        w.write_image("dvr", 0, picture(0))
    assert tree(catalog.path) == before


def test_a_full_disk_changes_nothing(catalog: Catalog, monkeypatch: pytest.MonkeyPatch) -> None:
    before = tree(catalog.path)

    def full(path: Path, data: bytes) -> None:
        path.write_bytes(data[: len(data) // 2])
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), str(path))

    monkeypatch.setattr(durable, "write", full)
    with pytest.raises(OSError, match="No space left"):
        add_member(catalog, "third", 150.0)
    assert tree(catalog.path) == before
    monkeypatch.undo()
    add_member(catalog, "third", 150.0)
    assert len(catalog.members) == 3


@pytest.mark.skipif(os.geteuid() == 0, reason="root may write anywhere")
def test_a_read_only_folder_is_named(catalog: Catalog) -> None:
    members = catalog.path / "members"
    members.chmod(0o500)
    try:
        with pytest.raises(PermissionError, match="members"):
            add_member(catalog, "third", 150.0)
    finally:
        members.chmod(0o700)


def test_a_newer_schema_is_refused(catalog: Catalog) -> None:
    path = catalog.path / "catalog.json"
    record = json.loads(path.read_text())
    path.write_text(json.dumps({**record, "schema": 99}))
    with pytest.raises(CatalogError, match="newer"):
        Catalog.open(catalog.path)


@pytest.mark.parametrize("damage", ["", "{", "[]", '{"schema": 1}', '{"schema": "1"}'])
def test_a_damaged_catalog_is_named(catalog: Catalog, damage: str) -> None:
    (catalog.path / "catalog.json").write_text(damage)
    with pytest.raises(CatalogError, match="catalog"):
        Catalog.open(catalog.path)


def test_a_missing_catalog_or_member_is_named(catalog: Catalog, tmp_path: Path) -> None:
    with pytest.raises(CatalogError, match="missing"):
        Catalog.open(tmp_path)
    with pytest.raises(CatalogError, match="first, second"):
        catalog.member("third")


def test_a_missing_or_damaged_image_is_named(catalog: Catalog) -> None:
    path = catalog.image_path("first", "dvr", 3)
    path.write_bytes(path.read_bytes()[:60])
    with pytest.raises(ImageError, match=r"003\.png"):
        catalog.image("first", "dvr", 3)
    path.unlink()
    with pytest.raises(ImageError, match="missing"):
        catalog.image("first", "dvr", 3)


@pytest.mark.parametrize(
    "changes",
    [
        {"bounds": ((0, 0, 0), (0, 1, 1))},
        {"view_splits": ("train",)},
        {"view_splits": ("tain",) * 12},
        {"image_format": "gif"},
        {"appearances": ()},
        {"space": ParameterSpace((Parameter("file_number", 0.0, 1.0),))},
        {"space": ParameterSpace((Parameter("view", 0.0, 1.0),))},
    ],
)
def test_an_impossible_plan_is_refused(changes: dict[str, object]) -> None:
    with pytest.raises(CatalogError):
        make_plan(**changes)


def test_members_may_bring_their_own_cameras(tmp_path: Path) -> None:
    made = Catalog.create(tmp_path / "own.cdb", make_plan(cameras=(), view_splits=()))
    cameras = orbit((0, 0, 0), 2, width=8, height=8, frequency=1)[:3]
    with made.begin_member("a", {"Re": 150.0, "Pr": 1.0}, cameras=cameras, view_splits=["train"] * 3) as writer:
        for view in range(3):
            for appearance in made.appearance_names:
                writer.write_image(appearance, view, picture(view, 8, 8))
    read = Catalog.open(made.path).member("a")
    assert all(
        np.array_equal(a.world_to_camera, b.world_to_camera) and a.fx == b.fx
        for a, b in zip(read.cameras, cameras, strict=True)
    )


def test_its_repr_says_what_is_in_it(catalog: Catalog) -> None:
    assert "2 (1 train, 0 validation, 1 test)" in repr(catalog)
    assert "Re in [100, 200]" in repr(catalog)


def test_other_things_are_not_taken_over(tmp_path: Path) -> None:
    path = tmp_path / "precious.cdb"
    path.mkdir()
    (path / "thesis.tex").write_text("years of work")
    with pytest.raises(CatalogError, match=r"thesis\.tex"):
        Catalog.create(path, make_plan())
    assert (path / "thesis.tex").read_text() == "years of work"
