"""The rates at which methods train."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import pytest

from research.studies.baselines.method import Plan
from research.studies.comparison import tuning
from research.studies.comparison.contestants import OurSurrogate, Published, emptied
from research.studies.comparison.fitting import OutOfTime
from research.studies.comparison.result import load
from research.studies.comparison.task import ComparisonTask
from surrogate.training.loop import Diverged
from tests.research.support.comparisons import study
from tests.research.support.mean_pictures import MeanPicture, mean_method


def test_rates_of_one_precision_stand_for_the_other(tmp_path: Path) -> None:
    narrow = tuning.Tuning("mean", "small", "bfloat16", "blobs", 60.0, {"0.1": 20.0, "1": 21.0})
    tuning.save(tmp_path, narrow)
    assert tuning.find(tmp_path, "mean", Plan(1, size="small", precision="float32")) == narrow
    tuning.save(tmp_path, replace(narrow, precision="float32", decibels={"3": 22.0}))
    assert [
        tuning.find(tmp_path, "mean", Plan(1, size="small", precision=p)).rate for p in ("float32", "bfloat16")
    ] == [3.0, 1.0]
    assert tuning.find(tmp_path, "mean", Plan(1, size="official")) is None


def test_tuning_is_used_by_all_scenes(task: ComparisonTask, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    made = study(task, tmp_path)
    contestant = made.contestants[0]
    monkeypatch.setattr(tuning, "SECONDS", 0.03)
    found = tuning.tune(contestant, task, "blobs", made.plan, emptied(tmp_path / "work"), tmp_path / "shared")
    assert set(found.decibels) == {"0.1", "0.3", "1", "3", "10"}
    assert found.decibels[f"{found.rate:g}"] == max(psnr for psnr in found.decibels.values() if psnr is not None)
    tuning.save(made.all_records, replace(found, decibels={**found.decibels, "0.3": 99.0}))
    made.run()
    [result] = [r for r in load(made.records) if r.method == "mean"]
    assert result.rate == 0.3


def test_a_method_that_diverged_everywhere_keeps_its_own_rate() -> None:
    nothing = tuning.Tuning("mean", "small", "float32", "blobs", 60.0, {"0.1": None, "1": None})
    assert nothing.rate == 1.0


def test_what_diverges_is_made_again_at_the_next_lower_rate(tmp_path: Path) -> None:
    tried = list[float]()

    def made(rate: float, folder: Path) -> float:
        assert folder.is_dir()
        tried.append(rate)
        if rate > 0.5:
            raise Diverged(f"at {rate:g}")
        if len(tried) < 4:
            raise OutOfTime
        return rate

    with pytest.raises(OutOfTime):
        tuning.at_rates_that_hold(tuning.rates_from(3.0), tmp_path, made)
    assert (
        tuning.at_rates_that_hold(tuning.rates_from(3.0), tmp_path, made) == 0.3
    )  # it goes on at the rate that it was at
    assert tried == [3.0, 1.0, 0.3, 0.3]


def test_the_rate_that_held_is_kept_and_what_diverges_at_all_is_a_failure(task: ComparisonTask, tmp_path: Path) -> None:
    class Unsteady(MeanPicture):
        def advance(self) -> float:
            return super().advance() if self.plan.rate < least else math.nan

    method = replace(mean_method(), begin=lambda *given: Unsteady(*given, lambda _: 0.5))
    for least, rate in ((0.2, 0.1), (0.0, None)):
        made = study(task, tmp_path / str(least), Published(method))
        made.run()
        [result] = [r for r in load(made.records) if r.method == "mean"]
        assert (None if result.error else result.rate) == rate
        assert ("The mean diverged" in result.error) == (rate is None)


def test_what_no_rate_is_chosen_for_is_trained_once(
    task: ComparisonTask, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Its result would say that it was trained at a rate that changes nothing."""
    begun = list[float]()

    def diverged(self: OurSurrogate, task: ComparisonTask, plan: Plan, *_: object) -> None:
        begun.append(plan.rate)
        raise Diverged("its pictures are no numbers")

    monkeypatch.setattr(OurSurrogate, "trained", diverged)
    made = study(task, tmp_path, OurSurrogate("ours", "ours", "nobody"))
    made.run()
    [result] = [r for r in load(made.records) if r.method == "ours"]
    assert begun == [1.0]
    assert "no numbers" in result.error
