"""Sample distances: the largest one whose measured error meets a target."""

from __future__ import annotations

import math
import time
import warnings
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from catalogs.vocabulary import numbers
from catalogs.vocabulary.appearance import Appearance, Isosurface, TransferFunction, VolumeRendering
from catalogs.vocabulary.cameras import Camera, orbit
from render.grids import Grid, Triple
from render.steepness import mean_change, swept
from render.views import render_views

CANDIDATES = (1.5, 1.25, 1.0, 0.9, 0.8, 0.7, 0.6, 0.5, 0.4, 0.3, 0.25, 0.2, 0.15, 0.125, 0.1)  # in smallest spacings
REFERENCE = 1 / 24  # in smallest spacings: beyond 80 dB against the float64 ray-marcher on fields of this kind
MARGIN = 1.0  # dB kept in hand for views and members that were not measured
ANISOTROPIC = 2.0  # largest over smallest spacing beyond which samples stay within half the smallest
VIEWS = 4
TRIVIAL = (
    0.25  # of a swept field's change from sample to sample: a field with less says little of its transfer function
)
FINEST_SWEPT = 0.25  # smallest spacings: swept fields ask for no finer distance
HARDER = 1.5  # times the change of what was measured: such a field is measured again
CHECKED_VIEWS, CHECKED_PIXELS = 2, 96


class Drawable(Protocol):
    """A field whose pictures can be had, be it in one piece or in blocks."""

    @property
    def spacing(self) -> Triple:
        """Of its samples, world units, x, y, z."""

    def pictures(
        self, appearance: Appearance, cameras: Sequence[Camera], sample_distance: float | None, *, float_output: bool
    ) -> Iterable[NDArray[Any]]:
        """As `render_views` makes them."""

    def mean_change(self, transfer: TransferFunction) -> float:
        """See `render.steepness.mean_change`."""


@dataclass(frozen=True, eq=False)
class WholeField:
    """A field that lies in one grid; `backend` draws it (`render.backends`)."""

    grid: Grid
    backend: str = "auto"

    @property
    def spacing(self) -> Triple:
        """See `Drawable`."""
        return self.grid.spacing

    def pictures(
        self, appearance: Appearance, cameras: Sequence[Camera], sample_distance: float | None, *, float_output: bool
    ) -> Iterable[NDArray[Any]]:
        """See `Drawable`."""
        return render_views(
            self.grid,
            appearance,
            cameras,
            sample_distance=sample_distance,
            float_output=float_output,
            backend=self.backend,
        )

    def mean_change(self, transfer: TransferFunction) -> float:
        """See `Drawable`."""
        return mean_change(self.grid, transfer)


@dataclass(frozen=True)
class SampleDistance:
    """A sample distance (world units), the error measured at it and the time an image took.

    Attributes
    ----------
    distance : world units between samples along a ray.
    decibels : peak signal-to-noise ratio of the 8-bit pictures (premultiplied RGBA, peak 1, all pixels pooled)
        against pictures at 1/24 of the smallest spacing.
    milliseconds : wall-clock time per image while measuring, upload included.
    note : what the user should know: that it misses the target.
    change : how much the measured field changes from sample to sample as the transfer function shows it (`mean_change`).
    """

    distance: float
    decibels: float
    milliseconds: float
    note: str = ""
    change: float = 0.0


def choose_sample_distance(
    field: Grid | Drawable,
    appearance: VolumeRendering | Isosurface,
    cameras: Sequence[Camera],
    target_decibels: float = 50.0,
    *,
    warn: bool = True,
) -> SampleDistance:
    """The largest sample distance at which pictures of `field` come within `target_decibels` (+1 dB in hand).

    Renders up to four of `cameras`, spread over the sequence, at ever smaller distances until the target is met.
    On grids whose spacings differ by more than a factor of 2 it starts at half the smallest, because thin
    structures lose opacity when a step jumps over them.  Where none is enough it returns the finest,
    with a `note`, and gives it as a warning unless `warn` is false.  An isosurface has no samples along rays: its
    distance is the smallest spacing and its error is 0 (inf dB).

    Raises ValueError for no cameras or a target that 8 bits cannot hold (above 58 dB).
    """
    if not cameras:
        raise ValueError("choosing a sample distance needs at least one camera")
    field = _drawable(field)
    if isinstance(appearance, Isosurface):
        return SampleDistance(min(field.spacing), math.inf, 0.0)
    target_decibels = numbers.decibels(target_decibels, "target_decibels")
    views = spread(cameras, VIEWS)
    smallest = min(field.spacing)
    limit = 0.5 if max(field.spacing) > ANISOTROPIC * smallest else math.inf
    fractions = [c for c in CANDIDATES if c <= limit]
    measured = _first_enough(field, appearance, views, fractions, [target_decibels + MARGIN] * len(fractions))
    measured = replace(measured, change=field.mean_change(appearance.transfer_function))
    if measured.decibels >= target_decibels + MARGIN:
        return measured
    note = (
        f"no sample distance reaches {target_decibels} dB with 1 dB in hand: {measured.distance:g} gives "
        f"{measured.decibels:.1f} dB; the transfer function has features finer than the grid"
    )
    if warn:
        warnings.warn(note, stacklevel=2)
    return replace(measured, note=note)


