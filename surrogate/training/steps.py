"""The steps of training in their order: to optimize a stage, or to make a choice about the model.

Each step takes the state of training and returns the next one.  An interrupted stage goes on from the loop's memory; an interrupted
choice is made again.
"""

from __future__ import annotations

import functools
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import torch

from catalogs.variations import Variation
from surrogate.storage.encoding import Encoding
from surrogate.training.compression import Choice
from surrogate.training.compression.choices import Choose, choices
from surrogate.training.compression.color_degree import (
    ASKED_AFTER,
    NAME,
    NAME_OF_F_VIS,
    choose_color_degree,
    choose_visualized_color_degree,
)
from surrogate.training.compression.evaluator import Evaluator
from surrogate.training.compression.precision import choose_precision, precision_of_visualization
from surrogate.training.data import TrainingData
from surrogate.training.loop import StageRun
from surrogate.training.session import Session
from surrogate.training.source import Source
from surrogate.training.stages import Stage, canonical_stage, simulation_stage
from surrogate.training.state import TrainingState
from surrogate.training.visualizations import new_visualization, visualization_stage

NEEDS = "needs"


@dataclass(frozen=True)
class Optimize:
    """Optimize a stage up to its step `until`; the stages before it have `before` steps.

    `stage` makes the stage of a state's tensors, and `data` loads the images.
    """

    stage: Callable[[TrainingState], Stage]
    data: Callable[[], TrainingData]
    before: int
    until: int

    def __call__(self, state: TrainingState, session: Session) -> TrainingState:
        state = state.copy()
        run = StageRun(self.stage(state), session.settings, self.data(), state.loop)
        losses, curve, interval = list(state.losses), list(state.curve), session.settings.validation.interval

        def now() -> TrainingState:
            return replace(state, loop=run.memory(), losses=tuple(losses), curve=tuple(curve))

        while run.step < self.until:
            losses.append(run.advance())
            done, name = self.before + run.step, run.stage.name
            if run.step == run.stage.steps or (interval and run.step % interval == 0):
                mean, psnr = float(np.mean(losses)), run.validate()
                curve.append({"stage": name, "step": done, "loss": mean, "psnr": psnr, "seconds": session.seconds})
                losses.clear()
            if session.report_is_due:
                session.report(name, done, losses, curve, speed=True)
            if session.checkpoint_is_due:
                run.require_finite()  # the checkpoint before stays
                session.save(now())
        return replace(now().copy(), loop=run.memory() if run.step < run.stage.steps else None)


@dataclass(frozen=True)
class Decide:
    """Make a choice about the model, after a checkpoint.

    `stage`, `step` and `steps` are shown as progress; `steps` None means those of all stages.
    """

    choose: Callable[[TrainingState], tuple[TrainingState, Choice | None]]
    stage: str
    step: int
    steps: int | None = None

    def __call__(self, state: TrainingState, session: Session) -> TrainingState:
        session.report(self.stage, self.step, curve=state.curve, steps=self.steps)
        session.save(state)
        state, choice = self.choose(state)
        return state if choice is None else replace(state, choices=(*state.choices, choice.to_json()))


Step = Optimize | Decide


def plan(source: Source, data: TrainingData) -> list[Step]:
    """All steps of a training, `data` being the images of the base appearance."""
    settings, lengths = source.settings, source.settings.steps
    evaluator = functools.cache(lambda: Evaluator(settings, replace(data, validation=source.decision_images())))

    def canonical(state: TrainingState) -> Stage:
        return canonical_stage(state.fitted.gaussians, settings)

    def simulation(state: TrainingState) -> Stage:
        return simulation_stage(*state.fitted, settings)

    def color_degree(state: TrainingState) -> tuple[TrainingState, Choice]:
        degree, choice = choose_color_degree(state.fitted, evaluator())
        gaussians = state.fitted.gaussians.with_color_degree(degree)
        loop = None if state.loop is None else state.loop.with_color_columns(gaussians.colors.shape[1])
        return replace(state, fitted=state.fitted._replace(gaussians=gaussians), loop=loop), choice

    def deciding(choose: Choose) -> Callable[[TrainingState], tuple[TrainingState, Choice]]:
        def chosen(state: TrainingState) -> tuple[TrainingState, Choice]:
            fitted, choice = choose(state.fitted, evaluator())
            return replace(state, fitted=fitted), choice

        return chosen

    before, steps = lengths.canonical, list[Step]()
    steps.append(Optimize(canonical, lambda: data, 0, lengths.canonical))
    if settings.color_degree == "auto" and data.validation:
        first = round(ASKED_AFTER * lengths.deformation)
        steps.append(Optimize(simulation, lambda: data, before, first))
        steps.append(Decide(color_degree, NAME, before + first))
    steps.append(Optimize(simulation, lambda: data, before, lengths.deformation))
    if settings.compression.enabled and data.validation:
        made = choices(bool(source.variations))
        steps += [Decide(deciding(choose), NEEDS, i, len(made) + 1) for i, choose in enumerate(made)]
    images = functools.lru_cache(maxsize=1)(lambda number: source.data(source.variations[number]))
    for number, variation in enumerate(source.variations):
        before = lengths.canonical + lengths.deformation + number * lengths.visualization
        steps += _of_variation(source, variation, functools.partial(images, number), before)
    return steps


def _of_variation(source: Source, variation: Variation, images: Callable[[], TrainingData], before: int) -> list[Step]:
    """Stage 3 for one variation of the appearance."""
    settings = source.settings

    def color_degree(state: TrainingState) -> tuple[TrainingState, Choice | None]:
        evaluator = Evaluator(settings, replace(images(), validation=source.decision_images(variation)))
        degree, choice = choose_visualized_color_degree(state.fitted, variation, source, evaluator)
        visualization = new_visualization(*state.fitted, variation, source, degree)
        return replace(state, visualizations=(*state.visualizations, visualization)), choice

    def stage(state: TrainingState) -> Stage:
        return visualization_stage(*state.fitted, state.visualizations[-1], settings)

    return [
        Decide(color_degree, NAME_OF_F_VIS, before),
        Optimize(stage, images, before, settings.steps.visualization),
    ]


def in_fewest_bits(
    state: TrainingState, source: Source, data: TrainingData, session: Session
) -> tuple[TrainingState, dict[str, Encoding]]:
    """The last choices: the model as it will be read again, in main memory, and the encodings of its tensors by name."""
    state, encodings = state.to(torch.device("cpu")), dict[str, Encoding]()
    if not (source.settings.compression.enabled and data.validation):
        return state, encodings
    made = len(choices(bool(source.variations)))
    session.report(NEEDS, made, curve=state.curve, steps=made + 1)
    session.save(state)
    evaluator = Evaluator(source.settings, replace(data, validation=source.decision_images()))
    fitted, encodings, choice = choose_precision(state.fitted, evaluator)
    found, shown = [choice.to_json()], list(state.visualizations)
    for i, visualization in enumerate(shown):
        images = source.decision_images(visualization.variation)
        if images:
            evaluator = Evaluator(source.settings, TrainingData([], images, data.background))
            shown[i], own, choice = precision_of_visualization(visualization, fitted, evaluator)
            encodings |= {f"visualization{i}.{name}": encoding for name, encoding in own.items()}
            found.append(choice.to_json())
    return replace(state, fitted=fitted, visualizations=tuple(shown), choices=(*state.choices, *found)), encodings
