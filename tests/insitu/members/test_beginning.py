"""Mistakes in a session's arguments are raised when it is made, also where later ones must not be."""

from pathlib import Path
from typing import Any

import pytest

import insitu
from catalogs.store.catalog import Catalog
from catalogs.vocabulary.appearance import Isosurface, VolumeRendering
from catalogs.vocabulary.scene import ViewPlan
from tests.support.hooked import FUNCTION, SPACING, blob

VOLUME = VolumeRendering("dvr", FUNCTION)
GOOD: dict[str, Any] = {"space": {"Re": (100.0, 200.0)}, "appearances": VOLUME}
BOX = (0.0, 0.0, 0.0), (3.0, 3.0, 3.0)
WRONG: dict[str, tuple[dict[str, Any], str]] = {
    "no space": ({"space": None}, "needs space="),
    "no appearances": ({"appearances": None}, "needs appearances="),
    "none at all": ({"appearances": []}, "needs appearances="),
    "one name twice": ({"appearances": [VOLUME, Isosurface("dvr", 0.5)]}, "unique names"),
    "a name that is none": ({"appearances": Isosurface("a/b", 0.5)}, "invalid appearance name.*'a/b'"),
    "a step of another appearance": ({"sample_distance": {"iso": 0.1}}, r"dvr, got iso"),
    "a step longer than the box": ({"sample_distance": 9.0, "bounds": BOX}, "sample_distance = 9 does not fit the box"),
    "a step that rounding swallows": ({"sample_distance": 1e-7, "bounds": BOX}, "lies between"),
    "more than 8 bits hold": ({"target_decibels": 1e9}, "between 0 and 58.*1e.09"),
    "progress": ({"progress": 5}, "progress must be a function, got 5"),
    "warn": ({"warn": 5}, "warn must be a function, got 5"),
    "provenance": ({"provenance": 5}, "provenance must be a mapping.*got 5"),
    "provenance of objects": ({"provenance": {"when": object()}}, "provenance must hold JSON values"),
    "nan": ({"nan": "yes"}, "nan must be one of"),
    "existing": ({"existing": "keep"}, "existing must be one of"),
    "on_error": ({"on_error": "print"}, "on_error must be one of"),
    "pictures that nothing draws": ({"views": ViewPlan(1, 100_000, 100_000)}, "choose width and height up to"),
    "fields that are not shown": ({"fields": {"Q": "m", "R": "m"}}, "fields"),
    "blanks": ({"space": {" Re": (0, 1)}}, "call it 'Re'"),
}


@pytest.mark.parametrize("case", WRONG)
@pytest.mark.parametrize("on_error", ["raise", "warn"])
def test_a_session_names_what_is_wrong_before_the_run(case: str, on_error: str, tmp_path: Path) -> None:
    changes, message = WRONG[case]
    with pytest.raises(ValueError, match=message):
        insitu.Session(tmp_path / "a.cdb", **{**GOOD, "on_error": on_error, **changes})
    given = {key: value for key, value in {**GOOD, "on_error": on_error, **changes}.items() if value is not None}
    with pytest.raises(ValueError, match=message):
        insitu.render_member(blob(), {"Re": 150.0}, catalog=tmp_path / "a.cdb", spacing=SPACING, **given)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("made", ["a file", "a folder with other files", "another ending", "no path", "below a file"])
def test_a_place_where_no_catalog_can_be_is_named_before_the_run(made: str, tmp_path: Path) -> None:
    path: Any = tmp_path / "a.cdb"
    if made in ("a file", "below a file"):
        path.write_text("")
    if made == "a folder with other files":
        (path / "x").mkdir(parents=True)
    path = {"another ending": tmp_path / "a.db", "no path": 5, "below a file": path / "b.cdb"}.get(made, path)
    with pytest.raises((ValueError, OSError), match=r"a\.cdb|a\.db|got 5"):
        insitu.Session(path, **GOOD, on_error="warn")


def test_a_good_session_writes_nothing_before_its_first_member(tmp_path: Path) -> None:
    with insitu.Session(tmp_path / "below" / "a.cdb", **GOOD):
        assert list(tmp_path.iterdir()) == []


def test_a_catalog_that_is_there_needs_no_more(tmp_path: Path) -> None:
    how: dict[str, Any] = {"views": ViewPlan(frequency=1, width=8, height=8), "sample_distance": 0.1}
    insitu.render_member(blob(), {"Re": 150.0}, catalog=tmp_path / "a.cdb", spacing=SPACING, **GOOD, **how)
    with insitu.Session(tmp_path / "a.cdb") as session:
        session.render_member(blob(), {"Re": 160.0}, spacing=SPACING)
    assert len(Catalog.open(tmp_path / "a.cdb").members) == 2
