"""What a budget in minutes or steps leads to: how many Gaussians, trained for how many steps, on this machine.

The pictures say how many Gaussians are worth having, and the number of images how many steps they need for it.  The rules are
those that did best on validation images in equal time, on pictures of 64 to 256 pixels a side (`python -m benchmarks.budgets`):
where members look much alike, more Gaussians were worth more than more steps, so they grow with the time; where members differ
strongly, steps were; where little of a picture shows anything, few Gaussians were.
"""

from __future__ import annotations

import math
import statistics
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from catalogs.appearance import Appearance, VolumeRendering
from catalogs.catalog import Catalog
from surrogate.evaluation.metrics import WHITE
from surrogate.evaluation.scoring import spread
from surrogate.rasterizer import Rasterizer
from surrogate.settings import TrainingSettings
from surrogate.splatting.cuda import chosen_device
from surrogate.splatting.threads import one_torch_thread
from surrogate.training.content import changing_share, visible_pixels
from surrogate.training.data import ImageRow, TrainingData, load_examples, training_rows, validation_rows
from surrogate.training.loop import StageRun, mean_psnr
from surrogate.training.ranks import ALONE, Ranks
from surrogate.training.source import Source
from surrogate.training.stages import Stage, new_deformation, simulation_stage
from surrogate.training.state import Fitted
from surrogate.training.visualizations import new_visualization, visualization_stage

MINUTES = 10.0  # where nobody says
FEWEST_SECONDS = 15.0  # below which a budget in minutes is refused
STEP_KEYS = ("canonical_steps", "deformation_steps", "visualization_steps")

# How many Gaussians and steps
LARGEST, SMALLEST = 60_000, 1_000
PER_PIXEL = 44_000.0  # Gaussians squared: one for each pixel where 44,000 show something, two where 11,000 do
ALIKE = 1 / 3  # the `changing_share` up to which longer trainings are worth more Gaussians, not more steps alone
BALANCED = (
    2 / 3
)  # power of growth, as a step takes the longer, the more Gaussians there are, and they grow as the root of steps
FEWEST_STEPS = 20  # of a stage
ENOUGH_STEPS = 2_000, 20_000  # and within these two for each image: with fewer there are fewer Gaussians as well
FEWEST_GAUSSIANS = 0.25  # of those that the pictures are worth
USUAL_STEPS = 4_000  # of a stage, for which any ensemble is trained at the usual rates
CANONICAL_SHARE, MOST_CANONICAL = 0.06, 1_000  # of stages 1 and 2
MODES_OF_VALUES = 32  # carried values are also learnt without a stage of their own for the canonical Gaussians
VALIDATIONS, MOST_BETWEEN = 16, 1_000  # in a training, and steps between them at most

# What takes time beside the steps
COLOR_PROBES = 0.07  # of the steps of stages 1 and 2: the question whether colours depend on the direction
COMPRESSION = 0.18  # of the same steps: fine-tunings after each choice
PICTURES = 4_000  # drawn to make the choices of compression
LARGEST_SHARE = 0.2  # of the time that these pictures may take: else nothing is compressed
SPARE = 3.0  # seconds, to begin and to write down

Clock = Callable[[], float]  # seconds since something

# How the speed is measured
SAMPLED, LEAST_STEPS, MOST_STEPS, LEAST_SECONDS, LEAST_DRAWN = 64, 24, 2_000, 1.0, 8
# Of the time, and seconds at most, in which it is measured in the end: one second says little on a machine that others use too.
MEASURED_SHARE, MOST_MEASURED = 0.03, 20.0


@dataclass(frozen=True)
class Budget:
    """Minutes of time on this machine, or steps over all stages; neither where the settings say all."""

    minutes: float | None = None
    steps: int | None = None

    def __post_init__(self) -> None:
        if self.minutes is not None and self.steps is not None:
            raise ValueError("a budget is in minutes or in steps, not in both")
        if self.minutes is not None and not FEWEST_SECONDS <= 60.0 * self.minutes < math.inf:
            raise ValueError(f"--minutes must be a time, at least {FEWEST_SECONDS / 60.0:g}, got {self.minutes:g}")
        if self.steps is not None and self.steps < 1:
            raise ValueError(f"--steps must be at least 1, got {self.steps}")


@dataclass(frozen=True)
class Pace:
    """Seconds that a step takes in stage 2, and in stage 3 of each variation; that drawing and that loading an image take."""

    step: float
    varied: tuple[float, ...]
    draw: float
    load: float

    @property
    def mean_step(self) -> float:
        """Over all stages, which have equally many steps."""
        return statistics.fmean((self.step, *self.varied))


