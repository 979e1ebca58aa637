"""The loop pays a copy, and nothing that happens to the renderer reaches it."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
import warnings
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import psutil
import pytest

from catalogs.store.catalog import Catalog
from catalogs.tools.check import check
from catalogs.vocabulary.appearance import Isosurface
from catalogs.vocabulary.scene import ViewPlan
from insitu.background import process as background
from insitu.background.process import RendererWarning
from insitu.fields.field import Field
from insitu.hook.session import Session
from tests.support.hooked import SPACING, blob

PROJECT = Path(__file__).resolve().parents[3]
OPTIONS: dict[str, Any] = {
    "space": {"width": (0.1, 1.0)},
    "appearances": Isosurface("surface", 0.5),
    "views": ViewPlan(frequency=1, width=8, height=8),
}


@pytest.fixture
def said() -> list[str]:
    """The warnings of a session."""
    return []


@pytest.fixture
def session(tmp_path: Path, said: list[str]) -> Iterator[Session]:
    """One that does not wait."""
    with Session(
        tmp_path / "a.cdb", **OPTIONS, background=True, warn=lambda note: said.append(f"{type(note).__name__}: {note}")
    ) as made:
        yield made


def renderer(session: Session) -> psutil.Process:
    """The process that renders for it."""
    assert session._background is not None
    assert session._background._renderer is not None
    return psutil.Process(session._background._renderer.process.pid)


def wait_for(session: Session, members: int) -> None:
    """Until that number of members is rendered."""
    until = time.monotonic() + 120.0
    while len(session.results) < members:
        assert not session.failures, session.failures
        assert time.monotonic() < until
        time.sleep(0.01)


def render(session: Session, width: float, **arguments: Any) -> Any:
    return session.render_member(blob(width), {"width": width}, spacing=SPACING, **arguments)


def test_it_makes_the_catalog_that_the_loop_would_make(session: Session, tmp_path: Path) -> None:
    border = np.zeros((14, 14, 14), np.float32)
    border[1:-1, 1:-1, 1:-1] = blob(0.5)
    with Session(tmp_path / "b.cdb", **OPTIONS) as waiting:
        for given in (session, waiting):
            given.render_member(border[1:-1, 1:-1, 1:-1], {"width": 0.5}, spacing=SPACING, name="cut", time=2.0)
            given.render_member(Field(blob(0.6), SPACING, (0.0, 0.0, 0.0)), {"width": 0.6}, split="test")
    assert session._background is not None
    assert {os.fstat(memory).st_nlink for memory in session._background._memories} == {0}, (
        "memory has no name to be left"
    )
    session.close()
    made = [Catalog.open(tmp_path / name) for name in ("a.cdb", "b.cdb")]
    assert [m.name for m in made[0].members] == [m.name for m in made[1].members] == ["cut", "width-0.6"]
    for one, other in zip(*(catalog.members for catalog in made), strict=True):
        assert one.provenance == other.provenance
        assert one.split == other.split
        assert np.array_equal(made[0].images(one, "surface"), made[1].images(other, "surface"))
    assert made[0].plan.differences(made[1].plan) == []
    assert [(r.name, r.images, r.queued) for r in session.results] == [("cut", 12, False), ("width-0.6", 12, False)]
    assert check(tmp_path / "a.cdb") == []
    assert session.failures == {}


@pytest.mark.slow
def test_a_data_set_becomes_a_grid_in_the_loop(session: Session) -> None:
    pyvista = pytest.importorskip("pyvista")
    image = pyvista.ImageData(dimensions=(12, 12, 12), spacing=SPACING)
    image["f"] = blob(0.5).ravel()
    assert "background" in repr(session.render_member(image, {"width": 0.5}))
    session.close()
    assert [r.name for r in session.results] == ["width-0.5"]


WRONG: dict[str, tuple[dict[str, Any], str]] = {
    "parameters": ({"parameters": {"depth": 0.5}}, "depth"),
    "appearance": ({"appearances": ["dvr"]}, "dvr"),
    "shape": ({"field": np.zeros((4, 4))}, "3 axes"),
    "type": ({"field": np.zeros((4, 4, 4), complex)}, "real numbers"),
    "one sample": ({"field": np.zeros((1, 4, 4))}, "at least 2"),
    "spacing": ({"spacing": (1.0, -1.0, 1.0)}, "spacing"),
    "name": ({"name": "../a"}, "invalid member name"),
    "split": ({"split": "tran"}, "split"),
    "provenance": ({"provenance": {"a": object()}}, "provenance"),
    "the same name": ({"name": "first", "parameters": {"width": 0.6}}, "first"),
    "the same parameters": ({"parameters": {"width": 0.5}}, "first"),
    "nan": ({"nan": "ignore"}, "nan"),
}


@pytest.mark.parametrize("stored", [False, True])
def test_what_is_wrong_with_the_call_is_raised_at_once(tmp_path: Path, stored: bool) -> None:
    with Session(tmp_path / "a.cdb", **OPTIONS, background=not stored) as first:
        render(first, 0.5, name="first")
        with Session(tmp_path / "a.cdb", **OPTIONS, background=True) if stored else first as session:
            wrong = {**WRONG, "out of the box": ({"spacing": (9.0, 9.0, 9.0)}, "box")} if stored else WRONG
            for case, (arguments, message) in wrong.items():
                asked = {"field": blob(0.7), "parameters": {"width": 0.7}, "spacing": SPACING, **arguments}
                with pytest.raises((ValueError, TypeError), match=message):
                    session.render_member(**asked)
                assert session.failures == {}, case
    assert [member.name for member in Catalog.open(tmp_path / "a.cdb").members] == ["first"]


@pytest.mark.parametrize("given", [-1, "yes", 0.5])
def test_a_wrong_number_is_refused(tmp_path: Path, given: Any) -> None:
    with pytest.raises(ValueError, match="background must be"):
        Session(tmp_path / "a.cdb", **OPTIONS, background=given)


def test_what_fails_later_is_a_warning_and_stands_in_failures(session: Session, said: list[str]) -> None:
    session.render_member(np.full((4, 4, 4), np.nan), {"width": 0.2}, name="hollow")
    render(session, 0.5)
    session.close()
    assert [r.name for r in session.results] == ["width-0.5"]
    assert list(session.failures) == ["hollow"]
    assert "64 of 64 values are NaN" in session.failures["hollow"]
    assert sum("hollow" in note for note in said) == 1
    with pytest.raises(ValueError, match="closed"):
        render(session, 0.6)


def test_what_waits_is_skipped_like_what_is_stored(tmp_path: Path) -> None:
    with Session(tmp_path / "a.cdb", **OPTIONS, background=True, existing="skip") as session:
        renderer(session).suspend()
        render(session, 0.5, name="own")
        assert render(session, 0.5).name == "own"
        renderer(session).resume()
    assert [r.name for r in session.results] == ["own"]


@pytest.mark.slow
def test_stored_members_are_skipped_or_replaced(tmp_path: Path) -> None:
    for turn in range(3):
        with Session(
            tmp_path / "a.cdb", **OPTIONS, background=1, existing=("error", "skip", "replace")[turn]
        ) as session:
            made = render(session, 0.5, name="own" if turn == 0 else None)
        assert (made.skipped, made.queued) == (turn == 1, turn != 1)
        assert [r.name for r in session.results] == ([] if turn == 1 else ["own"])
        assert session.failures == {}
    assert [member.name for member in Catalog.open(tmp_path / "a.cdb").members] == ["own"]


@pytest.mark.slow
def test_a_slow_renderer_bounds_the_memory_and_is_told_of_once(
    session: Session, said: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    render(session, 0.2)
    wait_for(session, 1)
    renderer(session).suspend()
    render(session, 0.3)
    render(session, 0.4)
    waited = []
    held = session._background
    assert held is not None

    def resume() -> None:
        waited.append(len(held._tasks))
        renderer(session).resume()

    monkeypatch.setattr(held, "_say_waiting", lambda say=held._say_waiting: (say(), resume()))
    render(session, 0.5)
    assert waited[0] == 2
    render(session, 0.6)
    render(session, 0.7)
    session.close()
    assert sum("slower than the loop" in note for note in said) == 1
    assert len(session.results) == 6


def kill(session: Session) -> None:
    renderer(session).kill()
    os.waitid(os.P_PID, renderer(session).pid, os.WEXITED | os.WNOWAIT)


def test_a_renderer_that_dies_is_replaced_and_its_member_is_tried_again(session: Session, said: list[str]) -> None:
    render(session, 0.3)
    kill(session)
    render(session, 0.4)
    session.close()
    assert sorted(r.name for r in session.results) == ["width-0.3", "width-0.4"]
    assert [note for note in said if "RendererWarning" in note and "SIGKILL" in note and "width-0.3" in note] == said
    assert len(said) == 1


@pytest.mark.slow
def test_a_member_that_kills_two_renderers_is_missing(
    session: Session, said: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    held = session._background
    assert held is not None
    starts = [0]

    def start(start: Callable[[], None] = held._start) -> None:
        start()
        starts[0] += 1
        if starts[0] < 2:
            kill(session)

    monkeypatch.setattr(held, "_start", start)
    renderer(session).suspend()
    render(session, 0.3)
    render(session, 0.4)
    kill(session)
    session.close()
    assert list(session.failures) == ["width-0.3"]
    assert "SIGKILL" in session.failures["width-0.3"]
    assert [r.name for r in session.results] == ["width-0.4"]
    assert sum("is missing" in note for note in said) == 1


def test_renderers_are_not_started_for_ever(session: Session, said: list[str], monkeypatch: pytest.MonkeyPatch) -> None:
    kill(session)
    monkeypatch.setattr(background, "python", lambda: "/bin/false")
    for width in (0.2, 0.3, 0.4, 0.5, 0.6, 0.7):
        render(session, width)
    session.close()
    assert session.results == ()
    assert len(session.failures) == 6
    assert len(said) <= 6 + background.RESTARTS + 1
    assert not session.path.exists()


@pytest.mark.slow
def test_members_that_kill_renderers_leave_the_others_alone(
    session: Session, said: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(background, "RESTARTS", 1)
    for number, width in enumerate((0.2, 0.3, 0.4), 1):  # each after one that killed its renderer by a fault of C++
        render(session, width)
        wait_for(session, number)
        os.kill(renderer(session).pid, signal.SIGSEGV)
        os.waitid(os.P_PID, renderer(session).pid, os.WEXITED | os.WNOWAIT)
    render(session, 0.5)
    session.close()
    assert [r.name for r in session.results] == ["width-0.2", "width-0.3", "width-0.4", "width-0.5"]
    assert session.failures == {}
    assert all("SIGSEGV" in note for note in said if "a.cdb so far:" not in note)


def test_without_an_interpreter_members_are_missing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(background, "python", lambda: "/nowhere/python")
    with (
        pytest.warns(UserWarning, match="no renderer could be started"),
        Session(tmp_path / "a.cdb", **OPTIONS, background=True) as session,
    ):
        render(session, 0.3)
    assert "/nowhere/python" in session.failures["width-0.3"]


@pytest.mark.slow
def test_a_stuck_renderer_is_killed(session: Session, monkeypatch: pytest.MonkeyPatch) -> None:
    render(session, 0.2)
    wait_for(session, 1)
    renderer(session).suspend()
    monkeypatch.setattr(background, "SILENCE_SECONDS", 2.0)
    stuck = renderer(session)
    render(session, 0.3)
    time.sleep(2.1)
    session._background.take_results()  # type: ignore[union-attr]
    monkeypatch.setattr(background, "SILENCE_SECONDS", 1800.0)
    session.close()
    assert not stuck.is_running()
    assert [r.name for r in session.results] == ["width-0.2", "width-0.3"]


@pytest.mark.slow
def test_warnings_that_are_errors_do_not_reach_the_loop(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        with Session(tmp_path / "a.cdb", **OPTIONS, background=True) as session:
            session.render_member(np.full((4, 4, 4), np.nan), {"width": 0.2})
            kill(session)
            render(session, 0.3)
    assert [r.name for r in session.results] == ["width-0.3"]
    assert "NaN" in capfd.readouterr().err


LOOP = """
import os, signal, sys
import numpy as np
import insitu
print("loop", flush=True)
session = insitu.Session(sys.argv[1], space={"width": (0.1, 1.0)}, appearances=insitu.Isosurface("surface", 0.5),
                         views=insitu.ViewPlan(frequency=1, width=8, height=8), background=True)
