"""Members that are in the catalog already: an error that says what to do, skipped, or replaced."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import insitu
from catalogs.store.catalog import Catalog
from catalogs.tools.check import check
from catalogs.vocabulary.appearance import VolumeRendering
from catalogs.vocabulary.scene import ViewPlan
from tests.support.hooked import FUNCTION, SPACING, blob, tree

PLAN: dict[str, Any] = {
    "space": {"Re": (100.0, 200.0)},
    "appearances": VolumeRendering("dvr", FUNCTION),
    "views": ViewPlan(frequency=1, width=8, height=8),
    "sample_distance": 0.1,
}
DUMPS = {**PLAN, "space": {"Re": (100.0, 200.0), "time": (0.0, 10.0)}}


@pytest.fixture
def path(tmp_path: Path) -> Path:
    """A catalog of one member."""
    path = tmp_path / "a.cdb"
    insitu.render_member(blob(), {"Re": 150.0}, catalog=path, spacing=SPACING, **PLAN)
    return path


def render(path: Path, reynolds: float = 150.0, width: float = 0.5, **changes: Any) -> insitu.RenderedMember:
    return insitu.render_member(blob(width), {"Re": reynolds}, catalog=path, spacing=SPACING, **changes)


def never() -> np.ndarray:
    raise AssertionError("the field was asked for")


@pytest.mark.parametrize("name", [None, "another"])
def test_a_member_that_is_there_is_skipped_before_its_field_is_looked_at(path: Path, name: str | None) -> None:
    before = tree(path)
    result = insitu.render_member(never, {"Re": 150}, catalog=path, name=name, existing="skip")
    assert (result.skipped, result.name, result.images, result.error) == (True, "Re-150.0", 0, "")
    assert repr(result) == str(result).splitlines()[0]
    assert "skipped" in repr(result)
    assert result.path.is_dir()
    assert np.isnan(result.range).all()
    assert tree(path) == before


def test_a_function_is_called_where_its_field_is_needed(path: Path) -> None:
    assert insitu.render_member(blob, {"Re": 160}, catalog=path, spacing=SPACING, existing="skip").images == 12


def test_a_name_with_other_parameters_is_no_reason_to_skip(path: Path) -> None:
    before = tree(path)
    for existing in ("skip", "error"):
        with pytest.raises(ValueError, match=r"Re-150\.0 is in .* already, with other parameters, {'Re': 150\.0}"):
            render(path, 160.0, name="Re-150.0", existing=existing)
    assert tree(path) == before


def test_a_restart_renders_what_is_missing(path: Path) -> None:
    with insitu.Session(path, existing="skip", **PLAN) as session:
        assert [session.has({"Re": re}) for re in (140.0, 150.0)] == [False, True]
        done = [session.render_member(blob(), {"Re": re}, spacing=SPACING) for re in (140.0, 150.0, 160.0)]
    assert [result.skipped for result in done] == [False, True, False]
    assert len(Catalog.open(path).members) == 3


def test_a_member_is_replaced(path: Path) -> None:
    before = Catalog.open(path).image("Re-150.0", "dvr", 0)
    assert render(path, width=0.2, existing="replace").images == 12
    made = Catalog.open(path)
    assert [member.name for member in made.members] == ["Re-150.0"]
    assert not np.array_equal(made.image("Re-150.0", "dvr", 0), before)
    assert check(path) == []


def test_a_member_is_replaced_under_the_name_that_it_has(path: Path) -> None:
    insitu.render_member(blob(), {"Re": 160.0}, catalog=path, spacing=SPACING, name="mine")
    assert render(path, 160.0, width=0.2, existing="replace").name == "mine"
    with pytest.raises(ValueError, match=r"member mine of .* can't be replaced by yours: .* pass name='mine'"):
        render(path, 160.0, name="yours", existing="replace")
    assert render(path, 170.0, existing="replace").name == "Re-170.0"  # nothing to replace: it is new
    assert check(path) == []


def test_a_field_that_is_refused_replaces_nothing(path: Path) -> None:
    before = tree(path)
    with pytest.raises(ValueError, match="NaN"):
        insitu.render_member(blob() * np.nan, {"Re": 150.0}, catalog=path, spacing=SPACING, existing="replace")
    assert tree(path) == before


def test_the_error_says_what_to_do(path: Path) -> None:
    with pytest.raises(ValueError, match=r"Re-150\.0 with parameters .* already") as caught:
        render(path)
    said = str(caught.value)
    assert 'If this is a rerun, pass existing="skip" or existing="replace".' in said
    assert 'space={"Re": (100, 200), "time": (first, last)}, and pass time= with every dump.' in said


def test_dumps_of_a_run_are_members(tmp_path: Path) -> None:
    with insitu.Session(tmp_path / "a.cdb", **DUMPS) as session:
        for time in (0.0, 2.0):
            session.render_member(blob(), {"Re": 150.0}, time=time, spacing=SPACING)
        with pytest.raises(ValueError, match='pass existing="skip"') as caught:
            session.render_member(blob(), {"Re": 150.0}, time=2.0, spacing=SPACING)
        assert "time of the same run" not in str(caught.value)
        assert session.has({"Re": 150.0}, time=2.0)
        assert not session.has({"Re": 150.0}, time=3.0)
    members = Catalog.open(tmp_path / "a.cdb").members
    assert [m.name for m in members] == ["Re-150.0_time-0.0", "Re-150.0_time-2.0"]
    assert [(m.parameters["time"], m.provenance["time"]) for m in members] == [(0.0, 0.0), (2.0, 2.0)]


def test_a_field_that_knows_its_time_needs_no_other(tmp_path: Path) -> None:
    field = insitu.Field(blob(), SPACING, (0.0, 0.0, 0.0), time=4.0)
    assert insitu.render_member(field, {"Re": 150.0}, catalog=tmp_path / "a.cdb", **DUMPS).name == "Re-150.0_time-4.0"
    with pytest.raises(ValueError, match=r"time=4\.0 and the parameter time = 5\.0 disagree"):
        insitu.render_member(field, {"Re": 150.0, "time": 5.0}, catalog=tmp_path / "a.cdb")


@pytest.mark.parametrize("argument", ["existing", "on_error", "nan"])
def test_other_ways_are_refused_at_once(tmp_path: Path, argument: str) -> None:
    with pytest.raises(ValueError, match=f"{argument} must be one of .*, got 'maybe'"):
        insitu.Session(tmp_path / "a.cdb", **{argument: "maybe"})
