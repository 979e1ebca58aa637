"""The time and the bytes of an ensemble, extrapolated from few images of some of its members."""

from __future__ import annotations

import resource
import tempfile
import time as clock
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import pairwise
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from catalogs.store.sizes import Sizes, size
from catalogs.vocabulary.appearance import TransferFunction, VolumeRendering
from catalogs.vocabulary.parameters import Parameter, ParameterSpace
from catalogs.vocabulary.scene import Scene, ViewPlan
from catalogs.vocabulary.words import plural
from insitu.ensembles.sources import ensemble_of
from insitu.fields.field import Field
from insitu.hook.session import Session
from insitu.members.planning import PlanOptions
from insitu.members.result import RenderedMember

TRIED = 5  # members, spread over the scene
# A function that makes a field, the field's parameters, and the names of its appearances, None for all.
Trial: TypeAlias = tuple[Callable[[], Any], Mapping[str, float], Sequence[str] | None]
SHEETS = VolumeRendering(
    "dvr",
    TransferFunction(
        ((-1.0, 0.1, 0.2, 0.9), (0.0, 0.9, 0.9, 0.9), (1.0, 0.9, 0.1, 0.0)), ((-1.0, 0.7), (0.0, 0.0), (1.0, 0.7)), 0.2
    ),
)


@dataclass(frozen=True)
class Estimate:
    """Size of all members of an ensemble, and the processor seconds that they take.

    Attributes
    ----------
    members, images : their numbers.
    sizes : bytes of all images and coarse fields.
    field_seconds, image_seconds, other_seconds : to make or read all fields, to draw and store all images, and for the rest:
        checks, summaries, coarse fields.
    tried : from how many members this was estimated, and from how many views of each.
    first_seconds : of the first member alone, which chooses how finely rays are sampled.
    """

    members: int
    images: int
    sizes: Sizes
    field_seconds: float
    image_seconds: float
    tried: tuple[int, int]
    other_seconds: float = 0.0
    first_seconds: float = 0.0

    def on(self, cores: int) -> str:
        """The estimate in words, for a number of cores that share the members evenly."""
        count, views = self.tried
        parts = [seconds / self.members for seconds in (self.field_seconds, self.image_seconds, self.other_seconds)]
        total = self.members * sum(parts) + self.first_seconds
        each = size((self.sizes.images + self.sizes.fields) / self.members)
        together = f", {_duration(total / min(cores, self.members))} on {cores}" if cores > 1 else ""
        lines = [
            f"{plural(self.members, 'member')} with {plural(self.images, 'image')}, extrapolated from {views} views of {count}:",
            f"  {self.sizes}",
            f"  a member: {each}, {_duration(sum(parts))} of one core ({_duration(parts[0])} for its field, "
            f"{_duration(parts[1])} for images, {_duration(parts[2])} for the rest)",
            f"  all: {_duration(total)} on one core{together}; the first member takes {_duration(self.first_seconds)} of it to "
            "choose the steps of rays",
            *([f"  {self.sizes.advice}"] if self.sizes.advice else []),
        ]
        return "\n".join(lines)

    def __str__(self) -> str:
        return self.on(1)


