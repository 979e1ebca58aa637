"""Training of every method for every time and seed on one scene, shared between processes; finished results are skipped."""

from __future__ import annotations

import contextlib
import math
import shutil
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np

from catalogs.engines.engine import Engine
from catalogs.files import durable
from research.studies.baselines.method import Plan, Precision
from research.studies.comparison import tuning
from research.studies.comparison.contestants import Contestant, TrainedContestant, TrainingContext, precision_here
from research.studies.comparison.fitting import OutOfTime
from research.studies.comparison.methods import CONTESTANTS
from research.studies.comparison.pictures import TRUTH, are_kept, keep_drawn, keep_truth
from research.studies.comparison.result import AS_PUBLISHED, TRIVIAL, ComparisonResult, find, save
from research.studies.comparison.task import ComparisonTask
from research.studies.comparison.trivial import trivial_cells
from research.studies.progress import StudyProgress, StudyWatch
from research.studies.remote import train_on
from surrogate.evaluation.perceptual import PerceptualMetrics
from surrogate.evaluation.predictor import Predictor
from surrogate.evaluation.scoring import score_cases
from surrogate.evaluation.tables import ALL_METRICS, means
from surrogate.splatting.threads import one_torch_thread
from surrogate.storage.checkpoints import locked
from surrogate.storage.records import Provenance
from surrogate.training.loop import Diverged

FITS, SHARED = "fits", "shared"  # in the folder of a comparison
_One = tuple[float, int, Contestant]  # minutes and seed of a training
SAME_COLOR = 1e-4  # of 1: well above the rounding differences between processors


