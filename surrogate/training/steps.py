"""The steps of training in their order: to optimize a stage, or to make a choice about the model.

Each step takes the state of training and returns the next one.  An interrupted stage goes on from the loop's memory; an interrupted
choice is made again.
"""

from __future__ import annotations

import functools
from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np
import torch

from surrogate.model.field_model import FieldModel
from surrogate.training.compression.choice import Choice
from surrogate.training.compression.choices import Choose, choices
from surrogate.training.compression.color_degree import (
    ASKED_AFTER,
    NAME,
    VARIED_NAME,
    choose_color_degree,
    choose_visualized_color_degree,
)
from surrogate.training.compression.evaluator import Evaluator
from surrogate.training.compression.precision import choose_precision, precision_of_visualization
from surrogate.training.data import TrainingData
from surrogate.training.loop import StageRun
from surrogate.training.session import TrainingSession
from surrogate.training.source import Source
from surrogate.training.stages import Stage, canonical_stage, simulation_stage
from surrogate.training.state import TrainingState
from surrogate.training.visualizations import in_common, new_visualization, visualization_stage

COMPRESSION = "compression"


@dataclass(frozen=True)
class Optimize:
    """Optimize a stage up to its step `until`; the stages before it have `before` steps.

    `stage` makes the stage of a state's tensors, and `data` loads the images.
    """

    stage: Callable[[TrainingState], Stage]
    data: Callable[[], TrainingData]
    before: int
    until: int

    def __call__(self, state: TrainingState, session: TrainingSession) -> TrainingState:
        state = state.copy()
        run = StageRun(self.stage(state), session.settings, self.data(), state.loop)
        losses, curve, interval = list(state.losses), list(state.curve), session.settings.validation_interval

        def now() -> TrainingState:
            return replace(state, loop=run.memory(), losses=tuple(losses), curve=tuple(curve))

        while run.step < self.until:
            losses.append(run.advance(session.pause_is_due))
            done, name = self.before + run.step, run.stage.name
            if run.step == run.stage.steps or (interval and run.step % interval == 0):
                mean, psnr = float(np.mean(losses)), run.validate()
                times = {"seconds": session.seconds, "processor_seconds": session.processor_seconds()}
                curve.append({"stage": name, "step": done, "loss": mean, "psnr": psnr, **times})
                losses.clear()
            if session.report_is_due:
                session.report(name, done, losses, curve)
            if run.pausing:
                run.require_finite()  # the checkpoint before stays
                session.save(now())
        return replace(now().copy(), loop=run.memory() if run.step < run.stage.steps else None)


@dataclass(frozen=True)
class Decide:
    """Make a choice about the model, after a checkpoint.

    `stage`, `step` and `steps` are shown as progress; `steps` None means those of all stages.
    """

    choose: Callable[[TrainingState], TrainingState]
    stage: str
    step: int
    steps: int | None = None

    def __call__(self, state: TrainingState, session: TrainingSession) -> TrainingState:
        session.report(self.stage, self.step, curve=state.curve, steps=self.steps)
        session.save(state)
        return self.choose(state)


Step = Optimize | Decide


