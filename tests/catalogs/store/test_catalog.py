"""Members are there whole or not at all, and what disagrees is named before anything is written."""

from __future__ import annotations

import errno
import json
import os
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from catalogs.files import cinema, durable
from catalogs.files.images import ImageError
from catalogs.store.catalog import Catalog, CatalogError
from catalogs.tools.check import check
from catalogs.vocabulary.appearance import Isosurface
from catalogs.vocabulary.cameras import orbit
from tests.catalogs.conftest import add_member, make_plan, picture
from tests.support.catalog_files import tree


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


def test_members_of_many_views_do_not_each_keep_the_splits_of_all(catalog: Catalog) -> None:
    again = Catalog.open(catalog.path)
    assert all(member.view_splits is again.plan.view_splits for member in again.members)
    record = catalog.path / "members" / "first" / "member.json"
    other = [*again.plan.view_splits[:-1], "validation"]
    record.write_text(json.dumps({**json.loads(record.read_text()), "view_splits": other}))
    assert again.member("first").view_splits == tuple(other)


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
        ("007", {"Re": 150.0, "Pr": 1.0}, {}, "would be read as a number"),
        ("nan", {"Re": 150.0, "Pr": 1.0}, {}, "would be read as a number"),
        ("x" * 101, {"Re": 150.0, "Pr": 1.0}, {}, "100 letters"),
        ("third", {"Re": 150.0, "Pr": 1.0}, {"provenance": {"time": float("nan")}}, "provenance of member third"),
        ("third", {"Re": 150.0, "Pr": 1.0}, {"provenance": {"field": np.zeros(3)}}, "provenance of member third"),
        ("third", {"Re": 150.0, "Pr": 1.0}, {"view_splits": ["test"]}, "12 cameras"),
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


def test_a_warning_of_bounds_names_the_line_of_the_caller(catalog: Catalog) -> None:
    with pytest.warns(UserWarning, match="outside its bounds") as caught:
        catalog.begin_member("wild", {"Re": 250.0, "Pr": 1.0})
    assert [w.filename for w in caught] == [__file__]


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


@pytest.mark.parametrize("left", range(31))
def test_a_disk_that_fills_at_any_write_changes_nothing(
    created_catalog: Catalog, monkeypatch: pytest.MonkeyPatch, left: int
) -> None:
    """24 images, summary, rows and record of the member, the new table and the journal: the disk is full after `left` of them."""
    catalog = created_catalog
    before, count = tree(catalog.path), [0]

    def filling(write: Callable[[Path, bytes], None]) -> Callable[[Path, bytes], None]:
        def full(path: Path, data: bytes) -> None:
            count[0] += 1
            if count[0] <= left:
                write(path, data)
                return
            write(path, data[: len(data) // 2])
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), str(path))

        return full

    monkeypatch.setattr(durable, "write", filling(durable.write))
    monkeypatch.setattr(durable, "append", filling(durable.append))
    if left < 28:
        with pytest.raises(OSError, match="No space left"):
            add_member(catalog, "third", 150.0)
        assert tree(catalog.path) == before
        monkeypatch.undo()
    add_member(catalog, "third", 150.0 if left < 28 else 151.0)
    assert check(catalog.path) == []


@pytest.mark.parametrize("operation", ["sync", "rename"])
def test_a_disk_that_fails_changes_nothing(catalog: Catalog, monkeypatch: pytest.MonkeyPatch, operation: str) -> None:
    before = tree(catalog.path)

    def fail(*paths: Path) -> None:
        raise OSError(errno.EIO, os.strerror(errno.EIO), str(paths[0]))

    monkeypatch.setattr(durable, operation, fail)
    with pytest.raises(OSError, match="Input/output error"):
        add_member(catalog, "third", 150.0)
    assert tree(catalog.path) == before


@pytest.mark.parametrize(
    ("schema", "message"), [(99, "newer"), (6, "newer"), (1, "from 2 on"), (0, "damaged"), (True, "damaged")]
)
def test_other_schemas_are_refused(catalog: Catalog, schema: int, message: str) -> None:
    path = catalog.path / "catalog.json"
    record = json.loads(path.read_text())
    path.write_text(json.dumps({**record, "schema": schema}))
    before = tree(catalog.path)
    with pytest.raises(CatalogError, match=message):
        Catalog.open(catalog.path)
    with pytest.raises(CatalogError, match=message):
        Catalog.create(catalog.path, make_plan())
    assert tree(catalog.path) == before


@pytest.mark.parametrize("schema", [2, 3, 4, 5])
def test_schemas_that_differ_only_in_what_they_may_hold_are_read(catalog: Catalog, schema: int) -> None:
    path = catalog.path / "catalog.json"
    path.write_text(json.dumps({**json.loads(path.read_text()), "schema": schema}))
    assert len(Catalog.open(catalog.path).members) == 2
    add_member(Catalog.create(catalog.path, make_plan()), "third", 190.0)
    assert check(catalog.path) == []


def test_keys_that_a_later_version_added_are_ignored(catalog: Catalog) -> None:
    path = catalog.path / "catalog.json"
    path.write_text(json.dumps({**json.loads(path.read_text()), "comment": "new"}))
    assert len(Catalog.open(catalog.path).members) == 2


