"""Step times of a variant on this machine, and the number of steps that fit into a time."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import NamedTuple

from catalogs.store.catalog import Catalog
from surrogate.appearance.field_gaussians import AnyGaussians
from surrogate.settings import TrainingSettings
from surrogate.splatting.cuda import chosen_device
from surrogate.splatting.threads import one_torch_thread
from surrogate.training.data import TrainingData, load_examples, training_rows
from surrogate.training.loop import StageRun
from surrogate.training.source import Source
from surrogate.training.stages import canonical_stage, new_deformation, simulation_stage

IMAGES = 96  # training images of the probe, from which the time to load all is estimated
WARM_STEPS, FEWEST_TIMED = 2, 3
ROUGHLY = 0.15  # fraction of the probe for a first estimate of its number of steps
SETTLED = 0.5  # fraction of a stage's steps that is not timed
FEWEST_STEPS = 4
STAGES = ("canonical_steps", "deformation_steps", "visualization_steps")  # settings of `steps_of`


def clock(settings: TrainingSettings) -> Callable[[], float]:
    """Seconds since some moment: of all cores together on a CPU, and on the wall where a GPU computes.

    Two cores that compute for a minute count as two, so a study is best given one core (`taskset`, or a batch system's
    affinity). It then takes the stated time, and as many studies as there are cores can run side by side.
    """
    return time.process_time if chosen_device(settings.device).type == "cpu" else time.perf_counter


class StepTimes(NamedTuple):
    """Seconds before the first step, and per step of each stage; 0 for a stage without steps."""

    start: float
    canonical: float = 0.0
    deformation: float = 0.0
    visualization: float = 0.0

    def seconds(self, settings: TrainingSettings) -> float:
        """Expected seconds of all stages of `settings`."""
        return self.start + sum(steps * seconds for steps, seconds in zip(steps_of(settings), self[1:], strict=True))


def steps_of(settings: TrainingSettings) -> tuple[int, int, int]:
    """Numbers of steps of the three stages."""
    return settings.canonical_steps, settings.deformation_steps, settings.visualization_steps


@one_torch_thread()
def measure_step_times(settings: TrainingSettings, catalog: Catalog, seconds: float) -> StepTimes:
    """The step times of `settings`, measured in a training of about `seconds` that goes through all stages.

    The first steps of a stage are not representative: steps get slower or faster as Gaussians grow, fade and are
    relocated. From a random start they take twice as long in the end.
    """
    source, now = Source(settings, catalog), clock(settings)
    data, loading = _some_data(source)
    begun = now()
    gaussians = source.initial_gaussians(data)
    start = loading + now() - begun

    def trained(form: TrainingSettings, timed: Callable[[StageRun], float]) -> StepTimes:
        return StepTimes(start, *_timed(form, gaussians, data, timed))

    return settled(settings, seconds, trained, ROUGHLY * seconds / 2.0)


def settled(
    settings: TrainingSettings,
    seconds: float,
    trained: Callable[[TrainingSettings, Callable[[StageRun], float]], StepTimes],
    first: float,
) -> StepTimes:
    """Step times of `settings`, measured in the second half of each stage of a training of about `seconds`.

    `trained` goes through the stages of some settings and times each by a given function. The length of such a training
    is estimated from the first `first` seconds of each stage.
    """
    roughly = trained(settings, lambda run: _first_steps(run, first))
    short = scheduled(settings, (1.0 - ROUGHLY) * seconds, roughly._replace(start=0.0))
    return trained(short, _last_steps)


def scheduled(settings: TrainingSettings, seconds: float, times: StepTimes) -> TrainingSettings:
    """`settings` with as many steps as fit into `seconds`, divided between the stages as before.

    Raises ValueError where the time ends before the first step.
    """
    if times.start >= seconds:
        raise ValueError(
            f"it takes {round(times.start, 1):g} s before the first step, and the budget is {seconds:g} s: --seconds allows more"
        )
    before = steps_of(settings)
    per_step = (times.seconds(settings) - times.start) / sum(before)
    return with_steps(settings, round((seconds - times.start) / per_step))


def with_steps(settings: TrainingSettings, steps: int) -> TrainingSettings:
    """`settings` with `steps` steps, divided between the stages as before; no stage loses all its steps."""
    before, total = steps_of(settings), max(steps, FEWEST_STEPS)
    shares = [max(round(part * total / sum(before)), 1) if part else 0 for part in before]
    shares[before.index(max(before))] += total - sum(shares)
    return settings.changed(**dict(zip(STAGES, shares, strict=True)))


def _some_data(source: Source) -> tuple[TrainingData, float]:
    """Some training images, evenly spread, and the estimated time to load all."""
    rows = training_rows(source.catalog, [source.appearance])
    some = rows[:: -(-len(rows) // IMAGES)]
    load_examples(source.catalog, some[:2], source.normalization)  # pays the cost of the first image
    now = clock(source.settings)
    begun = now()
    examples = load_examples(source.catalog, some, source.normalization)
    seconds = (now() - begun) * len(rows) / len(some)
    return TrainingData(examples, (), source.catalog.plan.background, source.values), seconds


def _timed(
    settings: TrainingSettings, gaussians: AnyGaussians, data: TrainingData, timed: Callable[[StageRun], float]
) -> tuple[float, float]:
    """Seconds per step in each stage, one after the other from a copy of `gaussians`; 0 for a missing stage."""
    device, canonical, deformation = chosen_device(settings.device), 0.0, 0.0
    gaussians = gaussians.copy().to(device)
    if settings.canonical_steps:
        canonical = timed(StageRun(canonical_stage(gaussians, settings), settings, data))
    if settings.deformation_steps:
        gaussians, parameters = gaussians.copy(), len(data.examples[0].parameters)
        moving = new_deformation(gaussians, parameters, settings).to(device)
        deformation = timed(StageRun(simulation_stage(gaussians, moving, settings), settings, data))
    return canonical, deformation


def _first_steps(run: StageRun, seconds: float) -> float:
    """Seconds per step over the first steps."""
    for _ in range(WARM_STEPS):
        run.advance()
    now = clock(run.settings)
    begun, taken = now(), 0.0
    while run.step < WARM_STEPS + FEWEST_TIMED or taken < seconds:
        run.advance()
        taken = now() - begun
    return taken / (run.step - WARM_STEPS)


def _last_steps(run: StageRun) -> float:
    """Seconds per step in the settled part of a stage, taking all its steps."""
    first, now = int(SETTLED * run.stage.steps), clock(run.settings)
    while run.step < first:
        run.advance()
    begun = now()
    while run.step < run.stage.steps:
        run.advance()
    return (now() - begun) / (run.stage.steps - first)
