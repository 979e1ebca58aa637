"""Time of a training step of stage 2, in parts."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import torch

from research.benchmarks.page import table
from research.benchmarks.splatting.figures import COLORS, panels
from research.benchmarks.splatting.setup import Setup, limited_to, said
from research.benchmarks.splatting.workloads import FIXED, Workload
from research.benchmarks.timing import MeasuredTime, digits, measured, measured_in_turn
from surrogate.deformation.bilinear import BilinearDeformation
from surrogate.evaluation.metrics import WHITE
from surrogate.rasterizer import Rasterizer
from surrogate.settings import TrainingSettings
from surrogate.training.data import Example, TrainingData
from surrogate.training.loop import StageRun
from surrogate.training.losses import image_loss
from surrogate.training.optimizer import Adam
from surrogate.training.stages import Stage, simulation_stage

FIGURE = "splatting_step.png"
VARIABLE = "GS_SURROGATE_INSTRUCTION_SET"
Steps = tuple[MeasuredTime, list[MeasuredTime]]  # whole steps, and their parts
PARTS = ("deform", "draw", "loss and its gradient", "backward", "Adam")
SETTINGS = TrainingSettings(relocation_interval=0)


@dataclass(frozen=True, eq=False)
class StepSetup:
    """The subject of timed steps: a stage whose rates move nothing, so that the workload stays the same, and one image."""

    stage: Stage
    example: Example


def training(workload: Workload) -> StepSetup:
    """Stage 2 of one parameter on the workload's Gaussians; the image is their own rendering in 8 bits."""
    gaussians, camera = workload.gaussians(), workload.camera()
    rendering = Rasterizer.of(SETTINGS).draw(gaussians, camera)
    rgba = torch.cat([rendering.color.clamp(0, 1), rendering.alpha.unsqueeze(-1)], dim=2)  # [H, W, 4]
    pixels = torch.minimum(rgba, rgba[..., 3:]).mul(255).round().to(torch.uint8).numpy()
    deformation = BilinearDeformation.create(gaussians, 1, SETTINGS)
    stage = simulation_stage(gaussians, deformation, SETTINGS)
    stage = replace(stage, rates=dict.fromkeys(stage.rates, 1e-12))
    return StepSetup(stage, Example(camera, torch.tensor([0.3]), np.ascontiguousarray(pixels)))


def whole_step(setup: StepSetup, seconds: float) -> MeasuredTime:
    """One step as training takes it."""
    return measured(
        StageRun(setup.stage, SETTINGS, TrainingData([setup.example], [], None)).advance, seconds, most=1000
    )


def step_parts(setup: StepSetup, seconds: float) -> list[MeasuredTime]:
    """The same calls one by one: a measurement per entry of `PARTS`, and the sum."""
    stage, example = setup.stage, setup.example
    adam, rasterizer = Adam(stage.tensors, stage.rates, shared=stage.shared), Rasterizer.of(SETTINGS)
    state: dict[str, Any] = {}

    def deform() -> None:
        state["gaussians"] = stage.gaussians_at(example.parameters)

    def draw() -> None:
        state["picture"] = rasterizer.draw_over(state["gaussians"], example.camera, WHITE)

    def compare() -> None:
        target = torch.from_numpy(example.compared())
        state["loss"] = image_loss(state["picture"], target)

    def differentiate() -> None:
        state["loss"].backward()

    calls: list[Callable[[], None]] = [deform, draw, compare, differentiate, lambda: adam.step(1.0)]
    return measured_in_turn(calls, seconds)


def step(setup: Setup) -> str:
    """Steps per second, with the parts, on one thread and on two."""
    subject = training(replace(FIXED, count=2_000) if setup.quick else FIXED)
    results: dict[tuple[str, int], Steps] = {}
    for name, threads in ((name, threads) for name in setup.instruction_sets for threads in setup.threads):
        setup.say(f"a training step, {name}, {said(threads)}")
        with limited_to(threads), _by(name):
            results[name, threads] = whole_step(subject, 2 * setup.seconds), step_parts(subject, 2 * setup.seconds)
    best = {threads: steps for (name, threads), steps in results.items() if name == setup.instruction_sets[0]}
    with panels(setup.output / FIGURE, width=8.0, height=1.2 + 0.55 * len(best)) as axes:
        _plot(axes, best)
    rows = []
    for (name, threads), (whole, parts) in results.items():
        rest = whole.median - parts[-1].median
        cells = [str(whole), digits(1e3 / whole.median), *map(str, parts[:-1]), digits(rest)]
        rows.append([name, str(threads), *cells])
    header = ["instruction set", "threads", "whole step, ms", "steps/s", *(f"{part}, ms" for part in PARTS), "rest, ms"]
    return table(header, rows)


@contextmanager
def _by(instruction_set: str) -> Iterator[None]:
    """Let all kernels use an instruction set."""
    os.environ[VARIABLE] = instruction_set
    try:
        yield
    finally:
        del os.environ[VARIABLE]


def _plot(axes: Any, results: dict[int, Steps]) -> None:
    for threads, (whole, parts) in results.items():
        left = 0.0
        for part, color, taken in zip(PARTS, COLORS, parts[:-1], strict=True):
            axes.barh(said(threads), taken.median, left=left, color=color, label=part if threads == 1 else None)
            if taken.median > 0.06 * whole.median:
                middle = left + taken.median / 2
                axes.text(middle, said(threads), digits(taken.median), color="white", ha="center", va="center")
            left += taken.median
        axes.text(left, said(threads), f"  {1e3 / whole.median:.0f} steps/s", va="center")
    axes.set(xlabel="ms of one training step (medians)")
    axes.grid(visible=False, axis="y")
    axes.margins(x=0.14)
    axes.legend(ncols=len(PARTS), loc="lower center", bbox_to_anchor=(0.5, 1.0))
