"""The speed of training on this machine with a scene's pictures, measured in a few steps of each stage."""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

from surrogate.evaluation.metrics import WHITE
from surrogate.evaluation.scoring import spread
from surrogate.rasterizer import Rasterizer
from surrogate.settings import TrainingSettings
from surrogate.splatting.cuda import chosen_device
from surrogate.splatting.threads import one_torch_thread
from surrogate.training.data import ImageRow, TrainingData, load_examples
from surrogate.training.downsampling import shares
from surrogate.training.loop import StageRun, mean_psnr
from surrogate.training.source import Source
from surrogate.training.stages import Stage, new_deformation, simulation_stage
from surrogate.training.state import FittedGaussians
from surrogate.training.value_loss import INTERVAL
from surrogate.training.visualizations import new_visualization, visualization_stage

SAMPLED, LEAST_STEPS, MOST_STEPS, LEAST_SECONDS, LEAST_DRAWN = 64, 24, 2_000, 1.0, 8

Clock = Callable[[], float]  # seconds since something


@dataclass(frozen=True)
class Pace:
    """Seconds on this machine.

    Attributes
    ----------
    step, varied : of a step in stage 2, and in stage 3 of each variation: the mean over a stage.
    draw, load : of drawing, and of loading an image.
    begin : of making the Gaussians that training begins with.
    """

    step: float
    varied: tuple[float, ...]
    draw: float
    load: float
    begin: float = 0.0

    @property
    def mean_step(self) -> float:
        """Over all stages, which have equally many steps."""
        return statistics.fmean((self.step, *self.varied))


@one_torch_thread()
def measure_pace(
    source: Source, rows: Sequence[Sequence[ImageRow]], clock: Clock = time.perf_counter, lasting: float = 0.0
) -> Pace:
    """Train a little on some of the `rows` of each stage, for `lasting` seconds at least, and say how long it took on a clock."""
    settings, loaded, seconds = source.settings, list[TrainingData](), 0.0
    for variation, of in zip((None, *source.variations), rows, strict=True):
        few = [of[i] for i in spread(len(of), SAMPLED)]
        load_examples(source.catalog, few[:1], source.normalization, variation)  # what only the first one takes
        started = clock()
        examples = load_examples(source.catalog, few, source.normalization, variation)
        seconds += clock() - started
        loaded.append(TrainingData(examples, (), source.catalog.plan.background, source.values, source.ranks))
    load = seconds / sum(len(data.examples) for data in loaded)
    started = clock()
    gaussians = source.initial_gaussians(loaded[0])
    begin = clock() - started
    fitted = FittedGaussians(gaussians, new_deformation(gaussians, len(source.catalog.plan.space), settings))
    fitted = fitted.to(chosen_device(settings.device))
    stages = [simulation_stage(*fitted.copy(), settings)]
    for variation in source.variations:
        stages.append(visualization_stage(*fitted, new_visualization(*fitted, variation, source), settings))
    step, *varied = (
        _seconds(stage, settings, data, clock, lasting) for stage, data in zip(stages, loaded, strict=True)
    )
    draw = _seconds_to_draw(fitted, settings, loaded[0], clock)
    return source.ranks.agreed(Pace(step, tuple(varied), draw, load, begin))


def _seconds(stage: Stage, settings: TrainingSettings, data: TrainingData, clock: Clock, lasting: float) -> float:
    """Of a step: the mean over a stage, whose images are downsampled less and less."""
    parts = shares(settings.early_downsampling)
    some = (settings.changed(early_downsampling=factor) for factor, _ in parts)
    seconds = [_median_seconds(stage, each, data, clock, lasting / len(parts)) for each in some]
    return sum(share * each for (_, share), each in zip(parts, seconds, strict=True))


def _median_seconds(
    stage: Stage, settings: TrainingSettings, data: TrainingData, clock: Clock, lasting: float
) -> float:
    """Of an early step: the median over at least a second and 24 steps, the first few, which are slower, aside.

    It is that of the means of `INTERVAL` steps, one of which learns from the values of fields as well.
    """
    least = max(LEAST_SECONDS, lasting)
    # Twice as many steps, of which all that are made come before the cooldown, where images have one size.
    run, durations = StageRun(replace(stage, steps=2 * MOST_STEPS), settings, data), list[float]()
    while run.step < MOST_STEPS and data.ranks.agreed(len(durations) < LEAST_STEPS or sum(durations) < least):
        started = clock()
        run.advance()
        durations.append(clock() - started)
    later = durations[LEAST_STEPS // 3 :]
    return statistics.median(
        statistics.fmean(later[i : i + INTERVAL]) for i in range(0, len(later) - INTERVAL + 1, INTERVAL)
    )


def _seconds_to_draw(fitted: FittedGaussians, settings: TrainingSettings, data: TrainingData, clock: Clock) -> float:
    """Of a picture that is judged, deformation included."""
    some, background = data.examples[:LEAST_DRAWN], data.background or WHITE
    started = clock()
    mean_psnr(fitted.at, some, Rasterizer.of(settings), background, data.ranks)
    return (clock() - started) / len(some)
