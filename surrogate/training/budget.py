"""Settings for a budget in minutes or steps: numbers of Gaussians and of steps.

The pictures decide how many Gaussians are worth having, and the number of images how many steps these need.  In minutes, the number
of Gaussians follows at a stated speed, so that a busy machine makes a model of the same size.  Steps follow at the measured speed.

The rules did best on validation images in equal time, on pictures of 64 to 256 pixels a side.  Where members looked much alike,
Gaussians were worth more than steps, so they grow with the time; where members differed strongly, steps were.  Where little of a
picture shows anything, few Gaussians were enough.

Pictures from 256 pixels on are downsampled in early steps, and in little time there are as many Gaussians as the small pictures are
worth.  Not where members look much alike: there it cost 1.2 dB (tgv-dvr, two minutes: 45.5 instead of 46.7).
"""

from __future__ import annotations

import math
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from catalogs.store.catalog import Catalog
from catalogs.vocabulary.appearance import Appearance, VolumeRendering
from native.threads import cores as available_cores
from surrogate.settings import TrainingSettings
from surrogate.splatting.cuda import chosen_device
from surrogate.training.content import changing_share, roughness, sampled, visible_pixels
from surrogate.training.data import ImageRow, training_rows, validation_rows
from surrogate.training.downsampling import fitting_factor, shares
from surrogate.training.emulator import lacking
from surrogate.training.other_functions import PIXELS
from surrogate.training.pace import Clock, Pace, measure_pace
from surrogate.training.ranks import ALONE, Ranks
from surrogate.training.reading import Reading, pixels
from surrogate.training.source import Source

MINUTES = 10.0  # where nobody says
FEWEST_SECONDS = 15.0  # below which a budget in minutes is refused
STEP_KEYS = ("canonical_steps", "deformation_steps", "visualization_steps")

# How many Gaussians and steps
LARGEST, SMALLEST = 60_000, 1_000
PER_PIXEL = 44_000.0  # Gaussians squared: one for each pixel where 44,000 show something, two where 11,000 do
ALIKE = 1 / 3  # the `changing_share` up to which longer trainings are worth more Gaussians, not more steps alone
FEWEST_STEPS = 20  # of a stage
ENOUGH_STEPS = 2_000, 20_000  # and within these two for each image: with fewer there are fewer Gaussians as well
FEWEST_GAUSSIANS = 0.25  # of those that the pictures are worth
GAUSSIANS_PER_STEP = 3.0  # at most, beyond those that downsampled pictures are worth
USUAL_STEPS = 4_000  # of a stage, for which any ensemble is trained at the usual rates
CANONICAL_SHARE, MOST_CANONICAL = 0.06, 1_000  # of stages 1 and 2
ROUGH = 0.05  # of a picture: from there on carried colours are worth several samples a pixel
MODES_OF_VALUES = 32  # carried values are also learnt without a stage of their own for the canonical Gaussians
VALIDATIONS, MOST_BETWEEN = 16, 1_000  # in a training, and steps between them at most
FEWEST_VALIDATIONS, VALIDATED_SHARE = 4, 0.05  # where 16 would take more of the time than this

# The stated speed, from which the number of Gaussians follows: a step's seconds on one core of an AMD EPYC, of which all but the
# first are shared by the cores; steps have a share of the time.  (1,000 to 60,000 Gaussians, images of 64 to 256 pixels a side.)
SECONDS_PER_STEP, SECONDS_PER_GAUSSIAN, SECONDS_PER_PIXEL = 1.8e-3, 3.8e-7, 4.5e-8
STATED_SHARE = 0.75
GPU_CORES = 32  # that a GPU counts as

