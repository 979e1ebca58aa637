"""One progress line: written over on a terminal, one output in a notebook, few lines in a log."""

from __future__ import annotations

import io
import re
import time

import pytest

from catalogs.progress import Count, ProgressLine, Rate, duration


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


@pytest.fixture
def now(monkeypatch: pytest.MonkeyPatch) -> list[float]:
    """A clock that the test moves, s."""
    shown = [0.0]
    monkeypatch.setattr(time, "perf_counter", lambda: shown[0])
    return shown


@pytest.mark.parametrize(("seconds", "text"), [(0, "0:00"), (59.6, "1:00"), (61, "1:01"), (3725, "1:02:05")])
def test_durations_read_like_a_clock(seconds: float, text: str) -> None:
    assert duration(seconds) == text


def test_the_rate_is_of_late(now: list[float]) -> None:
    rate, done = Rate(), 0
    assert rate(0) == 0.0
    for of_late in [1] * 60 + [10] * 30:
        now[0] += 1.0
        done += of_late
        found = rate(done)
    assert found == pytest.approx(10.0, rel=0.01)


def test_a_count_says_what_it_knows() -> None:
    assert str(Count("checking", 1, 100, 0.0)) == "checking  1 / 100 images"
    assert str(Count("fitting", 40, 100, 2.5, "steps")) == "fitting  40 / 100 steps  2.5 steps/s  0:24 left"


def test_a_terminal_gets_one_line_and_messages_above_it(now: list[float]) -> None:
    stream = Terminal()
    with ProgressLine(stream) as line:
        line("a longer state")
        now[0] += 1.0
        line.say("Warning: something")
        line("the last")
    shown = re.sub(r"[^\n]*\r", "", stream.getvalue())  # what stays visible
    assert [text.rstrip() for text in shown.splitlines()] == ["Warning: something", "the last"]
    assert shown.endswith("\n")


def test_a_terminal_sees_the_last_state_and_few_of_those_before(now: list[float]) -> None:
    stream = Terminal()
    with ProgressLine(stream) as line:
        for done in range(1, 1001):
            now[0] += 0.001
            line.count("checking", done, 1000)
    shown = stream.getvalue().split("\r")[1:]
    assert len(shown) <= 7
    assert shown[-1].rstrip() == "checking  1000 / 1000 images  1000.0 images/s  0:00 left"


def test_a_line_never_wraps(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("COLUMNS", "40")
    stream = Terminal()
    with ProgressLine(stream) as line:
        line("x" * 100)
    assert stream.getvalue() == "\r" + "x" * 39 + "\n"


def test_a_log_gets_a_line_every_15_s(now: list[float]) -> None:
    stream = io.StringIO()
    with ProgressLine(stream) as line:
        for done in range(1, 101):
            now[0] += 1.0
            line.count("checking", done, 100)
    lines = stream.getvalue().splitlines()
    assert len(lines) == 6
    assert lines[0] == "checking  15 / 100 images  1.0 images/s  1:25 left"


def test_a_log_of_what_is_soon_done_stays_empty() -> None:
    stream = io.StringIO()
    with ProgressLine(stream) as line:
        line("working")
        line.count("checking", 48, 48)
    assert stream.getvalue() == ""


def test_stages_have_rates_of_their_own(now: list[float]) -> None:
    stream = io.StringIO()
    with ProgressLine(stream) as line:
        for stage, seconds in (("first", 1.0), ("second", 10.0)):
            for done in range(1, 21):
                now[0] += seconds
                line.count(stage, done, 20)
    assert stream.getvalue().splitlines()[-1] == "second  20 / 20 images  0.1 images/s  0:00 left"


@pytest.mark.slow
def test_a_notebook_gets_one_output() -> None:
    import nbclient  # seconds, which every process that collects the tests would take
    import nbformat

    code = """
from catalogs.progress import ProgressLine
with ProgressLine() as line:
    for done in range(101):
        line.count("checking", done, 100)
"""
    notebook = nbformat.v4.new_notebook(cells=[nbformat.v4.new_code_cell(code)])
    nbclient.NotebookClient(notebook, timeout=120).execute()
    (output,) = notebook.cells[0].outputs
    assert output["output_type"] == "display_data"
    assert output["data"]["text/plain"].startswith("checking  100 / 100 images")
