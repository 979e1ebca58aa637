"""Values under the pointer and at pins, histograms and predictions over the WebSocket, against numpy on the field."""

from __future__ import annotations

import shutil
import threading
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("aiohttp", reason="the extra [explore] is not installed")

from catalogs.store.members import COARSE
from surrogate.explore.request import frame_request
from surrogate.explore.run import Run
from surrogate.explore.server import predictions as predictions_module
from surrogate.explore.server.notebook import NotebookExplorer
from surrogate.explore.server.predictions import PREDICTIONS, Predictions
from tests.support.requests import message
from tests.support.tabs import Tab, harmless, lives
from tests.support.two_parameters import run_in

SETTING = {"parameters": {"p": 0.3, "q": 7.0}}
CAMERA = {"position": [3.0, 0.5, 0.6], "target": [0.5, 0.5, 0.5], "up": [0, 0, 1], "field": 30}


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Run:
    folder: Path = run_in(tmp_path_factory.mktemp("runs") / "two")
    return Run.open(folder)


@pytest.fixture(scope="module")
def two(run: Run) -> Iterator[Tab]:
    shown = NotebookExplorer(run)
    with Tab(shown.address) as tab:
        yield tab
    shown.close()


def ask(tab: Tab, call: str, **more: Any) -> dict[str, Any]:
    answer: dict[str, Any] = tab.ask(call, message(settings=[SETTING], camera=CAMERA, **more))
    return answer


def field_at(run: Run, parameters: dict[str, float]) -> Any:
    assert run.surrogate.field is not None
    return run.surrogate.field.fields(parameters)[0]


def test_what_is_seen_has_the_fields_value_and_pins_theirs(run: Run, two: Tab) -> None:
    pins = [[0.4, 0.5, 0.6], [9.0, 9.0, 9.0]]
    answer = ask(two, "probe", pixel=[32, 24], pins=pins)
    field = field_at(run, SETTING["parameters"])
    sampled = field.sample([answer["seen"]["place"], pins[0]])
    for one, value, deviation in zip(
        (answer["seen"], answer["pins"][0][0]), sampled.values, sampled.deviations, strict=True
    ):
        assert (one["value"], one["deviation"]) == pytest.approx((value, deviation))
    assert answer["pins"][0][1] is None
    assert ask(two, "probe", pixel=[0, 0])["seen"] is None
    assert ask(two, "probe")["pins"] == []


WRONG = {
    "half a pixel": {"pixel": [1]},
    "a pixel of text": {"pixel": ["1", 2]},
    "an infinite pixel": {"pixel": [1e999, 2]},
    "pins that are none": {"pins": 3},
    "a flat pin": {"pins": [[1, 2]]},
    "a pin of text": {"pins": ["abc"]},
    "too many pins": {"pins": [[0, 0, 0]] * 21},
}


@pytest.mark.parametrize("name", WRONG)
def test_wrong_places_get_a_sentence(two: Tab, name: str) -> None:
    harmless(ask(two, "probe", **WRONG[name]))
    assert "seen" in ask(two, "probe")


def test_a_run_without_a_field_says_so(tab: Tab) -> None:
    for call in ("probe", "here", "predictions"):
        assert "has no emulated field" in tab.ask(call, message())["error"]
    lives(tab)


def test_a_histogram_counts_the_fields_samples(run: Run, two: Tab) -> None:
    answer, values = ask(two, "here"), field_at(run, SETTING["parameters"]).values
    facts = two.ask("facts")["histogram"]
    assert answer["edges"] == facts["edges"]
    expected = np.histogram(values, facts["edges"])[0] / values.size
    assert answer["shares"] == pytest.approx(expected)


def predictions(tab: Tab) -> dict[str, Any]:
    for _ in range(300):
        answer = ask(tab, "predictions")
        if "done" not in answer:
            return answer
        assert 0.0 <= answer["done"] < 1.0
        time.sleep(0.05)
    raise TimeoutError


def test_predictions_have_the_numbers_of_the_field_there(run: Run, two: Tab) -> None:
    answer = predictions(two)
    rows = np.frombuffer(answer["pictures"][0], np.float32).reshape(len(answer["parameters"]), -1)
    levels, points = np.array(answer["levels"]), np.array(answer["parameters"])
    assert (len(rows), rows.shape[1]) == (17 + PREDICTIONS, 3 + len(levels))
    assert answer["runs"] == 17
    stored = [member.coarse_field().values for member in run.members]
    for values, row, member in zip(stored, rows, run.members, strict=False):
        assert row == pytest.approx(numbers(values, levels), abs=1e-5)
        assert dict(zip(("p", "q"), points[run.members.index(member)], strict=True)) == dict(member.parameters)
    for i in (17, 100, -1):
        values = field_at(run, dict(zip(("p", "q"), points[i], strict=True))).values
        assert rows[i] == pytest.approx(numbers(values, levels), abs=2.1 / values.size)
    logarithms = np.log10(points[17:, 1]) / 2.0  # q is logarithmic
    for shares in (points[17:, 0], logarithms):
        assert np.histogram(shares, 10, (0.0, 1.0))[0] == pytest.approx(PREDICTIONS / 10, abs=5)


def test_work_that_nobody_waits_for_stops(run: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    closed = threading.Event()
    with ThreadPoolExecutor(1) as pool:
        made = Predictions(run, pool, closed)
        request = frame_request(message(settings=[SETTING], camera=CAMERA), run.surrogate)
        monkeypatch.setattr(predictions_module, "ABANDONED", 0.0)
        assert made.answer(request)["done"] < 0.01
        pool.submit(int).result()  # behind the work
        assert 0.0 < made.answer(request)["done"] < 0.01  # a row, no more; and it begins anew
        monkeypatch.undo()
        for _ in range(300):
            if "done" not in made.answer(request):
                break
            time.sleep(0.05)
        assert len(made.answer(request)["parameters"]) == 17 + PREDICTIONS


def test_damaged_fields_are_no_secret_but_their_place_is(run: Run, tmp_path: Path) -> None:
    assert run.folder is not None
    folder = Path(shutil.copytree(run.folder, tmp_path / "two"))
    for path in folder.rglob(COARSE):
        path.write_bytes(b"damaged")
    shown = NotebookExplorer(Run.open(folder))
    with Tab(shown.address) as tab:
        for _ in range(100):
            answer = ask(tab, "predictions")
            if "error" in answer:
                break
            time.sleep(0.05)
        assert answer["error"] == "the runs' fields can't be read: the explorer's terminal says why"
        assert ask(tab, "probe")["pins"] == []
    shown.close()


def numbers(values: Any, levels: Any) -> list[float]:
    return [values.mean(dtype=np.float64), values.min(), values.max(), *((values > level).mean() for level in levels)]