# What takes time beside the steps
COLOR_PROBES = 0.07  # of the steps of stages 1 and 2: the question whether colours depend on the direction
COMPRESSION = 0.18  # of the same steps: fine-tunings after each choice
PICTURES = 4_000  # drawn to make the choices of compression
LARGEST_SHARE = 0.2  # of the time that these pictures may take: else nothing is compressed
SPARE = 3.0  # seconds, to begin and to write down
# Pictures of the field alone before training, and of Gaussians and field and of test members after it, and a core's time.
COMPARED, SECONDS_PER_COMPARED_PIXEL = 280, 3e-7
SECONDS_PER_VALUE = 6e-7  # of members' fields, to emulate them twice, the second time with validation members
LENIENCE = 1.25  # for machines that are slower the next time

# Of the time, and seconds at most, in which the speed is measured: one second says little where others use the machine.
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


def budgeted(
    table: Mapping[str, Any],
    catalog: Catalog,
    budget: Budget,
    elapsed: Clock | None = None,
    ranks: Ranks = ALONE,
) -> tuple[TrainingSettings, dict[str, Any]]:
    """The settings that a budget and the keys of a `table` lead to, and what they were chosen from.

    `elapsed` says how many seconds of the budget's minutes are spent, on the clock that they are counted with: the wall's from now
    on, where there is none.  A budget in steps leads to the same settings on every machine.  Several processes, `ranks`, measure
    together and come to the same.

    Raises ValueError where keys are given that the budget decides on, or the time is too short.
    """
    settings = TrainingSettings.from_table(table)
    source = Source(settings, catalog, ranks)
    if budget.minutes is None and budget.steps is None:
        return settings, {}
    decided = [key for key in STEP_KEYS if table.get(key)]
    if decided:
        raise ValueError(f"a budget decides on the steps of training: leave out {', '.join(decided)}, or the budget")
    if budget.steps is not None:
        rows = _rows(source)[0]
        chosen = _sized(table, source, _worth(source, rows), budget.steps)
        return chosen, {"gaussians": chosen.gaussians, "steps": budget.steps}
    return _in_time(table, source, 60.0 * float(budget.minutes or 0.0), elapsed or _since_now())


def _since_now() -> Clock:
    begun = time.perf_counter()
    return lambda: time.perf_counter() - begun


@dataclass(frozen=True)
class Worth:
    """The properties of pictures that decide how many Gaussians and samples a pixel they are worth.

    Attributes
    ----------
    visible : pixels of a picture that show something.
    images : that are learnt, of the base appearance.
    changing : the share of what is seen that changes from member to member.
    rough : how much of a picture is as fine as its pixels, where Gaussians carry colours.
    downsampling : of early steps.
    """

    visible: float
    images: int
    changing: float
    rough: float = 0.0
    downsampling: int = 1

    def gaussians(self, steps: float | None = None) -> int:
        """The number worth having for `steps` of one image in stages 1 and 2; without any, for just enough."""
        part = 1.0 if steps is None else steps / self.enough_steps
        more = part**0.5 if self.changing <= ALIKE else 1.0
        enough = (PER_PIXEL * self.visible) ** 0.5
        count = min(enough, LARGEST) * (max(FEWEST_GAUSSIANS, part) if part < 1.0 else more)
        if steps is not None and self.downsampling > 1:
            count = min(count, max(enough / self.downsampling, GAUSSIANS_PER_STEP * steps))
        return _rounded(count)

    @property
    def samples(self) -> int:
        """Along the side of a pixel."""
        return 2 if self.rough > ROUGH else 1

    @property
    def enough_steps(self) -> int:
        """With fewer there are fewer Gaussians as well."""
        low, high = ENOUGH_STEPS
        return min(max(2 * self.images, low), high)


def _worth(source: Source, rows: Sequence[ImageRow]) -> Worth:
    some, factor = sampled(source, rows), fitting_factor(row.member.cameras[row.view] for row in rows)
    rough, changing = roughness(some) if source.field is None else 0.0, changing_share(source, rows, factor)
    return Worth(visible_pixels(source, some), len(rows), changing, rough, factor if changing > ALIKE else 1)


def _rounded(count: float) -> int:
    """To two digits, within what a training may have."""
    digits = 10 ** max(0, len(str(int(count))) - 2)
    return min(LARGEST, max(SMALLEST, round(count / digits) * digits))


