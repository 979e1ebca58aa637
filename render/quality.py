"""How far apart samples may lie: the largest distance whose measured error meets a target."""

from __future__ import annotations

import math
import time
import warnings
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from catalogs.appearance import Isosurface, VolumeRendering
from catalogs.cameras import Camera
from render.grids import Grid
from render.views import render_views

CANDIDATES = (1.5, 1.25, 1.0, 0.9, 0.8, 0.7, 0.6, 0.5, 0.4, 0.3, 0.25, 0.2, 0.15, 0.125, 0.1)  # in smallest spacings
REFERENCE = 1 / 24  # in smallest spacings: beyond 80 dB against the float64 ray-marcher on fields of this kind
MARGIN = 1.0  # dB kept in hand for views and members that were not measured
ANISOTROPIC = 2.0  # largest over smallest spacing beyond which samples stay within half the smallest
VIEWS = 4


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
    """

    distance: float
    decibels: float
    milliseconds: float
    note: str = ""


def choose_sample_distance(
    grid: Grid,
    appearance: VolumeRendering | Isosurface,
    cameras: Sequence[Camera],
    target_decibels: float = 50.0,
    *,
    warn: bool = True,
) -> SampleDistance:
    """The largest sample distance at which `grid`'s pictures come within `target_decibels` (+1 dB in hand).

    Renders up to four of `cameras`, spread over the sequence, at ever smaller distances until the target is met.
    On grids whose spacings differ by more than a factor of 2 it starts at half the smallest, because thin
    structures lose opacity when a step jumps over them.  Where none is enough it returns the finest,
    with a `note`, and gives it as a warning unless `warn` is false.  An isosurface has no samples along rays: its
    distance is the smallest spacing and its error is 0 (inf dB).

    Raises ValueError for no cameras or a target that 8 bits cannot hold (above 58 dB).
    """
    if not cameras:
        raise ValueError("choosing a sample distance needs at least one camera")
    if isinstance(appearance, Isosurface):
        return SampleDistance(min(grid.spacing), math.inf, 0.0)
    if not 0 < target_decibels <= 58:
        raise ValueError(
            f"target_decibels must lie between 0 and 58, what 8-bit images can hold, got {target_decibels}"
        )
    views = spread(cameras, VIEWS)
    smallest = min(grid.spacing)
    limit = 0.5 if max(grid.spacing) > ANISOTROPIC * smallest else math.inf
    reference = _pictures(grid, appearance, views, REFERENCE * smallest, float_output=True)
    measured = SampleDistance(math.nan, -math.inf, math.nan)
    for fraction in (c for c in CANDIDATES if c <= limit):
        started = time.perf_counter()
        pictures = _pictures(grid, appearance, views, fraction * smallest)
        milliseconds = 1e3 * (time.perf_counter() - started) / len(views)
        measured = SampleDistance(fraction * smallest, psnr(pictures / 255.0, reference), milliseconds)
        if measured.decibels >= target_decibels + MARGIN:
            return measured
    note = (
        f"no sample distance reaches {target_decibels} dB with 1 dB in hand: {measured.distance:g} gives "
        f"{measured.decibels:.1f} dB; the transfer function has features finer than the grid"
    )
    if warn:
        warnings.warn(note, stacklevel=2)
    return replace(measured, note=note)


def spread(cameras: Sequence[Camera], count: int) -> list[Camera]:
    """Up to `count` of `cameras`, evenly over the sequence, none at its very ends (icosphere poles)."""
    count = min(count, len(cameras))
    return [cameras[int((i + 0.5) * len(cameras) / count)] for i in range(count)]


def psnr(image: NDArray[np.floating], reference: NDArray[np.floating]) -> float:
    """Peak signal-to-noise ratio in dB over all values of two equal-shaped arrays, peak 1; inf if they are equal."""
    error = float(np.mean((np.asarray(image, dtype=np.float64) - reference) ** 2))
    return math.inf if error == 0 else -10.0 * math.log10(error)


def _pictures(
    grid: Grid, appearance: VolumeRendering, cameras: Sequence[Camera], distance: float, *, float_output: bool = False
) -> NDArray[np.floating]:
    """All pixels of all pictures [P, 4]."""
    pictures = render_views(grid, appearance, cameras, sample_distance=distance, float_output=float_output)
    return np.concatenate([picture.reshape(-1, 4) for picture in pictures])