@pytest.mark.parametrize("damage", ["", "{", "[]", "[" * 9999, '{"schema": 1}', '{"schema": "1"}'])
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
        {"bounds": ((0, 0, 0), (1, 1, float("inf")))},
        {"bounds": ((0, 0, 0), 1)},
        {"background": (1.0, 1.0)},
        {"background": (255, 255, 255)},
        {"background": "white"},
        {"provenance": {"when": object()}},
        {"appearances": (Isosurface("a", 1.0), Isosurface("a", 2.0))},
        {"appearances": (Isosurface("../a", 1.0),)},
        {"appearances": (Isosurface("rows.csv", 1.0),)},
        {"appearances": (Isosurface("40", 40.0),)},
        {"view_splits": ("train",)},
        {"view_splits": ("tain",) * 12},
        {"image_format": "gif"},
        {"appearances": ()},
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


def test_images_on_a_background_are_opaque(tmp_path: Path) -> None:
    made = Catalog.create(tmp_path / "white.cdb", make_plan(background=(1, 1, 1)))
    with (
        pytest.raises(CatalogError, match="transparent"),
        made.begin_member("a", {"Re": 150.0, "Pr": 1.0}) as writer,
    ):
        writer.write_image("dvr", 0, picture(0))
    with made.begin_member("a", {"Re": 150.0, "Pr": 1.0}) as writer:
        for appearance, view in writer.missing():
            writer.write_image(appearance, view, np.full((12, 16, 4), 255, np.uint8))
    assert (made.images("a", "dvr")[..., 3] == 255).all()


def test_float_images_are_kept_to_the_bit(tmp_path: Path) -> None:
    made = Catalog.create(tmp_path / "exact.cdb", make_plan(image_format="exr"))
    pixels = np.random.default_rng(0).random((12, 16, 4)).astype(np.float32)
    with made.begin_member("a", {"Re": 150.0, "Pr": 1.0}) as writer:
        for appearance, view in writer.missing():
            writer.write_image(appearance, view, pixels)
    assert np.array_equal(made.images("a", "iso", [3], dtype="float32")[0], pixels)
    assert check(made.path) == []


def test_provenance_in_memory_is_what_a_file_gives_back(tmp_path: Path) -> None:
    made = Catalog.create(tmp_path / "a.cdb", make_plan(provenance={"step": (1, 2), "of": {"vtk": "9"}}))
    assert made.plan.provenance == Catalog.open(made.path).plan.provenance == {"step": [1, 2], "of": {"vtk": "9"}}


def test_a_stray_folder_is_no_member(catalog: Catalog) -> None:
    (catalog.path / "members/notes").mkdir()
    assert [m.name for m in catalog.members] == ["first", "second"]
    assert "notes" not in catalog


def test_its_repr_says_what_is_in_it(catalog: Catalog) -> None:
    assert "2 members (1 train, 0 validation, 1 test)" in repr(catalog)
    assert "Re in [100, 200]" in repr(catalog)
    (catalog.path / "members/first/member.json").write_text("{}")
    assert "damaged" in repr(catalog)


def test_other_things_are_not_taken_over(tmp_path: Path) -> None:
    path = tmp_path / "precious.cdb"
    path.mkdir()
    (path / "thesis.tex").write_text("years of work")
    with pytest.raises(CatalogError, match=r"thesis\.tex"):
        Catalog.create(path, make_plan())
    assert (path / "thesis.tex").read_text() == "years of work"


@pytest.mark.parametrize(
    ("before", "after", "message"),
    [
        (
            '"color": [',
            '"color": ["red", ',
            r"appearance 'iso': color, .*, must be 3 numbers, got 4: \['red', 0.85, 0.85",
        ),
        ('"isovalue": 0.25', '"isovalue": null', "appearance 'iso': isovalue must be a finite number, got None"),
        ('"isovalue": 0.25', '"isovalue": NaN', "appearance 'iso': isovalue must be a finite number, got nan"),
        (
            '"opacity_unit_distance": 0.1',
            '"opacity_unit_distance": -1',
            "appearance 'dvr' of .* must be positive, got -1",
        ),
        ('"low": 100.0', '"low": "x"', "parameter Re: low, one of its bounds, must be a finite number, got 'x'"),
        ('"fx": ', '"fx": -', "a camera's fx must be positive"),
    ],
)
def test_a_poisoned_catalog_says_in_one_sentence_what_is_wrong(
    catalog: Catalog, before: str, after: str, message: str
) -> None:
    path = catalog.path / "catalog.json"
    text = " ".join(path.read_text().split()).replace("[ ", "[")
    assert before in text
    path.write_text(text.replace(before, after, 1))
    with pytest.raises(CatalogError, match=rf"catalog\.json is damaged: {message}") as caught:
        Catalog.open(catalog.path)
    assert len(str(caught.value).splitlines()) == 1


def test_a_plan_that_json_cannot_hold_leaves_nothing(tmp_path: Path) -> None:
    plan = make_plan()
    object.__setattr__(plan.appearances[1], "isovalue", float("nan"))  # past its constructor
    with pytest.raises(CatalogError, match="this plan can't be recorded"):
        Catalog.create(tmp_path / "a.cdb", plan)
    assert list(tmp_path.iterdir()) == []