def choose_for_ensemble(
    field: Grid | Drawable,
    appearance: VolumeRendering | Isosurface,
    cameras: Sequence[Camera],
    target_decibels: float = 50.0,
) -> SampleDistance:
    """A sample distance for `field`, and for later fields on such a grid that show more of the transfer function.

    As `choose_sample_distance`, without a warning.  Where the field shows next to nothing, such as one at rest, a second counts,
    too: it sweeps the transfer function's whole range in 8 samples (`render.steepness`).
    """
    field = _drawable(field)
    chosen = choose_sample_distance(field, appearance, cameras, target_decibels, warn=False)
    if isinstance(appearance, Isosurface):
        return chosen
    trial = swept(field.spacing, appearance.transfer_function)
    change = mean_change(trial, appearance.transfer_function)
    if chosen.change >= TRIVIAL * change:
        return chosen
    views = orbit(trial.center, trial.bounding_radius, width=CHECKED_PIXELS, height=CHECKED_PIXELS)
    fractions = [c for c in CANDIDATES if c >= FINEST_SWEPT]
    wanted = [target_decibels + MARGIN] * len(fractions)
    tried = _first_enough(WholeField(trial), appearance, spread(views, CHECKED_VIEWS), fractions, wanted)
    if tried.distance >= chosen.distance:
        return replace(chosen, change=change)
    return replace(tried, milliseconds=chosen.milliseconds * chosen.distance / tried.distance, change=change)


def checked_sample_distance(
    field: Grid | Drawable,
    appearance: VolumeRendering,
    cameras: Sequence[Camera],
    planned: float,
    target_decibels: float,
) -> SampleDistance:
    """`planned` (world units) where it gives `field` the target, else the largest finer distance that does, with a `note`.

    By two of `cameras` at no more than 96 pixels: the cost of about eight images of 256².
    """
    field, views = _drawable(field), [_small(camera) for camera in spread(cameras, CHECKED_VIEWS)]
    first = planned / min(field.spacing)
    fractions = [first, *(c for c in CANDIDATES if c < first)]
    wanted = [target_decibels, *[target_decibels + MARGIN] * (len(fractions) - 1)]
    before: list[SampleDistance] = []
    checked = _first_enough(field, appearance, views, fractions, wanted, before)
    checked = replace(checked, change=field.mean_change(appearance.transfer_function))
    if before[0].decibels >= target_decibels:
        return checked
    return replace(
        checked,
        note=f"{appearance.name}: the catalog's sample distance {planned:g} gives {before[0].decibels:.1f} dB of this member, "
        f"whose field is harder than those that it was chosen on; {target_decibels:g} dB were asked for, so "
        f"{checked.distance:g} is taken, which gives {checked.decibels:.1f} dB",
    )


def _first_enough(
    field: Drawable,
    appearance: VolumeRendering,
    views: Sequence[Camera],
    fractions: Sequence[float],
    wanted: Sequence[float],
    measured: list[SampleDistance] | None = None,
) -> SampleDistance:
    """The first of the distances, given in smallest spacings, that has the decibels wanted of it, else the last.

    All that were measured are added to `measured`.
    """
    smallest = min(field.spacing)
    measured = [] if measured is None else measured
    reference = _pictures(field, appearance, views, min(REFERENCE, fractions[0] / 4) * smallest, float_output=True)
    for fraction, enough in zip(fractions, wanted, strict=True):
        started = time.perf_counter()
        pictures = _pictures(field, appearance, views, fraction * smallest)
        milliseconds = 1e3 * (time.perf_counter() - started) / len(views)
        measured.append(SampleDistance(fraction * smallest, psnr(pictures / 255.0, reference), milliseconds))
        if measured[-1].decibels >= enough:
            break
    return measured[-1]


def _drawable(field: Grid | Drawable) -> Drawable:
    return WholeField(field) if isinstance(field, Grid) else field


def _small(camera: Camera) -> Camera:
    shrink = min(1.0, CHECKED_PIXELS / max(camera.width, camera.height))
    return camera.resized(max(1, round(shrink * camera.width)), max(1, round(shrink * camera.height)))


def spread(cameras: Sequence[Camera], count: int) -> list[Camera]:
    """Up to `count` of `cameras`, evenly over the sequence, none at its very ends (icosphere poles)."""
    count = min(count, len(cameras))
    return [cameras[int((i + 0.5) * len(cameras) / count)] for i in range(count)]


def psnr(image: NDArray[np.floating], reference: NDArray[np.floating]) -> float:
    """Peak signal-to-noise ratio in dB over all values of two equal-shaped arrays, peak 1; inf if they are equal."""
    error = float(np.mean((np.asarray(image, dtype=np.float64) - reference) ** 2))
    return math.inf if error == 0 else -10.0 * math.log10(error)


def _pictures(
    field: Drawable,
    appearance: VolumeRendering,
    cameras: Sequence[Camera],
    distance: float,
    *,
    float_output: bool = False,
) -> NDArray[np.floating]:
    """All pixels of all pictures [P, 4]."""
    pictures = field.pictures(appearance, cameras, distance, float_output=float_output)
    return np.concatenate([picture.reshape(-1, 4) for picture in pictures])
