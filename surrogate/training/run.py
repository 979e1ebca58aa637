"""Training from a catalog: stages 1, 2 and 3, checkpointed so that it can be stopped at any moment.

A run that was killed and taken up again ends bit for bit where an undisturbed one does (on the same machine): every
random choice is a function of the seed and the step, a checkpoint holds everything else, the kernels give the same result
for any number of threads, and torch, whose share of a step is small, runs on one.
"""

from __future__ import annotations

import os
import time
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor

from catalogs.catalog import Catalog
from catalogs.progress import Rate
from catalogs.variations import Variation
from surrogate.deformation import KINDS, Deformation, load_deformation
from surrogate.deformation.visualization import Visualization
from surrogate.gaussians import Gaussians
from surrogate.model import Surrogate
from surrogate.provenance import code, commit
from surrogate.rasterizer import Rasterizer
from surrogate.settings import TrainingSettings
from surrogate.splatting.device import chosen
from surrogate.splatting.threads import one_torch_thread
from surrogate.storage.checkpoints import CHECKPOINT, Checkpoint, fingerprint, locked, part_of
from surrogate.training.compression import NEEDS, VARIED_NEEDS, Need, Needs, choose_color_degree, fit_to_need
from surrogate.training.compression.color_degree import ASKED_AFTER
from surrogate.training.compression.color_degree import NAME as COLOR_DEGREE
from surrogate.training.compression.fitted import Bench, Fitted
from surrogate.training.compression.fitting import precision
from surrogate.training.compression.precision import precision_of_visualization
from surrogate.training.compression.visualized_color_degree import NAME as VISUALIZED_COLOR_DEGREE
from surrogate.training.compression.visualized_color_degree import choose_visualized_color_degree
from surrogate.training.data import TrainingData
from surrogate.training.interruption import Interruption
from surrogate.training.loop import StageRun
from surrogate.training.progress import ProgressReport, TrainingProgress
from surrogate.training.source import Source
from surrogate.training.stages import Stage, canonical_stage, simulation_stage
from surrogate.training.varying import Varying
from surrogate.training.visualizations import kind_of, new_visualization, visualization_stage

