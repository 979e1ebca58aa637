"""An ablation from start to end: missing fits are shared between processes, stored, and written as a page."""

from __future__ import annotations

import contextlib
import math
import shutil
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

from catalogs.engines.engine import Engine
from catalogs.files import durable
from research.studies.ablation import table
from research.studies.ablation.comparison import VariantRow, compared
from research.studies.ablation.experiments import Experiment, score
from research.studies.ablation.records import DECIDING, AblationResult, Records
from research.studies.ablation.timing import STAGES, StepTimes, clock, scheduled, steps_of, with_steps
from research.studies.ablation.variants import Variant, selected
from research.studies.progress import StudyProgress, StudyWatch
from research.studies.remote import train_on
from surrogate.evaluation.scoring import mean
from surrogate.provenance import code
from surrogate.settings import TrainingSettings
from surrogate.storage.checkpoints import locked
from surrogate.storage.records import Provenance
from surrogate.training.session import TrainingProgress

PROBE = 0.1  # fraction of the budget for measuring the speed first
LONGEST = 10.0  # budgets that a fit with given steps may take
WORK = "fits"  # subfolders, locked by the process that trains there
MODEL = "surrogate"
LOCK = ".page.lock"

_One = tuple[Variant, int]  # with its seed


def ablate(
    scene: str,
    experiment: Experiment,
    folder: Path,
    *,
    engine: Engine | None = None,
    progress: Callable[[StudyProgress], None] = lambda _: None,
    tell: Callable[[AblationResult], None] = lambda _: None,
    **options: Any,
) -> list[VariantRow]:
    """Run all missing fits, writing ablation.md and ablation.png into `folder` after each; returns the rows of the table.

    `options` and errors are those of `AblationStudy`, `engine` and its errors those of `AblationStudy.run`.
    """
    study = AblationStudy(experiment, folder, **options)
    durable.make_folder(folder)
    durable.remove_abandoned(folder)

    def write_page() -> list[VariantRow]:
        with durable.locked(folder / LOCK):  # so that the last page has every result
            rows = compared(study.records.all(), experiment.variants)
            table.write(scene, folder, study.records.budget, rows)
        return rows

    def keep(result: AblationResult) -> None:
        write_page()
        tell(result)

    study.run(engine=engine, progress=progress, tell=keep)
    return write_page()


