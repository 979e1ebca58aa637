"""The hook on bad input and full disks: one clear error, and nothing changes."""

from __future__ import annotations

import errno
import json
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import insitu
from catalogs.files import durable
from catalogs.vocabulary.appearance import Isosurface, VolumeRendering
from catalogs.vocabulary.scene import ViewPlan
from tests.support.hooked import FUNCTION, SPACING, VOLUME, blob, render, tree


def with_nan() -> np.ndarray:
    field = blob()
    field[2, 3, 4] = np.nan
    return field


BAD: dict[str, tuple[Callable[[], Any], dict[str, Any], str]] = {
    "nan": (with_nan, {}, "(?i)nan|finite"),
    "infinity": (lambda: np.where(blob() > 0.9, np.inf, blob()), {}, "(?i)inf|finite"),
    "empty": (lambda: np.zeros((0, 5, 5)), {}, "(?i)sample|empty|size|axis"),
    "one voxel thick": (lambda: np.zeros((1, 5, 5)), {}, "(?i)sample|axis|thick"),
    "two-dimensional": (lambda: np.zeros((5, 5)), {}, "(?i)dimension|axes|shape"),
    "text": (lambda: np.full((3, 3, 3), "x"), {}, "(?i)number|type|dtype"),
    "complex": (lambda: np.zeros((3, 3, 3), complex), {}, "(?i)complex|number|type|dtype"),
    "flat spacing": (blob, {"spacing": (0.1, 0.1, 0.0)}, "(?i)spacing"),
    "no spacing": (blob, {"spacing": None}, "(?i)spacing"),
    "reaching out of the box": (blob, {"origin": (5.0, 0.0, 0.0)}, "(?i)box|origin"),
    "other transfer function": (blob, {"appearances": VolumeRendering("other", FUNCTION)}, "(?i)appearance"),
    "other views": (blob, {"views": ViewPlan(frequency=2, width=24, height=24)}, "(?i)views"),
    "ghosts of one process": (blob, {"ghosts": 1}, "layers of a block"),
    "half a ghost layer": (blob, {"ghosts": 0.5}, "ghosts must be a number of layers"),
    "unknown split": (blob, {"split": "tset"}, "split"),
}


@pytest.mark.parametrize("case", BAD)
def test_bad_input_gets_one_clear_error_and_changes_nothing(catalog: Path, case: str) -> None:
    make, changes, message = BAD[case]
    before = tree(catalog)
    with pytest.raises((ValueError, TypeError), match=message):
        render(catalog, make(), reynolds=160.0, **changes)
    assert tree(catalog) == before


@pytest.mark.parametrize(
    ("parameters", "message"),
    [
        ({"Re": 150.0}, "already"),
        ({}, "missing"),
        ({"Re": 160.0, "Ma": 0.1}, "unknown"),
        ({"Reynolds": 160.0}, "Reynolds"),
        ({"Re": float("nan")}, "finite"),
    ],
)
def test_wrong_parameters_change_nothing(catalog: Path, parameters: dict[str, float], message: str) -> None:
    before = tree(catalog)
    with pytest.raises(ValueError, match=message):
        insitu.render_member(blob(), parameters, catalog=catalog, spacing=SPACING)
    assert tree(catalog) == before


def test_a_bad_first_member_leaves_no_catalog(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match=r"(?i)nan|finite"):
        render(tmp_path / "a.cdb", with_nan())
    assert not (tmp_path / "a.cdb").exists()


def test_holes_are_transparent_on_request(catalog: Path) -> None:
    result = render(catalog, with_nan(), reynolds=160.0, nan="transparent")
    assert np.isfinite(result.range).all()


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"space": None}, "space="),
        ({"appearances": None}, "appearances="),
        ({"appearances": ()}, "appearances="),
        ({"bounds": ((0, 0, 0), (1, 1, 0))}, "low < high"),
        ({"sample_distance": -1.0}, "positive"),
        ({"sample_distance": {"other": 0.1}}, "dvr"),
        ({"target_decibels": 40.0}, "not both"),
        ({"sample_distance": None, "target_decibels": 90.0}, "58"),
    ],
)
def test_a_plan_that_cannot_be_is_refused_before_anything_is_written(
    tmp_path: Path, changes: dict[str, Any], message: str
) -> None:
    with pytest.raises(ValueError, match=message):
        render(tmp_path / "a.cdb", **changes)
    assert list(tmp_path.iterdir()) == []


def test_a_newer_catalog_is_refused(catalog: Path) -> None:
    path = catalog / "catalog.json"
    path.write_text(json.dumps({**json.loads(path.read_text()), "schema": 99}))
    before = tree(catalog)
    with pytest.raises(ValueError, match="newer"):
        render(catalog, reynolds=160.0)
    assert tree(catalog) == before