def estimate(scene: Scene, *, progress: Callable[[float], None] = lambda fraction: None) -> Estimate:
    """Make the fields of five members, of one where they are simulated, and draw them from 12 views in a temporary folder.

    `progress` is called with the fraction of a field that is made.  Raises ValueError for a scene whose images were made
    elsewhere, and as `insitu.make_dataset` does.
    """
    scene.check_tables()
    if scene.source["kind"] in ("nerf", "catalog", "loop"):
        raise ValueError(f"scene {scene.path}: nothing of it is rendered here, so there is nothing to estimate")
    ensemble = ensemble_of(scene)
    members = scene.assigned(ensemble.members)
    count = min(len(members), 1 if ensemble.source.expensive else TRIED)
    chosen = [members[(2 * i + 1) * len(members) // (2 * count)] for i in range(count)]
    options = PlanOptions.of_scene(scene, ensemble.space)
    tried = ((partial(ensemble.source.field, m, progress), m.parameters, m.appearances) for m in chosen)
    counts = [len(scene.appearances if m.appearances is None else m.appearances) for m in members]
    return _extrapolated(tried, options, scene.render.nan, counts)


def estimate_of_waves(samples: int, pixels: int, frequency: int, members: int) -> Estimate:
    """Of members without a scene: fields of `samples`³ smooth waves, a volume rendering, square images of `pixels`."""
    views = ViewPlan(frequency=frequency, width=pixels, height=pixels)
    options = PlanOptions(ParameterSpace((Parameter("phase", 0.0, 10.0),)), (SHEETS,), views)
    spacing, origin = (2.0 / (samples - 1),) * 3, (-1.0, -1.0, -1.0)

    def field(phase: float) -> Field:
        return Field(waves(samples, phase), spacing, origin)

    tried = ((partial(field, phase), {"phase": phase}, None) for phase in (1.0, 2.0))
    expected = _extrapolated(tried, options, "refuse", [1] * members)
    return replace(expected, field_seconds=0.0)  # the simulation's own


def waves(samples: int, phase: float) -> NDArray[np.float32]:
    """A field [z, y, x] of sums of waves over a cube of side 2, fading outwards."""
    z, y, x = np.meshgrid(*[np.linspace(-1.0, 1.0, samples, dtype=np.float32)] * 3, indexing="ij")
    body = np.sin(6 * x + phase) * np.cos(5 * y) + np.sin(4 * z - phase) * np.cos(7 * x)
    field: NDArray[np.float32] = (body / 2 * np.exp(-2 * (x**2 + y**2 + z**2))).astype(np.float32)
    return field


def _extrapolated(tried: Iterable[Trial], options: PlanOptions, nan: str, counts: Sequence[int]) -> Estimate:
    """From few views of members that are `tried`, all of members with `counts` of appearances."""
    plan = options.views or ViewPlan()
    few = replace(options, views=replace(plan, frequency=1))
    making, drawing, rest, results, ends = 0.0, 0.0, list[float](), list[RenderedMember](), list[float]()
    with (
        tempfile.TemporaryDirectory() as folder,
        Session(
            Path(folder) / "pilot.cdb",
            **vars(few),
            nan=nan,
            warn=lambda note: None,
            progress=lambda images: ends.append(_processor_seconds()),
        ) as session,
    ):
        for make, parameters, appearances in tried:
            ends.clear()
            started = _processor_seconds()
            field = make()
            begun = _processor_seconds()
            result = session.render_member(field, parameters, appearances=appearances)
            seconds = _processor_seconds() - begun
            of_images = _seconds_of_images(ends, result.sizes.views)
            making, drawing = making + begun - started, drawing + of_images
            rest.append(seconds - of_images)
            results.append(result)
    views, of_these = len(plan.splits()), sum((result.sizes for result in results), Sizes(whole=True))
    images, few_images, share = (
        views * sum(counts),
        sum(result.images for result in results),
        len(counts) / len(results),
    )
    sizes = Sizes(round(images / few_images * of_these.images), round(share * of_these.fields), views, of_these.whole)
    other = sum(rest[1:]) / len(rest[1:]) if rest[1:] else 0.0  # of one member, the first counts below
    return Estimate(
        len(counts),
        images,
        sizes,
        share * making,
        images / few_images * drawing,
        (len(results), of_these.views),
        len(counts) * other,
        max(0.0, rest[0] - other),
    )


def _seconds_of_images(ends: Sequence[float], views: int) -> float:
    """Of all images, by the times at which they were stored; the first of each appearance, which prepares, counts as others do."""
    later = [end - before for n, (before, end) in enumerate(pairwise(ends), 1) if n % views]
    return sum(later) * len(ends) / len(later)


def _processor_seconds() -> float:
    """Of this process and of those that it has waited for."""
    children = resource.getrusage(resource.RUSAGE_CHILDREN)
    return clock.process_time() + children.ru_utime + children.ru_stime


def _duration(seconds: float) -> str:
    for length, name in ((86400.0, "days"), (3600.0, "hours"), (60.0, "minutes")):
        if seconds >= 1.5 * length:
            return f"{seconds / length:.3g} {name}"
    return f"{seconds:.2g} s"