def plan(source: Source, data: TrainingData, field: FieldModel | None = None) -> list[Step]:
    """All steps of a training, `data` being the images of the base appearance, and `field` what Gaussians may start from."""
    settings = source.settings
    evaluator = functools.cache(lambda: Evaluator(settings, replace(data, validation=source.decision_images())))

    def canonical(state: TrainingState) -> Stage:
        return state.slowed(canonical_stage(state.fitted.gaussians, settings))

    def simulation(state: TrainingState) -> Stage:
        return state.slowed(simulation_stage(*state.fitted, settings))

    def color_degree(state: TrainingState) -> TrainingState:
        degree, choice = choose_color_degree(state.fitted, evaluator())
        gaussians = state.fitted.gaussians.drawn().with_color_degree(degree)
        loop = None if state.loop is None else state.loop.with_color_columns(gaussians.colors.shape[1])
        return _decided(state, choice, fitted=state.fitted._replace(gaussians=gaussians), loop=loop)

    def decide(choose: Choose, state: TrainingState) -> TrainingState:
        fitted, choice = choose(state.fitted, evaluator())
        return _decided(state, choice, fitted=fitted)

    def precision(state: TrainingState) -> TrainingState:
        return _in_fewest_bits(state, source, data.background, evaluator())

    before, steps = settings.canonical_steps, list[Step]()
    steps.append(Optimize(canonical, lambda: data, 0, settings.canonical_steps))
    if settings.color_degree == "auto" and data.validation and source.field is None:
        first = round(ASKED_AFTER * settings.deformation_steps)
        steps.append(Optimize(simulation, lambda: data, before, first))
        steps.append(Decide(color_degree, NAME, before + first))
    steps.append(Optimize(simulation, lambda: data, before, settings.deformation_steps))
    choosers = choices(bool(source.variations)) if settings.fit_to_need and data.validation else ()
    for i, choose in enumerate(choosers):
        steps.append(Decide(functools.partial(decide, choose), COMPRESSION, i, len(choosers) + 1))
    images = functools.lru_cache(maxsize=1)(lambda number: source.data(source.variations[number]))
    for number in range(len(source.variations)):
        before = settings.canonical_steps + settings.deformation_steps + number * settings.visualization_steps
        steps += _of_variation(source, number, field, data, functools.partial(images, number), before)
    if choosers:
        steps.append(Decide(precision, COMPRESSION, len(choosers), len(choosers) + 1))
    return steps


def _of_variation(
    source: Source,
    number: int,
    field: FieldModel | None,
    base: TrainingData,
    images: Callable[[], TrainingData],
    before: int,
) -> list[Step]:
    """Stage 3 for one variation of the appearance, of which `base` are the images without it."""
    settings, variation = source.settings, source.variations[number]
    surfaces = functools.cache(lambda: source.emulated_surfaces(field, variation))

    def color_degree(state: TrainingState) -> TrainingState:
        if number < len(state.visualizations):  # where training goes on from a finished model
            return state
        evaluator = Evaluator(settings, replace(images(), validation=source.decision_images(variation)))
        degree, choice = choose_visualized_color_degree(state.fitted, variation, source, evaluator)
        visualization = new_visualization(*state.fitted, variation, source, degree, surfaces())
        if surfaces() is None:
            visualization = in_common(visualization, settings, images())
        return _decided(state, choice, visualizations=(*state.visualizations, visualization))

    def stage(state: TrainingState) -> Stage:
        begun = surfaces() is not None and not state.steps_before
        return state.slowed(visualization_stage(*state.fitted, state.visualizations[number], settings, begun=begun))

    def learnt() -> TrainingData:
        refined = source.field is not None and variation.edits_base  # the base's Gaussians, which are to stay as good
        return images().with_base(base, len(variation.space)) if refined else images()

    return [
        Decide(color_degree, VARIED_NAME, before),
        Optimize(stage, learnt, before, settings.visualization_steps),
    ]


def _in_fewest_bits(
    state: TrainingState, source: Source, background: tuple[float, float, float] | None, evaluator: Evaluator
) -> TrainingState:
    """The model as it will be read again, in main memory."""
    state = state.to(torch.device("cpu"))
    fitted, encodings, choice = choose_precision(state.fitted, evaluator)
    decisions, visualizations = [choice], list(state.visualizations)
    for i, visualization in enumerate(visualizations):
        images = source.decision_images(visualization.variation) if visualization.tensors() else []
        if images:
            evaluator = Evaluator(source.settings, TrainingData([], images, background, ranks=source.ranks))
            visualizations[i], own, choice = precision_of_visualization(visualization, fitted, evaluator)
            encodings |= {f"visualization{i}.{name}": encoding for name, encoding in own.items()}
            decisions.append(choice)
    return _decided(state, *decisions, fitted=fitted, visualizations=tuple(visualizations), encodings=encodings)


def _decided(state: TrainingState, *choices: Choice | None, **changes: Any) -> TrainingState:
    """The state after `choices`, None where nothing was asked, with the `changes` that they led to."""
    return replace(
        state, choices=(*state.choices, *(asdict(choice) for choice in choices if choice is not None)), **changes
    )