def test_a_full_disk_keeps_nothing_of_the_member(catalog: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    before = tree(catalog)

    def full(path: Path, data: bytes) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), str(path))

    monkeypatch.setattr(durable, "write", full)
    with pytest.raises(OSError, match="could not be stored"):
        render(catalog, reynolds=160.0)
    assert tree(catalog) == before


@pytest.mark.parametrize("code", [errno.EACCES, errno.EROFS])
def test_a_read_only_folder_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, code: int) -> None:
    def refuse(path: Any, *_: Any, **__: Any) -> None:
        raise OSError(code, os.strerror(code), str(path))

    monkeypatch.setattr(os, "mkdir", refuse)  # as root, under which tests may run, no folder is read-only
    with pytest.raises(OSError, match=r"make room or permission.*a\.cdb") as caught:
        render(tmp_path / "a.cdb")
    assert caught.value.errno == code
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"name": "../x"}, "invalid member name.*'../x'"),
        ({"name": "12"}, "read as a number"),
        ({"time": float("nan")}, "time must be a finite number, got nan"),
    ],
)
def test_a_first_member_that_cannot_be_recorded_leaves_no_catalog(
    tmp_path: Path, changes: dict[str, Any], message: str
) -> None:
    with pytest.raises(ValueError, match=message):
        render(tmp_path / "a.cdb", blob(), 150.0, **changes)
    assert list(tmp_path.iterdir()) == []


def test_an_unknown_argument_is_named(tmp_path: Path) -> None:
    with pytest.raises(TypeError, match="spacings"):
        insitu.render_member(blob(), {"Re": 1.0}, catalog=tmp_path / "a.cdb", spacings=SPACING)


@pytest.mark.parametrize("look", [VOLUME, Isosurface("iso", 0.5)])
def test_pictures_larger_than_opengl_draws_leave_no_catalog(tmp_path: Path, look: Any) -> None:
    changes = {"sample_distance": None} if look is not VOLUME else {}
    with pytest.raises(ValueError, match="choose width and height up to"):
        render(tmp_path / "a.cdb", appearances=look, views=ViewPlan(1, 200_000, 8), **changes)
    assert list(tmp_path.iterdir()) == []


def test_ghosts_of_one_process_do_not_stop_a_solver_that_goes_on(catalog: Path) -> None:
    with pytest.warns(UserWarning, match="layers of a block"):
        assert "layers of a block" in str(render(catalog, reynolds=160.0, ghosts=1, on_error="warn").error)
    assert render(catalog, reynolds=160.0, ghosts=(0, 0, 0)).error == ""


class Foreign:
    """An object of another package, which holds an array."""

    def __init__(self, values: np.ndarray) -> None:
        self.data = values


@pytest.mark.parametrize(
    ("field", "message"),
    [
        (None, "got NoneType: was it computed"),
        ("u.vti", "got str: pass numpy.asarray of its values"),
        (Foreign(blob()), r"got tests\.insitu\.hook\.test_bad_input\.Foreign: pass its \.data; dims="),
        (object(), "got object: pass numpy.asarray of its values"),
        ([[1.0, 2.0], [3.0]], "got list .*inhomogeneous"),
    ],
)
def test_what_is_no_field_is_named_with_the_cure(tmp_path: Path, field: Any, message: str) -> None:
    with pytest.raises(TypeError, match=message):
        insitu.render_member(
            field, {"Re": 1.5}, catalog=tmp_path / "a.cdb", space={"Re": (1, 2)}, appearances=VOLUME, spacing=SPACING
        )
    assert list(tmp_path.iterdir()) == []


def test_axes_in_another_order_are_said_to_be_that(tmp_path: Path) -> None:
    heard: list[str] = []
    plan: dict[str, Any] = {
        "space": {"Re": (1, 2)},
        "appearances": VOLUME,
        "sample_distance": 0.1,
        "views": ViewPlan(1, 8, 8),
    }
    with insitu.Session(tmp_path / "a.cdb", **plan, warn=lambda note: heard.append(str(note))) as session:
        session.render_member(blob()[:6, :8], {"Re": 1.0})
        with pytest.raises(ValueError, match=r"Its sides .* dims="):
            session.render_member(blob()[:6, :8].transpose(1, 2, 0), {"Re": 2.0})
        with pytest.raises(ValueError, match=r"spacing must be three finite numbers.*'abc'"):
            session.render_member(blob()[:6, :8], {"Re": 2.0}, spacing="abc")
    assert heard == [
        "the first field states no spacing, so its values are 1 apart along every axis: pass spacing=(x, y, z) if not"
    ]
