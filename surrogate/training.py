"""Training from a catalog: stages 1 and 2, checkpointed so that it can be stopped at any moment.

A run that was killed and taken up again ends bit for bit where an undisturbed one does (on the same machine): every
random choice is a function of the seed and the step, a checkpoint holds everything else, the kernels give the same result
for any number of threads, and torch, whose share of a step is small, runs on one.
"""

from __future__ import annotations

import os
import time
from collections import deque
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from catalogs.catalog import Catalog
from surrogate.canonical import canonical_stage
from surrogate.checkpoints import CHECKPOINT, Checkpoint, fingerprint, locked
from surrogate.data import foreground_color, load_examples, training_rows, validation_rows
from surrogate.deformation import KINDS, Deformation
from surrogate.gaussians import Gaussians, Normalization
from surrogate.initialize import Points, initial_gaussians, initial_points
from surrogate.interruption import Interruption
from surrogate.model import Surrogate
from surrogate.progress import ProgressReport, TrainingProgress
from surrogate.rasterizer import Rasterizer
from surrogate.settings import TrainingSettings
from surrogate.simulate import simulation_stage
from surrogate.stage import Stage
from surrogate.stage_run import StageRun, TrainingData
from surrogate.threads import one_torch_thread

REPORT_SECONDS = 0.5
COLOR_SAMPLES = 32  # images that the first colour is taken from


def train(
    settings: TrainingSettings,
    catalog: Catalog,
    directory: str | os.PathLike[str],
    *,
    progress: ProgressReport = lambda _: None,
) -> Surrogate:
    """Fit a surrogate to the training images of `catalog` and keep it in `directory`.

    A finished run is loaded and nothing is done; an interrupted one goes on from its last checkpoint.  SIGINT and
    SIGTERM write a checkpoint first and then act as ever.

    Raises ValueError where `directory` holds a run of other settings or another catalog (nothing is overwritten), or
    the catalog has nothing to learn from; RuntimeError where another process is training there.
    """
    directory = Path(directory)
    source = _Source(settings, catalog)
    mark = fingerprint(settings, catalog)
    if Surrogate.exists(directory):
        finished = Surrogate.load(directory)
        _check_mark(finished.training.get("fingerprint"), mark, directory)
        return finished
    directory.mkdir(parents=True, exist_ok=True)
    with locked(directory), one_torch_thread():
        checkpoint = Checkpoint.load(directory)
        if checkpoint is not None:
            _check_mark(checkpoint.record["fingerprint"], mark, directory)
        run = _Run(settings, source, directory, mark, progress)
        surrogate = run.finish(checkpoint)
        surrogate.save(directory)
        (directory / CHECKPOINT).unlink(missing_ok=True)
    return surrogate


