"""A simulation that must not end for a picture: whatever fails is reported, recorded, and can be rendered later."""

from __future__ import annotations

import errno
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import insitu
from catalogs.files import durable
from catalogs.store.catalog import Catalog
from catalogs.store.missing import MISSING
from catalogs.tools.check import check
from catalogs.tools.show import describe
from catalogs.vocabulary.appearance import VolumeRendering
from catalogs.vocabulary.scene import ViewPlan
from insitu.hook import writer as hook
from insitu.members.failures import MissingMemberWarning
from tests.support.hooked import FUNCTION, SPACING, blob, tree

PLAN: dict[str, Any] = {
    "space": {"Re": (100.0, 200.0)},
    "appearances": VolumeRendering("dvr", FUNCTION),
    "views": ViewPlan(frequency=1, width=8, height=8),
    "sample_distance": 0.1,
}
RE = {"Re": 160.0}


@pytest.fixture
def session(tmp_path: Path) -> insitu.Session:
    """A session that warns, with a catalog of one member."""
    session = insitu.Session(tmp_path / "a.cdb", on_error="warn", **PLAN)
    session.render_member(blob(), {"Re": 150.0}, spacing=SPACING)
    return session


class Broken(Exception):
    pass


def failing(error: BaseException) -> Any:
    def fails(*_: Any, **__: Any) -> Any:
        raise error

    return fails


def not_a_number() -> np.ndarray:
    return np.where(blob() > 0.5, np.nan, blob())


FIELDS: dict[str, tuple[Any, Any, dict[str, Any], str]] = {
    "NaN": (not_a_number(), RE, {}, "ValueError: .*NaN"),
    "two axes": (blob()[0], RE, {}, "ValueError: .*3 axes"),
    "no field": (None, RE, {}, "Error: "),
    "words": ("field.vti", RE, {}, "Error: "),
    "out of the box": (blob(), RE, {"spacing": 1.0}, "ValueError: the member reaches from"),
    "no spacing": (blob(), RE, {"spacing": "wide"}, "Error: "),
    "wrong names": (blob(), {"Ra": 1.0}, {}, "ValueError: parameters must be exactly"),
    "parameters that are none": (blob(), 160.0, {}, "ValueError: parameters must be values by name"),
    "a parameter that is none": (blob(), {"Re": np.nan}, {}, "ValueError: parameter Re must be finite"),
    "a name that is none": (blob(), RE, {"name": 5}, "CatalogError: .* got 5"),
    "a name that leaves": (blob(), RE, {"name": "../../x"}, r"CatalogError: .*'\.\./\.\./x'"),
    "a split that is none": (blob(), RE, {"split": "all"}, "ValueError: split must be one of"),
    "one that is there": (blob(), {"Re": 150.0}, {}, "CatalogError: .* already"),
    "a function that fails": (failing(Broken("boom")), RE, {}, "Broken: boom"),
    "recursion without end": (failing(RecursionError("deep")), RE, {}, "RecursionError: deep"),
    "no memory": (failing(MemoryError()), RE, {}, "MemoryError"),
}


@pytest.mark.parametrize("case", FIELDS)
def test_nothing_is_raised_into_a_solver(session: insitu.Session, case: str) -> None:
    field, parameters, changes, reason = FIELDS[case]
    before = {name: held for name, held in tree(session.path).items() if not name.startswith(MISSING)}
    with pytest.warns(MissingMemberWarning, match=reason) as caught:
        result = session.render_member(field, parameters, **{"spacing": SPACING, **changes})
    assert result.error
    assert result.error in session.failures[result.name]
    assert (result.images, result.skipped) == (0, False)
    assert "missing" in repr(result)
    assert [warning.filename for warning in caught] == [__file__]
    assert {name: held for name, held in tree(session.path).items() if not name.startswith(MISSING)} == before
    assert check(session.path) == []


@pytest.mark.parametrize(
    ("place", "broken", "reason"),
    [
        ((hook, "write_member"), None, ""),
        ((durable, "sync_tree"), OSError(errno.ENOSPC, "No space left on device"), "make room or permission"),
        ((durable, "rename"), OSError(errno.EROFS, "Read-only file system"), "Read-only file system"),
        ((hook, "write_member"), RuntimeError("no usable OpenGL on this machine"), "no usable OpenGL"),
        ((hook, "notes_on_member"), Broken("a bug of ours"), "a bug of ours"),
    ],
    ids=["nothing", "a full disk", "a disk that is read only", "OpenGL", "a bug"],
)
def test_what_fails_below_is_reported_and_can_be_rendered_later(
    session: insitu.Session, monkeypatch: Any, place: tuple[Any, str], broken: Exception | None, reason: str
) -> None:
    if broken is not None:
        with monkeypatch.context() as patch:
            patch.setattr(*place, failing(broken))
            with pytest.warns(MissingMemberWarning, match=reason):
                assert session.render_member(blob(), RE, spacing=SPACING).error
        assert list(session.failures) == ["Re-160.0"]
        assert "1 member, 1 missing" in repr(session)
    assert session.render_member(blob(), RE, spacing=SPACING).images == 12
    assert not session.failures
    assert Catalog.open(session.path).missing == ()
    assert check(session.path) == []