def budgeted(
    given: Mapping[str, Any],
    catalog: Catalog,
    budget: Budget,
    elapsed: Clock | None = None,
    ranks: Ranks = ALONE,
) -> tuple[TrainingSettings, dict[str, Any]]:
    """The settings that a budget and the keys that are `given` lead to, and what they were chosen from.

    `elapsed` says how many seconds of the budget's minutes are spent, on the clock that they are counted with: the wall's from now
    on, where there is none.  A budget in steps leads to the same settings on every machine.  Several processes, `ranks`, measure
    together and come to the same.

    Raises ValueError where keys are given that the budget decides on, or the time is too short.
    """
    settings = TrainingSettings(**given)
    source = Source(settings, catalog, ranks)
    if budget.minutes is None and budget.steps is None:
        return settings, {}
    decided = [key for key in STEP_KEYS if given.get(key)]
    if decided:
        raise ValueError(f"a budget decides on the steps of training: leave out {', '.join(decided)}, or the budget")
    if budget.steps is not None:
        rows = _rows(source)[0]
        chosen = _sized(given, source, _worth(source, rows), budget.steps)
        return chosen, {"gaussians": chosen.gaussians, "steps": budget.steps}
    return _in_time(given, source, 60.0 * float(budget.minutes or 0.0), elapsed or _since_now())


def _since_now() -> Clock:
    begun = time.perf_counter()
    return lambda: time.perf_counter() - begun


@dataclass(frozen=True)
class Worth:
    """What decides how many Gaussians pictures are worth.

    Attributes
    ----------
    visible : pixels of a picture that show something.
    images : that are learnt, of the base appearance.
    changing : the share of what is seen that changes from member to member.
    """

    visible: float
    images: int
    changing: float

    def gaussians(self, steps: float | None = None) -> int:
        """How many are worth having in so many steps of one image, in stages 1 and 2; without any, in just enough."""
        part = 1.0 if steps is None else steps / self.enough_steps
        more = part**0.5 if self.changing <= ALIKE else 1.0
        enough = min((PER_PIXEL * self.visible) ** 0.5, LARGEST)
        return _rounded(enough * (max(FEWEST_GAUSSIANS, part) if part < 1.0 else more))

    @property
    def enough_steps(self) -> int:
        """With fewer there are fewer Gaussians as well."""
        low, high = ENOUGH_STEPS
        return min(max(2 * self.images, low), high)


def _worth(source: Source, rows: Sequence[ImageRow]) -> Worth:
    return Worth(visible_pixels(source, rows), len(rows), changing_share(source, rows))


def _rounded(count: float) -> int:
    """To two digits, within what a training may have."""
    digits = 10 ** max(0, len(str(int(count))) - 2)
    return min(LARGEST, max(SMALLEST, round(count / digits) * digits))