REPORT_SECONDS = 0.5
NEEDS_STAGE = "needs"


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
    the catalog has nothing to learn from, or training diverges; RuntimeError where another process is training there.
    """
    directory = Path(directory)
    source = Source(settings, catalog)
    for variation in source.variations:
        kind_of(variation, settings)  # says at once what can't be had
    mark = fingerprint(settings, catalog)
    if Surrogate.exists(directory):
        return _finished(directory, mark)
    directory.mkdir(parents=True, exist_ok=True)
    with locked(directory), one_torch_thread():
        if Surrogate.exists(directory):  # another process has just finished it
            return _finished(directory, mark)
        checkpoint = Checkpoint.load(directory)
        if checkpoint is not None:
            _check_mark(checkpoint.record["fingerprint"], mark, directory)
        run = _Run(settings, source, directory, mark, progress)
        interruption = Interruption()
        surrogate = run.finish(checkpoint, interruption)
        surrogate.save(directory)
        (directory / CHECKPOINT).unlink(missing_ok=True)
        interruption.act()  # what was asked for during the last choices
    return surrogate


def new_deformation(gaussians: Gaussians, parameters: int, settings: TrainingSettings) -> Deformation:
    """F_sim before stage 2, by `parameters` many parameters: it moves nothing yet, and never what is to be held still."""
    deformation: Deformation = KINDS[settings.designs.simulation].create(gaussians, parameters, settings)
    for name in settings.designs.held_still:
        deformation = deformation.without(name)
    return deformation


class _Run:
    """One training run: its stages in order, its curves, its clock and its checkpoints."""

    def __init__(
        self, settings: TrainingSettings, source: Source, directory: Path, mark: str, progress: ProgressReport
    ) -> None:
        self._settings, self._source, self._directory = settings, source, directory
        self._mark, self._progress = mark, progress
        self._curve: list[dict[str, Any]] = []
        self._losses: list[float] = []  # since the last point of the curve
        self._choices: list[dict[str, Any]] = []
        self._color_degree: int | None = None  # once it is chosen
        self._carried: dict[str, Tensor] = {}
        self._carried_record: dict[str, Any] = {}
        self._seconds_before, self._started = 0.0, time.perf_counter()
        self._rate = Rate()
        self._saved = self._reported = time.perf_counter()

    def finish(self, checkpoint: Checkpoint | None, interruption: Interruption) -> Surrogate:
        """Run whatever is left of the stages."""
        self._progress(TrainingProgress("loading", 0, self._steps))
        data = self._source.data()
        if checkpoint is not None:
            self._curve, self._losses = list(checkpoint.record["curve"]), list(checkpoint.record["losses"])
            self._seconds_before = float(checkpoint.record["seconds"])
            self._choices, self._color_degree = list(checkpoint.record["choices"]), checkpoint.record["color_degree"]
        with interruption:
            if checkpoint is None or checkpoint.record["stage"] in ("canonical", "deformation"):
                needs = Needs(self._fit(data, checkpoint, interruption))
            else:
                needs = _restored(checkpoint)
                needs = replace(needs, fitted=needs.fitted.to(chosen(self._settings.device)))
            if not self._source.variations:
                return self._surrogate(self._need(needs, data, interruption))
            if needs.done < len(VARIED_NEEDS):
                needs, checkpoint = self._need(needs, data, interruption, VARIED_NEEDS), None
            learnt = self._vary(needs.fitted, checkpoint, interruption)
            return self._surrogate(*self._stored_in_fewer_bits(needs, learnt, data))

    def _fit(self, data: TrainingData, checkpoint: Checkpoint | None, interruption: Interruption) -> Fitted:
        """Stages 1 and 2."""
        settings, device = self._settings, chosen(self._settings.device)
        gaussians = self._source.initial_gaussians(data).to(device)
        if checkpoint is None or checkpoint.record["stage"] == "canonical":
            run = _resumed(canonical_stage(gaussians, settings), settings, data, checkpoint)
            self._run(run, 0, settings.steps.canonical, interruption)
            checkpoint = None
        deformation = new_deformation(gaussians, len(self._source.catalog.plan.space), settings).to(device)
        degree = self._color_degree or gaussians.color_degree
        fitted = Fitted(gaussians.copy().with_color_degree(degree), deformation)
        run = _resumed(simulation_stage(*fitted, settings), settings, data, checkpoint)
        if settings.color_degree == "auto" and self._color_degree is None:
            self._run(run, settings.steps.canonical, round(ASKED_AFTER * settings.steps.deformation), interruption)
            fitted, run = self._ask_color_degree(fitted, run, data)
        self._run(run, settings.steps.canonical, settings.steps.deformation, interruption)
        return fitted.copy()

    def _ask_color_degree(self, fitted: Fitted, run: StageRun, data: TrainingData) -> tuple[Fitted, StageRun]:
        """What stage 2 goes on with."""
        self._color_degree = 0
        if data.validation:
            self._announce(COLOR_DEGREE, self._settings.steps.canonical + run.step)
            self._color_degree, choice = choose_color_degree(fitted.copy(), self._bench(data))
            self._choices.append(choice.to_json())
        if self._color_degree == fitted.gaussians.color_degree:
            return fitted, run
        wider = Fitted(fitted.gaussians.copy().with_color_degree(self._color_degree), fitted.deformation)
        later = StageRun(simulation_stage(*wider, self._settings), self._settings, data)
        later.restore(_widened(run.tensors(), later.tensors()), run.step)
        return wider, later

    def _bench(self, data: TrainingData) -> Bench:
        return Bench(self._settings, replace(data, validation=self._source.judges))

    def _need(
        self,
        needs: Needs,
        data: TrainingData,
        interruption: Interruption,
        choices: Sequence[Need] = NEEDS,
    ) -> Needs:
        """What follows stage 2; a checkpoint after each choice, which is made again where it was interrupted."""
        if not (self._settings.compression.enabled and data.validation):
            return needs
        bench = self._bench(data)
        while needs.done < len(choices):
            self._announce(NEEDS_STAGE, needs.done, len(choices))
            self._carry(needs)
            self._saved_state(NEEDS_STAGE, needs.done, {}).save(self._directory)
            interruption.act()
            needs, choice = fit_to_need(needs, bench, choices)
            self._choices.append(choice.to_json())
        return needs

    def _vary(
        self, fitted: Fitted, checkpoint: Checkpoint | None, interruption: Interruption
    ) -> tuple[Visualization, ...]:
        """Stage 3: every variation of the appearance, one after the other."""
        settings, state = self._settings, Varying.restored(checkpoint)
        before = settings.steps.canonical + settings.steps.deformation
        for number, variation in enumerate(self._source.variations):
            if number >= len(state.finished):
                data = self._source.varied_data(variation)
                if state.color_degree is None:
                    degree = self._shown_degree(fitted, variation, data, before)
                    state, checkpoint = replace(state, color_degree=degree), None
                visualization = new_visualization(*fitted, variation, self._source, state.color_degree or 0)
                stage = visualization_stage(*fitted, visualization, settings)
                self._carry(Needs(fitted, len(VARIED_NEEDS)), state)
                run = _resumed(stage, settings, data, checkpoint)
                self._run(run, before, settings.steps.visualization, interruption)
                state, checkpoint = Varying((*state.finished, visualization.copy())), None
            before += settings.steps.visualization
        return state.finished

    def _shown_degree(self, fitted: Fitted, variation: Variation, data: TrainingData, step: int) -> int:
        """The colour degree that F_vis goes on with."""
        self._announce(VISUALIZED_COLOR_DEGREE, step)
        judged = replace(data, validation=self._source.varied_judges(variation).validation)
        degree, choice = choose_visualized_color_degree(fitted, variation, self._source, judged)
        self._choices += [] if choice is None else [choice.to_json()]
        return degree

    def _stored_in_fewer_bits(
        self, needs: Needs, learnt: Sequence[Visualization], data: TrainingData
    ) -> tuple[Needs, tuple[Visualization, ...]]:
        """The last choice, for all parts of the model."""
        found = []
        if self._settings.compression.enabled and data.validation:
            needs, choice = fit_to_need(needs, self._bench(data), (*VARIED_NEEDS, precision))
            self._choices.append(choice.to_json())
        for number, visualization in enumerate(learnt):
            visualization = visualization.to(torch.device("cpu"))
            bench = Bench(self._settings, self._source.varied_judges(visualization.variation))
            if self._settings.compression.enabled and data.validation and bench.data.validation:
                visualization, encodings, choice = precision_of_visualization(visualization, needs.fitted, bench)
                named = {f"visualization{number}.{name}": encoding for name, encoding in encodings.items()}
                needs = replace(needs, encodings={**needs.encodings, **named})
                self._choices.append(choice.to_json())
            found.append(visualization)
        return needs, tuple(found)

    def _carry(self, needs: Needs, varying: Varying | None = None) -> None:
        """What the next checkpoints must hold besides the tensors that are trained."""
        deformation = needs.fitted.deformation
        self._carried = {f"fitted.{name}": tensor for name, tensor in needs.fitted.tensors().items()}
        self._carried_record = {
            "deformation": {"kind": deformation.kind, **deformation.record()},
            "needs": needs.done,
        }
        if varying is not None:
            self._carried |= varying.tensors()
            self._carried_record |= {"varying": varying.record()}

    def _announce(self, stage: str, step: int, steps: int | None = None) -> None:
        psnr = self._curve[-1]["psnr"] if self._curve else None
        self._progress(TrainingProgress(stage, step, self._steps if steps is None else steps, psnr=psnr))

    @property
    def _steps(self) -> int:
        """Of all stages."""
        stage_3 = len(self._source.variations) * self._settings.steps.visualization
        return self._settings.steps.canonical + self._settings.steps.deformation + stage_3

    def _run(self, run: StageRun, before: int, until: int, interruption: Interruption) -> None:
        """Take a stage up to its step `until`; `before` is how many steps the stages before it had."""
        while run.step < until:
            self._losses.append(run.advance())
            done = before + run.step
            interval = self._settings.validation.interval
            if run.step == run.stage.steps or (interval and run.step % interval == 0):
                self._add_point(run, done)
            self._tell(run, done)
            now = time.perf_counter()
            if interruption.requested or now - self._saved > self._settings.checkpoint_seconds:
                run.require_finite()  # the checkpoint before stays
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
        return self._saved_state(run.stage.name, run.step, run.tensors())

    def _saved_state(self, stage: str, step: int, tensors: Mapping[str, Tensor]) -> Checkpoint:
        of_run = {f"run.{name}": tensor for name, tensor in tensors.items()}
        return Checkpoint({**self._carried, **of_run}, {**self._record(stage, step), **self._carried_record})

    def _record(self, stage: str, step: int) -> dict[str, Any]:
        return {
            "fingerprint": self._mark,
            "stage": stage,
            "step": step,
            "curve": self._curve,
            "losses": self._losses,
            "choices": self._choices,
            "color_degree": self._color_degree,
            "seconds": self._seconds(),
        }

    def _tell(self, run: StageRun, done: int) -> None:
        now = time.perf_counter()
        if now - self._reported < REPORT_SECONDS:
            return
        self._reported = now
        rate, steps = self._rate(done), self._steps
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

    def _surrogate(self, needs: Needs, visualizations: tuple[Visualization, ...] = ()) -> Surrogate:
        plan, fitted = self._source.catalog.plan, needs.fitted.to(torch.device("cpu"))
        return Surrogate(
            gaussians=fitted.gaussians,
            deformation=fitted.deformation,
            space=plan.space,
            normalization=self._source.normalization,
            rasterizer=Rasterizer.of(self._settings).for_any_device(),
            background=plan.background,
            training={
                "fingerprint": self._mark,
                "appearance": self._source.appearance,
                "seconds": self._seconds(),
                "commit": commit(),
                "code_version": code(),
                "steps": self._steps,
                "settings": self._settings.to_json(),
                "curve": self._curve,
                "choices": self._choices,
            },
            encodings=needs.encodings,
            visualizations=visualizations,
        )


def _resumed(stage: Stage, settings: TrainingSettings, data: TrainingData, checkpoint: Checkpoint | None) -> StageRun:
    """The stage's run from its start, or from where the checkpoint was taken."""
    run = StageRun(stage, settings, data)
    if checkpoint is not None:
        run.restore(part_of(checkpoint.tensors, "run"), int(checkpoint.record["step"]))
    return run


def _widened(tensors: Mapping[str, Tensor], like: Mapping[str, Tensor]) -> dict[str, Tensor]:
    """Tensors with as many columns as those of the same name in `like`, the new ones zero."""
    return {
        name: torch.nn.functional.pad(t.detach(), (0, like[name].shape[1] - t.shape[1])) if t.ndim == 2 else t.detach()
        for name, t in tensors.items()
    }


def _restored(checkpoint: Checkpoint) -> Needs:
    tensors, record = part_of(checkpoint.tensors, "fitted"), checkpoint.record["deformation"]
    deformation = load_deformation(record["kind"], part_of(tensors, "deformation"), record)
    gaussians = Gaussians(**part_of(tensors, "gaussians"))
    return Needs(Fitted(gaussians, deformation), int(checkpoint.record["needs"]))


def _finished(directory: Path, mark: str) -> Surrogate:
    finished = Surrogate.load(directory)
    _check_mark(finished.training.get("fingerprint"), mark, directory)
    return finished


def _check_mark(found: str | None, mark: str, directory: Path) -> None:
    if found != mark:
        raise ValueError(
            f"{directory} holds a run with other training settings or of another catalog, and nothing is overwritten: "
            "delete or rename that folder, or train into another one"
        )