def _sized(
    table: Mapping[str, Any], source: Source, worth: Worth, steps: int, validations: int = VALIDATIONS
) -> TrainingSettings:
    """The given settings with `steps` over all stages, and with those that follow where they are not given."""
    stages = 1 + len(source.variations)
    each = max(1, steps // stages)
    visible, moving = (
        each * source.settings.batch,
        each * math.sqrt(source.settings.batch),
    )  # images; steps at the usual rates
    joint = source.field is not None or table.get("canonical_steps") == 0
    canonical = 0 if joint else min(MOST_CANONICAL, round(CANONICAL_SHARE * each))
    follows = {
        **_design(source, worth),
        "gaussians": worth.gaussians(visible),
        "validation_interval": min(MOST_BETWEEN, max(1, steps // validations)),
        **_calm_rates(moving),
    }
    lengths = {"canonical_steps": canonical, "deformation_steps": each - canonical}
    of_variations = {"visualization_steps": each} if stages > 1 else {}
    return TrainingSettings.from_table({**follows, **table, **lengths, **of_variations})


def _in_time(
    table: Mapping[str, Any], source: Source, seconds: float, elapsed: Clock
) -> tuple[TrainingSettings, dict[str, Any]]:
    rows = _rows(source)
    worth = _worth(source, rows[0])
    stated = source.ranks.agreed(_stated_size(source, rows[0], worth, seconds / len(rows)))
    table = {"gaussians": stated, **table}
    tried = TrainingSettings.from_table({**_design(source, worth), **table})
    slowest = Source(_slowest(tried, source.target), source.catalog, source.ranks)
    pace = measure_pace(slowest, rows, elapsed, min(MOST_MEASURED, MEASURED_SHARE * seconds) / len(rows))
    reading = Reading.of(source.catalog, rows, tried.early_downsampling, pace.load)
    judging = source.ranks.by_first(lambda: _Judging.of(tried, source, seconds, pace))
    spent = source.ranks.agreed(elapsed())
    aside = pace.begin + judging.seconds
    left = seconds - spent - SPARE - reading.before - aside
    choosing = tried.fit_to_need and judging.images > 0
    compressing = choosing and PICTURES * pace.draw <= LARGEST_SHARE * left
    overhead = COMPRESSION * compressing + COLOR_PROBES * (tried.color_degree == "auto")
    steps, step = reading.steps(left - PICTURES * pace.draw * compressing, pace.mean_step, 1.0 + overhead / len(rows))
    if steps < FEWEST_STEPS * len(rows):
        raise ValueError(_too_short(seconds, spent, aside, reading, len(rows), pace))
    choices = table if compressing or not choosing else {"fit_to_need": False, **table}
    return _sized(choices, source, worth, steps, judging.validations), {
        "gaussians": tried.gaussians,
        "steps": steps,
        "milliseconds_per_step": round(1e3 * step, 2),
        "images": reading.images,
        "seconds_to_load": round(reading.before, 1),
        "compressed": compressing,
    }


@dataclass(frozen=True)
class _Judging:
    """The images that judge a training, and their time beside the steps.

    Attributes
    ----------
    images, validations : numbers of images for validation, and of times that they are drawn in a training.
    seconds : of these, of emulating the fields, and of the pictures that are compared before and after training.
    """

    images: int
    validations: int
    seconds: float

    @classmethod
    def of(cls, settings: TrainingSettings, source: Source, seconds: float, pace: Pace) -> _Judging:
        """For a training of some `seconds`."""
        rows = validation_rows(source.catalog, [source.appearance], settings.validation_images)
        if not rows:
            return cls(0, VALIDATIONS, 0.0)
        each = len(rows) * pace.draw
        number = int(min(VALIDATIONS, max(FEWEST_VALIDATIONS, VALIDATED_SHARE * seconds / max(each, 1e-9))))
        return cls(len(rows), number, number * each + _seconds_of_field(source, pixels(rows)))


def _seconds_of_field(source: Source, size: int) -> float:
    """To emulate the coarse fields, where that can be done, and compare them with Gaussians in pictures of `size` pixels."""
    if lacking(source):
        return 0.0
    members = [member for member in source.catalog.members if member.coarse_names()]
    values = sum(field.values.size for field in members[0].coarse_fields().values()) * len(members)
    drawing = COMPARED * min(size, PIXELS) * SECONDS_PER_COMPARED_PIXEL / available_cores()
    return drawing + values * SECONDS_PER_VALUE


def _stated_size(source: Source, rows: Sequence[ImageRow], worth: Worth, seconds: float) -> int:
    """The most Gaussians that are worth their steps in a stage of these `seconds` at the stated speed, whatever else runs here."""
    cores = GPU_CORES if chosen_device(source.settings.device).type == "cuda" else available_cores()
    learnt = pixels(rows) * sum(share / factor**2 for factor, share in shares(worth.downsampling))

    def is_worth(count: int) -> bool:
        of_image = SECONDS_PER_STEP + (count * SECONDS_PER_GAUSSIAN + learnt * SECONDS_PER_PIXEL) / cores
        return worth.gaussians(STATED_SHARE * seconds * source.ranks.count / of_image) >= count

    sizes = sorted({_rounded(count) for count in range(SMALLEST, LARGEST + 1, 100)})
    return max(filter(is_worth, sizes), default=SMALLEST)


def _too_short(seconds: float, spent: float, aside: float, reading: Reading, stages: int, pace: Pace) -> str:
    """The sentence on minutes that don't suffice: what takes the time, and the least that would."""
    load, training = reading.before, FEWEST_STEPS * stages * pace.mean_step
    overhead = (1.0 + COMPRESSION + COLOR_PROBES) / (1.0 - LARGEST_SHARE)
    least = LENIENCE * (spent + SPARE + load + aside + overhead * training) / 60.0
    return (
        f"{seconds / 60.0:g} minutes are too short here: starting up and measuring this machine's speed took {spent:.0f} s, "
        f"loading {reading.in_memory:,} images takes {load:.0f} s, the fewest {FEWEST_STEPS * stages} steps {training:.0f} s, "
        f"the start and validation {aside:.0f} s, and writing {SPARE:.0f} s: "
        f"--minutes {math.ceil(10.0 * least) / 10.0:g} suffices, or give --steps instead"
    )


def _slowest(settings: TrainingSettings, appearance: Appearance) -> TrainingSettings:
    """With colours that depend on the direction, which take longer, where only training finds out whether they do.

    Foreign pictures of nyx took 354 of 300 seconds when steps were planned without.
    """
    unlit = isinstance(appearance, VolumeRendering) and not appearance.shaded
    return settings if settings.color_degree != "auto" or unlit else settings.changed(color_degree=1)


def _design(source: Source, worth: Worth) -> dict[str, Any]:
    """Settings that follow from what Gaussians carry, and from what pictures show.

    On rough pictures several samples a pixel help carried colours (nyx at 128 pixels, five minutes: 33.1 dB instead of 32.4).  They
    harm carried values (tgv-tf: 38.8 instead of 41.8).
    """
    carried = {"samples": worth.samples} if source.field is None else {"latent_size": MODES_OF_VALUES}
    return {**carried, "early_downsampling": worth.downsampling}


def _calm_rates(steps: float) -> dict[str, Any]:
    """Rates of the simulation deformation for a stage of `steps`: the longer rates stay high, the lower they must be.

    An ensemble of strongly different members diverged at the usual ones in 33,288 steps; at 0.3 of them it was trained in 43,268.
    """
    usual, calm = TrainingSettings(), min(1.0, math.sqrt(USUAL_STEPS / steps))
    return {"latent_rate": calm * usual.latent_rate, "embedding_rate": calm * usual.embedding_rate}


def _rows(source: Source) -> list[list[ImageRow]]:
    """The training images of the base appearance, and of each variation."""
    names_by_stage = [[source.appearance], *([s.appearance for s in v.settings] for v in source.variations)]
    return [training_rows(source.catalog, names) for names in names_by_stage]