@dataclass(frozen=True, eq=False)
class ComparisonStudy:
    """The comparison on one scene: contestants, times and seeds.

    A contestant that takes another's number of steps is trained after it.

    Attributes
    ----------
    task : the scene's images.
    folder : of the results.
    records, all_records : folder of the scene's records, and its parent, which holds those of tuning.
    contestants, minutes, seeds : each contestant is trained for each time with the seeds 0 to `seeds` - 1.
    plan : the size and threads of all methods.
    device : of the trainings and of the timed images.
    until : `time.monotonic()` at which the study stops; it can be resumed later.
    """

    task: ComparisonTask
    folder: Path
    records: Path
    all_records: Path
    contestants: Sequence[Contestant]
    minutes: Sequence[float]
    seeds: int
    plan: Plan
    device: str = "cpu"
    until: float = math.inf

    def run(
        self,
        progress: Callable[[StudyProgress], None] = lambda _: None,
        tell: Callable[[ComparisonResult], None] = lambda _: None,
        engine: Engine | None = None,
    ) -> None:
        """Train and score all that have no result yet; `tell` receives each stored result, failures included.

        An interruption loses the last minutes of a published method's training, or the current training of ours.
        Trainings of another process are skipped. With an `engine`, its workers train; they must see all folders. Raises
        ValueError where the records belong to other images, `OutOfTime` at the time limit, and RuntimeError at the end
        where trainings failed on the engine.
        """
        self._keep_trivial(tell)
        order = self._order(self.contestants)
        if engine is not None:
            self._run_on(engine, order, progress, tell)
            return
        watch = StudyWatch(progress)
        for number, one in enumerate(order, start=1):
            if time.monotonic() >= self.until:
                raise OutOfTime
            result = self._trained(*one, watch, len(order) - number)
            if result is not None:
                tell(result)

    def _order(self, contestants: Sequence[Contestant]) -> list[_One]:
        return list(product(sorted(self.minutes), range(self.seeds), contestants))

    def _run_on(
        self,
        engine: Engine,
        order: Sequence[_One],
        progress: Callable[[StudyProgress], None],
        tell: Callable[[ComparisonResult], None],
    ) -> None:
        """Train missing results on workers; contestants that take the steps of others come last."""
        for following in (False, True):
            ours = [one for one in order if bool(one[2].steps_of) == following and self._is_missing(*one)]
            trainings = {_named(*one): partial(self._trained, *one) for one in ours}
            train_on(engine, trainings, lambda result: None if result is None else tell(result), progress)

    def _is_missing(self, minutes: float, seed: int, contestant: Contestant) -> bool:
        """True if no successful result is stored."""
        return self._success(contestant.name, minutes, seed) is None

    def _success(self, method: str, minutes: float, seed: int) -> ComparisonResult | None:
        """The stored result; None if it is missing or failed."""
        result = find(self.records, self.wanted(method, minutes, seed))
        return None if result is None or result.error else result

    def _trained(
        self, minutes: float, seed: int, contestant: Contestant, watch: StudyWatch | None = None, following: int = 0
    ) -> ComparisonResult | None:
        """Train, score and store one result, before `following` others.

        Returns None where it can't be made yet, or another process makes it or has made it.
        """
        watch = watch or StudyWatch(lambda _: None)
        wanted, steps = self.wanted(contestant.name, minutes, seed), self._steps_for(contestant, minutes, seed)
        with self._claimed(wanted) as work:
            if work is None or not steps or not self._is_missing(minutes, seed, contestant):
                return None
            watch.begin(_named(minutes, seed, contestant), following)
            result = self._attempted(contestant, wanted, steps, work, watch)
            watch.end()
            save(self.records, result)
        return result

    def wanted(self, method: str, minutes: float, seed: int) -> ComparisonResult:
        """A result with its key alone, before training."""
        plan = self.plan_of(method)
        return ComparisonResult(method, minutes, seed, plan.size, plan.precision, self.task.mark, self.device)

    def plan_of(self, method: str) -> Plan:
        """The plan in the precision that the method is trained in on this machine."""
        return replace(self.plan, precision=precision_here(self._preferred(method), self.device))

    def chosen_rates(self, contestant: Contestant) -> tuning.Tuning | None:
        """The tuned rates of a contestant, in the study's size; None where it is not tuned."""
        if not contestant.is_tuned:
            return None
        return tuning.find(self.all_records, contestant.name, self.plan_of(contestant.name))

    def at_published_rates(self) -> list[str]:
        """Names of contestants that will be trained at published rates because the records hold no tuned ones."""
        order = self._order(self.contestants)
        coming = {one[2].name for one in order if one[0] != AS_PUBLISHED and self._is_missing(*one)}
        tunable = [one for one in self.contestants if one.is_tuned and one.name in coming]
        return [one.name for one in tunable if self.chosen_rates(one) is None]

    def _preferred(self, method: str) -> Precision:
        all_contestants = {**CONTESTANTS, **{contestant.name: contestant for contestant in self.contestants}}
        return all_contestants[method].precision if method in all_contestants else self.plan.precision

    def _keep_trivial(self, tell: Callable[[ComparisonResult], None]) -> None:
        wanted = self.wanted(TRIVIAL, 0.0, 0)
        stored = find(self.records, wanted)
        if stored is not None:
            self._require_same_pictures(stored)
            if not are_kept(self.records, TRUTH):
                keep_truth(self.records, self.task)
            return
        begun = time.process_time()
        cells = trivial_cells(self.task, ALL_METRICS)
        seconds = time.process_time() - begun
        provenance, colors = Provenance.now(seconds), self.task.colors
        result = replace(wanted, cells=cells, colors=colors, seconds=seconds, provenance=provenance)
        save(self.records, result)
        keep_truth(self.records, self.task)
        tell(result)

    def _require_same_pictures(self, stored: ComparisonResult) -> None:
        """Raise ValueError where the records belong to images that differ by more than rounding."""
        for cell, color in self.task.colors.items():
            before = stored.colors.get(cell, ())
            if len(before) != len(color) or not np.allclose(before, color, rtol=0.0, atol=SAME_COLOR):
                raise ValueError(
                    f"the results in {self.records} belong to other images than {self.task.catalog.path}: the mean color of the "
                    f"test images of {cell!r} was {np.round(before, 5).tolist()} and is {np.round(color, 5).tolist()}; render the "
                    "scene as it was, or keep results elsewhere with --records"
                )

    def _steps_for(self, contestant: Contestant, minutes: float, seed: int) -> int:
        """Number of steps: 1 if the time decides, as published, or those of another contestant; 0 while these are unknown."""
        if not contestant.steps_of:
            return 1 if minutes != AS_PUBLISHED else contestant.official_steps
        like = self._success(contestant.steps_of, minutes, seed)
        return 0 if like is None else like.steps

    @contextlib.contextmanager
    def _claimed(self, wanted: ComparisonResult) -> Iterator[Path | None]:
        """The folder to train in, locked; None while another process has locked it."""
        folder = self.folder / FITS / wanted.name
        durable.make_folder(folder)
        with contextlib.ExitStack() as stack:
            try:
                stack.enter_context(locked(folder))
                free = True
            except RuntimeError:
                free = False
            yield folder / "fit" if free else None

    def _attempted(
        self, contestant: Contestant, wanted: ComparisonResult, steps: int, work: Path, watch: StudyWatch
    ) -> ComparisonResult:
        begun = time.process_time()
        try:
            outcome: dict[str, Any] = self._made(contestant, wanted, steps, work, watch)
        except (
            ValueError,
            RuntimeError,
            MemoryError,
            FloatingPointError,
        ) as error:  # the other methods can still be compared
            outcome = {"error": f"{type(error).__name__}: {' '.join(str(error).split())}"}
        shutil.rmtree(work, ignore_errors=True)
        return replace(wanted, **outcome, provenance=Provenance.now(time.process_time() - begun))

    def _made(
        self, contestant: Contestant, wanted: ComparisonResult, steps: int, work: Path, watch: StudyWatch
    ) -> dict[str, Any]:
        form = self.plan_of(contestant.name)
        tuned = self.chosen_rates(contestant)
        seconds = None if wanted.minutes == AS_PUBLISHED else 60.0 * wanted.minutes

        def made(rate: float, folder: Path) -> tuple[TrainedContestant, dict[str, dict[str, Any]]]:
            plan = replace(form, steps=steps, seed=wanted.seed, rate=rate)
            session = TrainingContext(folder, self.folder / SHARED, self.device, self.until, watch.counter("steps"))
            trained = contestant.trained(self.task, plan, seconds, session)
            cells = scored(trained.predictor, self.task)
            if not all(math.isfinite(cell["psnr"]) for cell in cells.values()):
                raise Diverged("training diverged: its images are not finite")
            return trained, cells

        rate = 1.0 if tuned is None else tuned.rate
        rates = tuning.rates_from(rate) if contestant.is_tuned else [rate]
        trained, cells = tuning.at_rates_that_hold(rates, work, made)
        if wanted.seed == 0:
            keep_drawn(self.records, wanted.name, trained.predictor, self.task)
        change, view = trained.measured()
        return {
            "threads": trained.plan.threads,
            "rate": trained.plan.rate,
            "steps": trained.plan.steps,
            "seconds": trained.seconds,
            "megabytes": trained.megabytes,
            "cells": cells,
            "curve": [list(point) for point in trained.curve],
            "change_milliseconds": change.median,
            "picture_milliseconds": view.median,
        }


def _named(minutes: float, seed: int, contestant: Contestant) -> str:
    return f"{contestant.name}, {minutes:g} min, seed {seed}"


@one_torch_thread()
def scored(predictor: Predictor, task: ComparisonTask) -> dict[str, dict[str, Any]]:
    """Means by cell and metric, and the number of images of each cell."""
    [scores] = score_cases(
        predictor, task.catalog, task.cases, perceptual=PerceptualMetrics.load(), looked_at=set(task.cases)
    )
    return {
        name: {**means([scores[case] for case in cell], ALL_METRICS), "images": len(cell)}
        for name, cell in task.cells.items()
    }
