"""`python -m research.studies compare`, from a run's folder to its page."""

from __future__ import annotations

from pathlib import Path

import pytest
from click.testing import CliRunner

from catalogs.store.catalog import Catalog
from research.studies.__main__ import main
from research.studies.baselines.method import Plan
from research.studies.comparison import methods
from research.studies.comparison.contestants import Published, TrainingContext
from research.studies.comparison.methods import CONTESTANTS, LIGHT, OURS
from research.studies.comparison.result import load
from research.studies.comparison.run import RunOptions, times_of
from research.studies.comparison.task import ComparisonTask
from research.studies.comparison.tuning import find
from surrogate.training import budget, pace
from surrogate.training.begin import TrainingOptions, begin
from surrogate.training.budget import Budget
from tests.research.support.mean_pictures import mean_method
from tests.support.blobs import Blobs, stored

MEMBERS = (("train", 0.0), ("train", 1.0), ("validation", 0.25), ("test", 0.5))


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"seeds": 0}, "seeds must be at least 1, got 0"),
        ({"threads": 0}, "threads must be at least 1, got 0"),
        ({"minutes": ()}, "minutes must be positive times"),
        ({"minutes": (5.0, -1.0)}, r"minutes must be positive times, got \[5.0, -1.0\]"),
        ({"minutes": (float("nan"),)}, "minutes must be positive times"),
        ({"methods": ["k-plane"]}, r"unknown methods \['k-plane'\]"),
    ],
)
def test_what_cannot_be_asked_for(given: dict, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        RunOptions(**given)


def test_minutes_are_numbers_between_commas() -> None:
    assert times_of("5,30") == [5.0, 30.0]
    with pytest.raises(ValueError, match="--minutes must be numbers such as 5,30, got '5;30'"):
        times_of("5;30")


@pytest.fixture(scope="module")
def catalog(tmp_path_factory: pytest.TempPathFactory) -> Catalog:
    return stored(tmp_path_factory.mktemp("catalog") / "blobs.cdb", Blobs(count=3, size=16), members=MEMBERS)


@pytest.fixture
def run(catalog: Catalog, tmp_path: Path) -> Path:
    """A run's folder, with nothing trained."""
    return begin(catalog.path, tmp_path / "run", TrainingOptions(Budget(steps=40))).folder


def test_a_command_makes_a_page(run: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(methods.CONTESTANTS, "visnerf", Published(mean_method("visnerf")))
    words = ["compare", str(run), "--methods", "visnerf", "--minutes", "0.001"]
    first = CliRunner().invoke(main, words)
    assert first.exit_code == 0, first.output
    assert "visnerf, 0.001 min, seed 0: novel views" in first.output
    page = (run / "comparison" / "comparison.md").read_text()
    assert "| The mean |" in page
    for picture in ("curves.png", "pictures_0.001.png"):
        assert f"({picture})" in page
        assert (run / "comparison" / picture).stat().st_size > 1000
    second = CliRunner().invoke(main, words)
    assert "seed 0" not in second.output
    assert (run / "comparison" / "comparison.md").read_text() == page


def test_rates_are_tuned_once_for_all_scenes(run: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(methods.CONTESTANTS, "visnerf", Published(mean_method("visnerf")))
    monkeypatch.setattr("research.studies.comparison.tuning.SECONDS", 0.05)
    words = ["compare", str(run), "--methods", f"visnerf,{OURS}", "--tune"]
    first = CliRunner().invoke(main, words)
    assert first.exit_code == 0, first.output
    assert [line.partition(",")[0] for line in first.output.splitlines() if "times its rates" in line] == [
        "visnerf"
    ] * 5
    assert find(run.parent, "visnerf", Plan(1, size="small")) is not None
    assert "times its rates" not in CliRunner().invoke(main, words).output


def test_a_command_says_who_trains_at_published_rates(run: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("visnerf", "k-planes"):
        monkeypatch.setitem(methods.CONTESTANTS, name, Published(mean_method(name)))
    monkeypatch.setattr("research.studies.comparison.tuning.SECONDS", 0.05)
    words = ["compare", str(run), "--methods"]
    tuned = CliRunner().invoke(main, [*words, "visnerf", "--tune"])
    assert tuned.exit_code == 0, tuned.output
    both = CliRunner().invoke(main, [*words, "k-planes,visnerf", "--minutes", "0.001"])
    assert f"trained at published rates: k-planes; {run.parent} has no tuned ones, --tune chooses them" in both.output
    for silent, end in (
        (["visnerf", "--minutes", "0.001", "--seeds", "2"], "seed 1"),
        (["k-planes,visnerf", "--minutes", "0.001"], "comparison.md"),
        (["k-planes", "--published", "--stop-after", "1e-9"], "stopped after"),
    ):
        output = CliRunner().invoke(main, [*words, *silent]).output
        assert end in output
        assert "trained at published rates" not in output


def test_errors_are_one_line(run: Path) -> None:
    found = CliRunner().invoke(main, ["compare", str(run), "--methods", "nerf"])
    assert found.exit_code == 1
    assert "Error: unknown methods ['nerf']" in found.output


@pytest.mark.slow
def test_ours_is_trained_in_its_time(run: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Its own pilot is on the clock, which is shorter here, as is the least that a budget may be."""
    for name, seconds in {"FEWEST_SECONDS": 1.0, "SPARE": 0.2}.items():
        monkeypatch.setattr(budget, name, seconds)
    monkeypatch.setattr(pace, "LEAST_SECONDS", 0.1)
    found = CliRunner().invoke(main, ["compare", str(run), "--methods", OURS, "--minutes", "0.05"])
    assert found.exit_code == 0, found.output
    [result] = [r for r in load(run) if r.method == OURS]
    assert not result.error
    assert result.steps > 1
    assert result.cells["both"]["psnr"] > 15.0
    assert result.curve
    assert result.picture_milliseconds < 1000.0


def test_of_the_light_field_only_records_are_left(catalog: Catalog, tmp_path: Path, run: Path) -> None:
    with pytest.raises(ValueError, match="gs-surrogate-light can't be trained any more: only its records are left"):
        CONTESTANTS[LIGHT].trained(
            ComparisonTask.of(catalog), Plan(6), None, TrainingContext(tmp_path / "work", tmp_path)
        )
    asked = CliRunner().invoke(main, ["compare", str(run), "--methods", LIGHT, "--minutes", "0.001"])
    assert "only its records are left" in asked.output