@dataclass(frozen=True, eq=False)
class _Source:
    """The catalog as one run sees it."""

    settings: TrainingSettings
    catalog: Catalog
    appearance: str = field(init=False)
    normalization: Normalization = field(init=False)
    points: Points | None = field(init=False)

    def __post_init__(self) -> None:
        names = [a.name for a in self.catalog.plan.appearances]
        appearance = self.settings.appearance or names[0]
        if appearance not in names:
            raise ValueError(f"training.appearance must be one of the catalog's {names}, got {appearance!r}")
        training_rows(self.catalog)
        normalization = Normalization.of_box(self.catalog.plan.bounds)
        object.__setattr__(self, "appearance", appearance)
        object.__setattr__(self, "normalization", normalization)
        points = initial_points(self.settings, self.catalog, appearance, normalization)
        object.__setattr__(self, "points", points)

    def data(self) -> TrainingData:
        """All images that training needs, decoded."""
        learn, watch = training_rows(self.catalog), validation_rows(self.catalog, self.settings.validation_images)
        return TrainingData(
            load_examples(self.catalog, self.appearance, learn, self.normalization),
            load_examples(self.catalog, self.appearance, watch, self.normalization),
            self.catalog.plan.background,
        )

    def initial_gaussians(self, data: TrainingData) -> Gaussians:
        """What stage 1 starts from."""
        box = self.normalization.points(self.catalog.plan.bounds)  # [2, 3]
        some = data.examples[:: max(1, len(data.examples) // COLOR_SAMPLES)]
        return initial_gaussians(self.settings, box, self.points, foreground_color(some, data.background))


class _Run:
    """One training run: its stages in order, its curves, its clock and its checkpoints."""

    def __init__(
        self, settings: TrainingSettings, source: _Source, directory: Path, mark: str, progress: ProgressReport
    ) -> None:
        self._settings, self._source, self._directory = settings, source, directory
        self._mark, self._progress = mark, progress
        self._curve: list[dict[str, Any]] = []
        self._losses: list[float] = []  # since the last point of the curve
        self._seconds_before, self._started = 0.0, time.perf_counter()
        self._recent: deque[tuple[float, int]] = deque(maxlen=20)  # (time, step) of the last reports
        self._saved = self._reported = time.perf_counter()

    def finish(self, checkpoint: Checkpoint | None) -> Surrogate:
        """Run whatever is left of the stages."""
        settings, steps = self._settings, self._settings.canonical_steps + self._settings.deformation_steps
        self._progress(TrainingProgress("loading", 0, steps))
        data = self._source.data()
        gaussians = self._source.initial_gaussians(data)
        if checkpoint is not None:
            self._curve, self._losses = list(checkpoint.record["curve"]), list(checkpoint.record["losses"])
            self._seconds_before = float(checkpoint.record["seconds"])
        with Interruption() as interruption:
            if checkpoint is None or checkpoint.record["stage"] == "canonical":
                self._run(canonical_stage(gaussians, settings), data, checkpoint, 0, interruption)
                checkpoint = None
            parameters = len(self._source.catalog.plan.space)
            deformation = KINDS["bilinear"].create(gaussians, parameters, settings)
            stage = simulation_stage(gaussians, deformation, settings)
            self._run(stage, data, checkpoint, settings.canonical_steps, interruption)
        return self._surrogate(gaussians, deformation)

    def _run(
        self, stage: Stage, data: TrainingData, checkpoint: Checkpoint | None, before: int, interruption: Interruption
    ) -> None:
        run = StageRun(stage, self._settings, data)
        if checkpoint is not None:
            run.restore(dict(checkpoint.tensors), int(checkpoint.record["step"]))
        while run.step < stage.steps:
            self._losses.append(run.advance())
            done = before + run.step
            interval = self._settings.validation_interval
            if run.step == stage.steps or (interval and run.step % interval == 0):
                self._add_point(run, done)
            self._tell(run, done)
            now = time.perf_counter()
            if interruption.requested or now - self._saved > self._settings.checkpoint_seconds:
                self._checkpoint(run).save(self._directory)
                self._saved = now
                interruption.act()

    def _add_point(self, run: StageRun, done: int) -> None:
        self._curve.append(
            {
                "stage": run.stage.name,
                "step": done,
                "loss": float(np.mean(self._losses)),
                "psnr": run.validate(),
                "seconds": self._seconds(),
            }
        )
        self._losses = []

    def _checkpoint(self, run: StageRun) -> Checkpoint:
        record = {
            "fingerprint": self._mark,
            "stage": run.stage.name,
            "step": run.step,
            "curve": self._curve,
            "losses": self._losses,
            "seconds": self._seconds(),
        }
        return Checkpoint(run.tensors(), record)

    def _tell(self, run: StageRun, done: int) -> None:
        now = time.perf_counter()
        if now - self._reported < REPORT_SECONDS:
            return
        self._reported = now
        self._recent.append((now, done))
        (then, first), steps = self._recent[0], self._settings.canonical_steps + self._settings.deformation_steps
        rate = (done - first) / (now - then) if now > then else 0.0
        losses = self._losses[-200:]
        self._progress(
            TrainingProgress(
                stage=run.stage.name,
                step=done,
                steps=steps,
                rate=rate,
                loss=float(np.mean(losses)) if losses else self._curve[-1]["loss"],
                psnr=self._curve[-1]["psnr"] if self._curve else None,
                seconds_left=(steps - done) / rate if rate else None,
            )
        )

    def _seconds(self) -> float:
        return self._seconds_before + time.perf_counter() - self._started

    def _surrogate(self, gaussians: Gaussians, deformation: Deformation) -> Surrogate:
        plan = self._source.catalog.plan
        for tensor in (*gaussians.tensors().values(), *deformation.tensors().values()):
            tensor.requires_grad_(False)
        return Surrogate(
            gaussians=gaussians,
            deformation=deformation,
            space=plan.space,
            normalization=self._source.normalization,
            rasterizer=Rasterizer.of(self._settings),
            background=plan.background,
            training={
                "fingerprint": self._mark,
                "appearance": self._source.appearance,
                "seconds": self._seconds(),
                "steps": self._settings.canonical_steps + self._settings.deformation_steps,
                "settings": self._settings.to_json(),
                "curve": self._curve,
            },
        )


def _check_mark(found: str | None, mark: str, directory: Path) -> None:
    if found != mark:
        raise ValueError(
            f"{directory} holds a run with other training settings or of another catalog, and nothing is overwritten: "
            "delete or rename that folder, or train into another one"
        )
