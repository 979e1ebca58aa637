"""Every method in every time with every seed on one scene: what is missing, each kept at once, shared out between processes."""

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
SAME_COLOR = 1e-4  # of 1: far more than few pixels change a mean that another processor rounds otherwise


@dataclass(frozen=True, eq=False)
class ComparisonStudy:
    """What is to be compared on one scene.

    A contestant that takes another's steps is trained once these are known.

    Attributes
    ----------
    task : the scene's pictures.
    folder : of what is made.
    records, all_records : of the scene's results, and the one above it, of tuning.
    contestants, minutes, seeds : every one of these in every time, with so many seeds from 0 on.
    plan : size of all.
    device : of trainings, and of the pictures that are timed.
    until : `time.monotonic()` at which it stops, to go on another day.
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
        """Train and score what has no result yet; `tell` is given each once it is kept, failures included.

        An interruption loses the last minutes of a published method's training, and of ours the current one; what another process
        does is left to it.  With an `engine` its workers train, which must see all folders.  Raises ValueError where the records
        are of other pictures, `OutOfTime` where it stops before the end, and RuntimeError in the end where trainings could not be
        made on the engine.
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
        """Let workers train what is missing; those who take the steps of others come after all others."""
        for following in (False, True):
            ours = [one for one in order if bool(one[2].steps_of) == following and self._is_missing(*one)]
            trainings = {_named(*one): partial(self._trained, *one) for one in ours}
            train_on(engine, trainings, lambda result: None if result is None else tell(result), progress)

    def _is_missing(self, minutes: float, seed: int, contestant: Contestant) -> bool:
        """Whether there is no result without an error."""
        return self._known(contestant.name, minutes, seed) is None

    def _known(self, method: str, minutes: float, seed: int) -> ComparisonResult | None:
        """The result without an error."""
        result = find(self.records, self.wanted(method, minutes, seed))
        return None if result is None or result.error else result

    def _trained(
        self, minutes: float, seed: int, contestant: Contestant, watch: StudyWatch | None = None, following: int = 0
    ) -> ComparisonResult | None:
        """The result of a training, kept; None where it can't be made, another process makes it, or did.  So many follow it."""
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
        """What a result has that is not made yet."""
        plan = self.plan_of(method)
        return ComparisonResult(method, minutes, seed, plan.size, plan.precision, self.task.mark, self.device)

    def plan_of(self, method: str) -> Plan:
        """The size of all, in the precision that the method is trained in on this machine."""
        return replace(self.plan, precision=precision_here(self._preferred(method), self.device))

    def chosen_rates(self, contestant: Contestant) -> tuning.Tuning | None:
        """What short trainings of a contestant found, in the study's size; None where nobody made them, or nobody may."""
        if not contestant.is_tuned:
            return None
        return tuning.find(self.all_records, contestant.name, self.plan_of(contestant.name))

    def at_published_rates(self) -> list[str]:
        """Who is yet to be trained in a given time at published rates though rates may be chosen, because the records hold none."""
        order = self._order(self.contestants)
        coming = {one[2].name for one in order if one[0] != AS_PUBLISHED and self._is_missing(*one)}
        tunable = [one for one in self.contestants if one.is_tuned and one.name in coming]
        return [one.name for one in tunable if self.chosen_rates(one) is None]

    def _preferred(self, method: str) -> Precision:
        known = {**CONTESTANTS, **{contestant.name: contestant for contestant in self.contestants}}
        return known[method].precision if method in known else self.plan.precision

    def _keep_trivial(self, tell: Callable[[ComparisonResult], None]) -> None:
        wanted = self.wanted(TRIVIAL, 0.0, 0)
        known = find(self.records, wanted)
        if known is not None:
            self._require_same_pictures(known)
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

    def _require_same_pictures(self, known: ComparisonResult) -> None:
        """Raise ValueError where the records are of pictures that differ by more than rounding."""
        for cell, color in self.task.colors.items():
            kept = known.colors.get(cell, ())
            if len(kept) != len(color) or not np.allclose(kept, color, rtol=0.0, atol=SAME_COLOR):
                raise ValueError(
                    f"the results in {self.records} are of other pictures than {self.task.catalog.path}: the mean color of the "
                    f"test images of {cell!r} was {np.round(kept, 5).tolist()} and is {np.round(color, 5).tolist()}; render the "
                    "scene as it was, or keep results elsewhere with --records"
                )

    def _steps_for(self, contestant: Contestant, minutes: float, seed: int) -> int:
        """At least one, or as many as published; as another made whose steps this one takes, none before that is known."""
        if not contestant.steps_of:
            return 1 if minutes != AS_PUBLISHED else contestant.official_steps
        like = self._known(contestant.steps_of, minutes, seed)
        return 0 if like is None else like.steps

    @contextlib.contextmanager
    def _claimed(self, wanted: ComparisonResult) -> Iterator[Path | None]:
        """Where to train, while no other process does; None where one does."""
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
            found = self._made(contestant, wanted, steps, work, watch)
        except (ValueError, RuntimeError, MemoryError, FloatingPointError) as error:  # the others may do without
            found = {"error": f"{type(error).__name__}: {' '.join(str(error).split())}"}
        shutil.rmtree(work, ignore_errors=True)
        return replace(wanted, **found, provenance=Provenance.now(time.process_time() - begun))

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
                raise Diverged("training diverged: its pictures are no numbers")
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
    """Means by cell and metric, and the number of images."""
    [found] = score_cases(
        predictor, task.catalog, task.cases, perceptual=PerceptualMetrics.load(), looked_at=set(task.cases)
    )
    return {
        name: {**means([found[case] for case in cell], ALL_METRICS), "images": len(cell)}
        for name, cell in task.cells.items()
    }