def test_a_later_look_finds_what_is_missing(session: insitu.Session) -> None:
    with pytest.warns(MissingMemberWarning):
        session.render_member(not_a_number(), RE, spacing=SPACING)
    session.close()
    made = Catalog.open(session.path)
    assert [(m.name, m.parameters) for m in made.missing] == [("Re-160.0", RE)]
    assert "missing     Re-160.0: ValueError:" in describe(session.path)
    assert "Re-160.0: ValueError:" in made._repr_html_()
    assert [m.name for m in made.members] == ["Re-150.0"]
    insitu.render_member(blob(), RE, catalog=session.path, spacing=SPACING)
    assert made.missing == ()
    assert "missing" not in describe(session.path)


def test_a_first_member_that_is_missing_is_recorded_when_there_is_a_catalog(tmp_path: Path) -> None:
    with insitu.Session(tmp_path / "a.cdb", on_error="warn", **PLAN) as session:
        with pytest.warns(MissingMemberWarning):
            session.render_member(not_a_number(), RE, spacing=SPACING)
        assert list(tmp_path.iterdir()) == []
        session.render_member(blob(), {"Re": 150.0}, spacing=SPACING)
    assert [m.name for m in Catalog.open(tmp_path / "a.cdb").missing] == ["Re-160.0"]


def test_warnings_that_are_errors_raise_no_more_than_others(session: insitu.Session, capsys: Any) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert session.render_member(not_a_number(), RE, spacing=SPACING).error
    assert "member Re-160.0 is missing: ValueError" in capsys.readouterr().err


@pytest.mark.parametrize("signal", [KeyboardInterrupt, SystemExit])
def test_who_wants_to_stop_can(session: insitu.Session, signal: type[BaseException]) -> None:
    with pytest.raises(signal):
        session.render_member(failing(signal()), RE, spacing=SPACING)
    assert not session.failures


def test_the_function_reports_what_is_wrong_with_a_catalog_that_was_fine(session: insitu.Session) -> None:
    (session.path / "catalog.json").write_text("{")
    with pytest.warns(MissingMemberWarning, match="member Re-160.0 is missing: CatalogError: .* is damaged") as caught:
        result = insitu.render_member(blob(), RE, catalog=session.path, spacing=SPACING, on_error="warn")
    assert "damaged" in result.error
    assert [warning.filename for warning in caught] == [__file__]
    with pytest.raises(ValueError, match="is damaged"):
        insitu.Session(session.path, on_error="warn")  # at the start of a run there is time to mend it


@pytest.mark.parametrize("wrong", [{"space": {"Re": (1.0, 2.0)}}, {"bounds": 5}, {"appearances": "dvr"}])
def test_mistakes_in_the_plan_are_raised_at_once(session: insitu.Session, wrong: dict[str, Any]) -> None:
    with pytest.raises(ValueError):  # noqa: PT011 - which sentence is a matter of other tests
        insitu.render_member(blob(), RE, catalog=session.path, spacing=SPACING, on_error="warn", **wrong)


def test_one_member_may_be_treated_otherwise_than_the_session_does(session: insitu.Session) -> None:
    with pytest.raises(ValueError, match="NaN"):
        session.render_member(not_a_number(), RE, spacing=SPACING, on_error="raise")


DUMPS: dict[str, Any] = {**PLAN, "space": {"nu": (0.0, 1.0), "k": (0.0, 1.0), "time": (0.0, 10.0)}}


def test_failed_dumps_of_one_run_are_named_as_they_would_be_stored(tmp_path: Path) -> None:
    path, asked = tmp_path / "a.cdb", {"k": 0.5, "nu": 0.25}  # in another order than the space's
    with insitu.Session(path, on_error="warn", **DUMPS) as session, warnings.catch_warnings():
        warnings.simplefilter("ignore")
        session.render_member(blob(), {**asked, "k": 0.0}, time=0.0, spacing=SPACING)
        for time in (1.0, 2.0, 3.0):
            session.render_member(not_a_number(), asked, time=time, spacing=SPACING)
        names = [f"nu-0.25_k-0.5_time-{time}" for time in (1.0, 2.0, 3.0)]
        assert list(session.failures) == [m.name for m in Catalog.open(path).missing] == names
        assert Catalog.open(path).missing[1].parameters == {"nu": 0.25, "k": 0.5, "time": 2.0}
        session.render_member(blob(), asked, time=1.0, spacing=SPACING)
        session.render_member(blob(), asked, time=2.0, spacing=SPACING, name="another")
        assert list(session.failures) == [m.name for m in Catalog.open(path).missing] == names[2:]
    with insitu.Session(path) as session:  # of a later run
        session.render_member(blob(), asked, time=3.0, spacing=SPACING, name="third")
    assert Catalog.open(path).missing == ()