class AblationStudy:
    """The variants of `experiment`, each trained in `folder` for `seconds` with each of the `seeds`.

    Results are stored in `records`, by default `folder`; those of the same settings and code are skipped unless they
    failed. `only` names variants, by default all. `longest` is the limit in seconds of a fit that takes another's
    steps. With `again`, fits that missed their time noticeably are repeated. Raises ValueError for an unknown variant,
    and for times or seeds that are not positive.
    """

    def __init__(
        self,
        experiment: Experiment,
        folder: Path,
        *,
        records: Path | None = None,
        seconds: float = 180.0,
        seeds: int = 3,
        only: Iterable[str] = (),
        longest: float | None = None,
        again: bool = False,
    ) -> None:
        longest = LONGEST * seconds if longest is None else longest
        for name, value in (("seconds", seconds), ("seeds", seeds), ("longest", longest)):
            if not (math.isfinite(value) and value > 0):
                raise ValueError(f"{name} must be positive, got {value}")
        self.variants, self.seeds = selected(only, experiment.variants), seeds
        self.longest, self._again = longest, again
        self.records = Records(folder if records is None else records, experiment, seconds)
        self._experiment, self._work = experiment, folder / WORK
        self._rejected: dict[_One, AblationResult | None] = {}

    def run(
        self,
        *,
        engine: Engine | None = None,
        progress: Callable[[StudyProgress], None] = lambda _: None,
        tell: Callable[[AblationResult], None] = lambda _: None,
    ) -> None:
        """Run all missing fits; `tell` receives each stored result, failures included.

        An interruption loses the current fit only. Fits of another process, and those that take their steps, come last,
        since that process may have been killed. With an `engine`, its workers fit; they must see all folders.
        RuntimeError is raised at the end where fits failed there.
        """
        watch = StudyWatch(progress, (1.0 + PROBE) * self.records.budget)
        # every variant once before any second seed
        left, fitted = [(variant, seed) for seed in range(self.seeds) for variant in self.variants], True
        self._rejected = {one: self.records.find(*one) for one in left if self._is_to_be_repeated(*one)}
        if engine is not None:
            self._run_on(engine, left, progress, tell)
            return
        while left and fitted:
            left, fitted = self._passed_over(left, watch, tell)

    def _run_on(
        self,
        engine: Engine,
        all_of: Sequence[_One],
        progress: Callable[[StudyProgress], None],
        tell: Callable[[AblationResult], None],
    ) -> None:
        """Run missing fits on workers; variants that take the steps of others come last."""
        for following in (False, True):
            wanted = [one for one in all_of if bool(one[0].steps_of) == following and not self._is_finished(*one)]
            fits = {f"{variant.name}, seed {seed}": partial(self._fitted, variant, seed) for variant, seed in wanted}
            train_on(engine, fits, lambda result: None if result is None else tell(result), progress)

    def _fitted(
        self, variant: Variant, seed: int, watch: StudyWatch | None = None, following: int = 0
    ) -> AblationResult | None:
        """Run and store one fit, before `following` others; None where another process runs it or has just done so."""
        watch = watch or StudyWatch(lambda _: None)
        with self._claimed(variant, seed) as work:
            if work is None:
                return None
            watch.begin(f"{variant.name}, seed {seed}", following)
            result = self._attempted(variant, seed, work, watch)
            self._keep(variant, result)
            watch.end()
        return result

    def _passed_over(
        self, left: Sequence[_One], watch: StudyWatch, tell: Callable[[AblationResult], None]
    ) -> tuple[list[_One], bool]:
        """Run missing fits; returns those left to other processes, and True if anything was fitted."""
        passed, fitted = [], False
        # checked each time: a fit may take the steps of an earlier one
        while left := [one for one in left if not self._is_finished(*one)]:
            (variant, seed), *left = left
            result = self._fitted(variant, seed, watch, len(left))
            if result is None:
                passed.append((variant, seed))
                continue
            fitted = True
            tell(result)
        return passed, fitted

    def _keep(self, variant: Variant, result: AblationResult) -> None:
        """Store a result, unless it is a failure that would replace a usable one."""
        before = self.records.find(variant, result.seed)
        usable = before is not None and not before.error and not variant.steps_of
        if not (result.error and usable):
            self.records.save(result)

    @contextlib.contextmanager
    def _claimed(self, variant: Variant, seed: int) -> Iterator[Path | None]:
        """The folder to train in, locked; None where another process trains or has just finished."""
        folder = self._folder(variant.name, seed)
        with contextlib.ExitStack() as stack:
            try:
                stack.enter_context(locked(folder))
                free = not self._is_finished(variant, seed) and not self._is_awaited(variant, seed)
            except RuntimeError:
                free = False
            yield folder / MODEL if free else None

    def _folder(self, name: str, seed: int) -> Path:
        folder = self._work / f"{name}.seed{seed}"
        durable.make_folder(folder)
        return folder

    def _is_to_be_repeated(self, variant: Variant, seed: int) -> bool:
        """True if a failed or untimely fit is to be repeated, once by all processes together; determined at the start."""
        result = self.records.find(variant, seed)
        if result is None:
            return False
        late = self._again and not variant.steps_of and not result.is_timely
        return bool(result.error) or late or result.provenance.code != code(DECIDING)

    def _is_finished(self, variant: Variant, seed: int) -> bool:
        result = self.records.find(variant, seed)
        if result is None or result == self._rejected.get((variant, seed)):
            return False
        if not variant.steps_of or result.error:
            return True
        like = self._like(variant, seed)
        return like is not None and like.steps == result.steps

    def _is_awaited(self, variant: Variant, seed: int) -> bool:
        """True if another process runs the fit whose steps a variant takes."""
        if not variant.steps_of or self._like(variant, seed) is not None:
            return False
        try:
            with locked(self._folder(variant.steps_of, seed)):
                return False
        except RuntimeError:
            return True

    def _like(self, variant: Variant, seed: int) -> AblationResult | None:
        """The result whose steps a variant takes; None without one."""
        result = self.records.find(next(v for v in self._experiment.variants if v.name == variant.steps_of), seed)
        return None if result is None or result.error else result

    def _attempted(self, variant: Variant, seed: int, work: Path, watch: StudyWatch) -> AblationResult:
        begun, values = time.process_time(), {}
        try:
            shutil.rmtree(work, ignore_errors=True)  # left by a killed process
            values = self._fit(variant, seed, work, watch)
        except Exception as error:  # the other variants can still be compared
            values = {"error": _sentence(error)}
        finally:
            shutil.rmtree(work, ignore_errors=True)
        provenance = Provenance.now(time.process_time() - begun, DECIDING)
        return self.records.result(variant, seed, provenance=provenance, **values)

    def _fit(self, variant: Variant, seed: int, work: Path, watch: StudyWatch) -> dict[str, Any]:
        settings = self.records.settings(variant, seed)
        default = self._experiment.variants[0]
        same = settings == self.records.settings(default, seed)
        if same and variant.name != default.name and not variant.steps_of:
            raise ValueError("the scene's settings say the same, so this is the default")
        watch.tell("measuring the speed", (PROBE + 1.0) * self.records.budget)
        times = self._experiment.step_times(settings, PROBE * self.records.budget)
        planned = self._planned(variant, seed, settings, times)
        now, over = clock(settings), time.perf_counter() + times.seconds(planned)
        begun = now()

        def report(training: TrainingProgress) -> None:
            left = max(over - time.perf_counter(), 0.0)
            watch.tell(replace(training, loss=None, psnr=None, seconds_left=left), left)

        surrogate = self._experiment.trained(planned, work, report)
        taken = now() - begun
        scored = score(self._experiment, surrogate)
        psnr, ssim = mean(scored, "psnr"), mean(scored, "ssim")
        if psnr is None or ssim is None or not math.isfinite(psnr + ssim):
            raise ValueError(f"training diverged: PSNR {psnr} dB, SSIM {ssim}")
        return {
            **dict(zip(STAGES, steps_of(planned), strict=True)),
            "seconds": taken,
            "psnr": psnr,
            "ssim": ssim,
            "images": len(scored),
            "gaussians": len(surrogate.gaussians),
            "step_times": list(times),
        }

    def _planned(self, variant: Variant, seed: int, settings: TrainingSettings, times: StepTimes) -> TrainingSettings:
        if not variant.steps_of:
            return scheduled(settings, self.records.budget, times)
        like = self._like(variant, seed)
        if like is None:
            raise ValueError(f"{variant.steps_of} has no result of this seed whose steps could be taken")
        planned = with_steps(settings, like.steps)
        if times.seconds(planned) > self.longest:
            raise ValueError(
                f"{like.steps:,} steps would take {times.seconds(planned):,.0f} s, more than the {self.longest:,.0f} s that "
                "a fit may take: --longest allows more"
            )
        return planned


def _sentence(error: Exception) -> str:
    """An error in one line."""
    text = " ".join(str(error).split())
    return text if isinstance(error, ValueError) and text else f"{type(error).__name__}: {text}"