z, y, x = np.meshgrid(*[np.linspace(-1.0, 1.0, 12)] * 3, indexing="ij")
for width in (0.3, 0.4):
    session.render_member(np.exp(-(x * x + y * y + z * z) / width), {"width": width})
print(session._background._renderer.process.pid, flush=True)
"""
ENDS = {
    "its end": "",
    "an error": "raise RuntimeError('the solver diverged')",
    "sys.exit": "with session: sys.exit(3)",
    "Ctrl-C": "os.kill(os.getpid(), signal.SIGINT)",
    "kill -9": "os.kill(os.getpid(), signal.SIGKILL)",
    "abort": "os.abort()",
    "os._exit": "os._exit(0)",
}
QUICK = ("its end", "kill -9")
LOSING = ("Ctrl-C", "kill -9", "abort", "os._exit")


@pytest.mark.parametrize("end", [pytest.param(end, marks=() if end in QUICK else pytest.mark.slow) for end in ENDS])
def test_however_a_script_without_a_guard_ends_nothing_of_it_stays(tmp_path: Path, end: str) -> None:
    script, path = tmp_path / "loop.py", tmp_path / "a.cdb"
    script.write_text(LOOP + ENDS[end])
    ran = subprocess.run(
        [sys.executable, script, path],
        capture_output=True,
        text=True,
        timeout=120,
        env={**os.environ, "PYTHONPATH": str(PROJECT)},
    )
    loop, pid = ran.stdout.split()
    assert loop == "loop", "and only once"
    gone(int(pid))
    if end not in LOSING:
        assert len(Catalog.open(path).members) == 2, ran.stderr
        assert check(path) == []
    elif (path / "catalog.json").exists():
        assert all((path / "members" / member.name).is_dir() for member in Catalog.open(path).members)


def gone(pid: int) -> None:
    """Wait until a process has ended."""
    try:
        psutil.Process(pid).wait(60)
    except psutil.NoSuchProcess:
        return


@pytest.mark.slow
def test_a_forked_child_of_the_loop_leaves_the_renderer_alone(session: Session) -> None:
    render(session, 0.3)
    child = os.fork()
    if child == 0:
        status = 1
        try:
            session.close()
            render(session, 0.4)
        except ValueError:
            status = 0
        finally:
            os._exit(status)
    assert os.waitpid(child, 0)[1] == 0
    render(session, 0.5)
    session.close()
    assert [r.name for r in session.results] == ["width-0.3", "width-0.5"]


def test_ctrl_c_gives_up_what_is_held(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    said: list[Warning] = []
    session = Session(tmp_path / "a.cdb", **OPTIONS, background=True, warn=said.append)
    renderer(session).suspend()
    render(session, 0.3)
    pid = renderer(session).pid
    monkeypatch.setattr(background, "FAREWELL_SECONDS", 0.1)
    with pytest.raises(KeyboardInterrupt), session:
        raise KeyboardInterrupt
    gone(pid)
    assert list(session.failures) == ["width-0.3"]
    assert "interrupted" in str(said[0])
    assert not isinstance(said[0], RendererWarning)