def _sized(given: Mapping[str, Any], source: Source, worth: Worth, steps: int) -> TrainingSettings:
    """The given settings with so many steps over all stages, and with what follows from them where it is not given."""
    stages = 1 + len(source.variations)
    each = max(1, steps // stages)
    seen, moving = (
        each * source.settings.batch,
        each * math.sqrt(source.settings.batch),
    )  # images; steps at the usual rates
    joint = source.field is not None or given.get("canonical_steps") == 0
    canonical = 0 if joint else min(MOST_CANONICAL, round(CANONICAL_SHARE * each))
    follows = {
        **_design(source),
        "gaussians": worth.gaussians(seen),
        "validation_interval": min(MOST_BETWEEN, max(1, steps // VALIDATIONS)),
        **_calm_rates(moving),
    }
    lengths = {"canonical_steps": canonical, "deformation_steps": each - canonical}
    return TrainingSettings(**{**follows, **given, **lengths, **({"visualization_steps": each} if stages > 1 else {})})


def _in_time(
    given: Mapping[str, Any], source: Source, seconds: float, elapsed: Clock
) -> tuple[TrainingSettings, dict[str, Any]]:
    rows = _rows(source)
    images = sum(map(len, rows))
    choosing = source.settings.compression.enabled and bool(validation_rows(source.catalog, [source.appearance], 1))
    worth, is_first = _worth(source, rows[0]), True
    tried = TrainingSettings(**{"gaussians": worth.gaussians(), **_design(source), **given})
    lasting, longer = 0.0, min(MOST_MEASURED, MEASURED_SHARE * seconds) / len(rows)
    while True:
        slowest = Source(_slowest(tried, source.shown), source.catalog, source.ranks)
        pace = measure_pace(slowest, rows, elapsed, lasting)
        left = seconds - source.ranks.agreed(elapsed()) - SPARE - pace.load * images
        compressing = choosing and PICTURES * pace.draw <= LARGEST_SHARE * left
        overhead = COMPRESSION * compressing + COLOR_PROBES * (tried.color_degree == "auto")
        steps = int((left - PICTURES * pace.draw * compressing) / (pace.mean_step * (1.0 + overhead / len(rows))))
        if steps < FEWEST_STEPS * len(rows):
            raise ValueError(
                f"{seconds / 60.0:g} minutes are too short here: to load {images:,} images takes {pace.load * images:.0f} s, "
                f"and a step {1e3 * pace.mean_step:.0f} ms"
            )
        choices = given if compressing or not choosing else {"fit_to_need": False, **given}
        chosen = _sized(choices, source, worth, steps)
        more = chosen.gaussians / tried.gaussians
        settled = more == 1.0 or (more > 1.0 and not is_first)
        if lasting or (settled and longer <= LEAST_SECONDS):
            break
        if settled:
            lasting = longer
            continue
        # fewer Gaussians are faster; more leave fewer steps, and so fewer Gaussians are worth having than these steps ask for
        tried, is_first = chosen.changed(gaussians=_rounded(tried.gaussians * min(more, more**BALANCED))), False
    return chosen.changed(gaussians=tried.gaussians), {
        "gaussians": tried.gaussians,
        "steps": steps,
        "milliseconds_per_step": round(1e3 * pace.mean_step, 2),
        "images": images,
        "seconds_to_load": round(pace.load * images, 1),
        "compressed": compressing,
    }


def _slowest(settings: TrainingSettings, shown: Appearance) -> TrainingSettings:
    """With colours that depend on the direction, which take longer, where only training finds out whether they do.

    Foreign pictures of nyx took 354 of 300 seconds when steps were planned without.
    """
    unlit = isinstance(shown, VolumeRendering) and not shown.shaded
    return settings if settings.color_degree != "auto" or unlit else settings.changed(color_degree=1)


def _design(source: Source) -> dict[str, Any]:
    """Settings that follow from what Gaussians carry."""
    return {} if source.field is None else {"latent_size": MODES_OF_VALUES}


def _calm_rates(steps: float) -> dict[str, Any]:
    """Rates of F_sim for so many steps of a stage: the longer rates stay high, the lower they must be.

    An ensemble of strongly different members diverged at the usual ones in 33,288 steps; at 0.3 of them it was trained in 43,268.
    """
    rates, calm = TrainingSettings().rates, min(1.0, math.sqrt(USUAL_STEPS / steps))
    return {"latent_rate": calm * rates.latent, "embedding_rate": calm * rates.embedding}


def _rows(source: Source) -> list[list[ImageRow]]:
    """The training images of the base appearance, and of each variation."""
    shown = [[source.appearance], *([s.appearance for s in v.settings] for v in source.variations)]
    return [training_rows(source.catalog, names) for names in shown]


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
    gaussians = source.initial_gaussians(loaded[0])
    fitted = Fitted(gaussians, new_deformation(gaussians, len(source.catalog.plan.space), settings))
    fitted = fitted.to(chosen_device(settings.device))
    stages = [simulation_stage(*fitted.copy(), settings)]
    for variation in source.variations:
        stages.append(visualization_stage(*fitted, new_visualization(*fitted, variation, source), settings))
    step, *varied = (
        _seconds(stage, settings, data, clock, lasting) for stage, data in zip(stages, loaded, strict=True)
    )
    return source.ranks.agreed(Pace(step, tuple(varied), _seconds_to_draw(fitted, settings, loaded[0], clock), load))


def _seconds(stage: Stage, settings: TrainingSettings, data: TrainingData, clock: Clock, lasting: float) -> float:
    """Of a step: the median over at least a second and 24 steps, the first few, which are slower, aside."""
    least = max(LEAST_SECONDS, lasting)
    run, taken = StageRun(replace(stage, steps=MOST_STEPS), settings, data), list[float]()
    while run.step < MOST_STEPS and data.ranks.agreed(len(taken) < LEAST_STEPS or sum(taken) < least):
        started = clock()
        run.advance()
        taken.append(clock() - started)
    return statistics.median(taken[LEAST_STEPS // 4 :])


def _seconds_to_draw(fitted: Fitted, settings: TrainingSettings, data: TrainingData, clock: Clock) -> float:
    """Of a picture that is judged, deformation included."""
    some, background = data.examples[:LEAST_DRAWN], data.background or WHITE
    started = clock()
    mean_psnr(fitted.at, some, Rasterizer.of(settings), background, data.ranks)
    return (clock() - started) / len(some)
