"""Sample distances: the largest one whose measured error meets a target."""

from __future__ import annotations

import math
import warnings
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from catalogs.vocabulary import numbers
from catalogs.vocabulary.appearance import Appearance, Isosurface, TransferFunction, VolumeRendering
from catalogs.vocabulary.cameras import Camera, orbit
from render.backends import backend_of
from render.casting import cast_views, prepared
from render.grids import Grid, Triple
from render.steepness import mean_change, swept
from render.views import render_views

COARSE = (64.0, 48.0, 40.0, 32.0, 24.0, 20.0, 16.0, 12.0, 10.0, 8.0, 6.0, 5.0, 4.0, 3.0, 2.5, 2.0)  # smallest spacings
CANDIDATES = (*COARSE, 1.5, 1.25, 1.0, 0.9, 0.8, 0.7, 0.6, 0.5, 0.4, 0.3, 0.25, 0.2, 0.15, 0.125, 0.1)
FIRST = 6.0  # of them that is measured
FEWEST_SAMPLES = 4  # along the longest side of the box, at the coarsest
REFERENCE = 1.0  # spacings between samples of a reference, at most
FINER = 6.0  # times as many samples as what is measured against it
ORDER = 4  # the squared error grows with this power of the distance where it is small
MARGIN = 1.5  # dB kept in hand for views and members that were not measured
ANISOTROPIC = 2.0  # largest over smallest spacing beyond which samples stay within half the smallest
VIEWS, PIXELS = 28, 48
FINEST_SWEPT = 0.25  # smallest spacings: swept fields ask for no finer distance
HARDER = 1.05  # times the change of what was measured: such a field is measured again
CHECKED_VIEWS, CHECKED_PIXELS = 8, 48


class Drawable(Protocol):
    """A field whose pictures can be had, be it in one piece or in blocks."""

    @property
    def spacing(self) -> Triple:
        """Of its samples, world units, x, y, z."""

    @property
    def shape(self) -> tuple[int, int, int]:
        """Its samples along z, y, x."""

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
    _casters: dict[Appearance, Any] = field(default_factory=dict)  # the latest appearance's, prepared

    @property
    def spacing(self) -> Triple:
        """See `Drawable`."""
        return self.grid.spacing

    @property
    def shape(self) -> tuple[int, int, int]:
        """See `Drawable`."""
        return self.grid.shape

    def pictures(
        self, appearance: Appearance, cameras: Sequence[Camera], sample_distance: float | None, *, float_output: bool
    ) -> Iterable[NDArray[Any]]:
        """See `Drawable`."""
        if isinstance(appearance, VolumeRendering) and backend_of(self.grid, appearance, self.backend) == "cpu":
            if appearance not in self._casters:
                self._casters.clear()
                self._casters[appearance] = prepared(self.grid, appearance)
            return cast_views(self._casters[appearance], cameras, sample_distance, float_output=float_output)
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
    """A sample distance (world units), and the error measured at it.

    Attributes
    ----------
    distance : world units between samples along a ray.
    decibels : peak signal-to-noise ratio of the 8-bit pictures (premultiplied RGBA, peak 1, all pixels pooled).  The reference
        has samples at a sixth of the distance, and at most the smallest spacing.
    note : what the user should know: that it misses the target.
    change : how much the measured field changes from sample to sample as the transfer function shows it (`mean_change`).

    Examples
    --------
    >>> from blobs import APPEARANCE, CAMERA, PLACE, simulate
    >>> from render import choose_sample_distance, to_grid
    >>> chosen = choose_sample_distance(to_grid(simulate(0.8, 0.3), **PLACE), APPEARANCE, [CAMERA], 45.0)
    >>> chosen.decibels > 45
    True
    """

    distance: float
    decibels: float
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
    """The largest sample distance at which pictures of `field` come within `target_decibels` (+1.5 dB in hand).

    Draws up to 28 of `cameras`, spread over the sequence, at no more than 48 pixels: errors differ more between views than
    within them. The error of one distance says near which one the target is met, and a few are measured. On grids whose
    spacings differ by more than a factor of 2 none is longer than half the smallest, because thin structures lose opacity when
    a step jumps over them. Where none is enough it returns the finest, with a `note`, and gives it as a warning unless `warn`
    is false. An isosurface has no samples along rays: its distance is the smallest spacing and its error is 0 (inf dB).

    Raises ValueError for no cameras or a target that 8 bits cannot hold (above 58 dB).

    Examples
    --------
    >>> from blobs import APPEARANCE, CAMERA, PLACE, simulate
    >>> from render import choose_sample_distance, to_grid
    >>> grid = to_grid(simulate(0.8, 0.3), **PLACE)
    >>> good, better = (choose_sample_distance(grid, APPEARANCE, [CAMERA], target) for target in (40, 55))
    >>> good.distance > better.distance
    True
    """
    if not cameras:
        raise ValueError("choosing a sample distance needs at least one camera")
    field = _drawable(field)
    if isinstance(appearance, Isosurface):
        return SampleDistance(min(field.spacing), math.inf)
    target_decibels = numbers.decibels(target_decibels, "target_decibels")
    views = [_small(camera, PIXELS) for camera in spread(cameras, VIEWS)]
    measured = _largest(Errors(field, appearance, views), _candidates(field), target_decibels + MARGIN)
    measured = replace(measured, change=field.mean_change(appearance.transfer_function))
    if measured.decibels >= target_decibels + MARGIN:
        return measured
    note = (
        f"no sample distance reaches {target_decibels} dB with {MARGIN:g} dB in hand: {measured.distance:g} gives "
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

    As `choose_sample_distance`, without a warning.  A field for which the coarsest distance is enough, such as one at rest,
    shows next to nothing. Then a second field counts, too: it sweeps the transfer function's whole range in 8 samples
    (`render.steepness`).
    """
    field = _drawable(field)
    chosen = choose_sample_distance(field, appearance, cameras, target_decibels, warn=False)
    if isinstance(appearance, Isosurface) or chosen.distance < _candidates(field)[0] * min(field.spacing):
        return chosen
    trial = swept(field.spacing, appearance.transfer_function)
    change = mean_change(trial, appearance.transfer_function)
    views = orbit(trial.center, trial.bounding_radius, width=CHECKED_PIXELS, height=CHECKED_PIXELS)
    errors = Errors(WholeField(trial), appearance, spread(views, CHECKED_VIEWS))
    fractions = [f for f in _candidates(field) if f >= FINEST_SWEPT]
    tried = _largest(errors, fractions, target_decibels + MARGIN)
    return replace(tried if tried.distance < chosen.distance else chosen, change=max(change, chosen.change))


def checked_sample_distance(
    field: Grid | Drawable,
    appearance: VolumeRendering,
    cameras: Sequence[Camera],
    planned: float,
    target_decibels: float,
) -> SampleDistance:
    """`planned` (world units) where it gives `field` the target, else the largest finer distance that does, with a `note`.

    By eight of `cameras` at no more than 48 pixels.
    """
    field, views = _drawable(field), [_small(camera, CHECKED_PIXELS) for camera in spread(cameras, CHECKED_VIEWS)]
    errors, first = Errors(field, appearance, views), planned / min(field.spacing)
    as_planned = replace(errors.of(first), change=field.mean_change(appearance.transfer_function))
    finer = [f for f in CANDIDATES if f < first]
    if as_planned.decibels >= target_decibels or not finer:
        return as_planned
    checked = replace(_largest(errors, finer, target_decibels + MARGIN), change=as_planned.change)
    return replace(
        checked,
        note=f"{appearance.name}: the catalog's sample distance {planned:g} gives {as_planned.decibels:.1f} dB of this member, "
        f"whose field is harder than those that it was chosen on; {target_decibels:g} dB were asked for, so "
        f"{checked.distance:g} is taken, which gives {checked.decibels:.1f} dB",
    )


class Errors:
    """Errors of one field's pictures by the distance of samples, against pictures that are finer by `FINER`."""

    def __init__(self, field: Drawable, appearance: VolumeRendering, views: Sequence[Camera]) -> None:
        self._field, self._appearance, self._views = field, appearance, views
        self._finest, self._reference = math.inf, np.empty(0)
        self._measured: dict[float, SampleDistance] = {}

    def of(self, fraction: float) -> SampleDistance:
        """The distance of `fraction` smallest spacings, measured once."""
        if fraction not in self._measured:
            finest = min(REFERENCE, fraction / FINER)
            if finest < self._finest * (1 - 1e-9):
                self._finest, self._reference = finest, self._pictures(finest, float_output=True)
            decibels = psnr(self._pictures(fraction, float_output=False) / 255.0, self._reference)
            self._measured[fraction] = SampleDistance(fraction * min(self._field.spacing), decibels)
        return self._measured[fraction]

    def _pictures(self, fraction: float, *, float_output: bool) -> NDArray[Any]:
        """All pixels of all pictures [P, 4]."""
        distance = fraction * min(self._field.spacing)
        pictures = self._field.pictures(self._appearance, self._views, distance, float_output=float_output)
        return np.concatenate([picture.reshape(-1, 4) for picture in pictures])


def _largest(errors: Errors, fractions: Sequence[float], wanted: float) -> SampleDistance:
    """The first of `fractions`, from the largest on, whose pictures have the decibels wanted, else the last.

    Between one that fails and one that does not it tries the one that the error's growth with the distance promises.
    """
    fails, succeeds = -1, len(fractions)
    number = min(range(len(fractions)), key=lambda n: abs(math.log(fractions[n] / FIRST)))
    while True:
        measured = errors.of(fractions[number])
        if measured.decibels >= wanted:
            succeeds = number
        else:
            fails = number
        if succeeds - fails == 1:
            return errors.of(fractions[min(succeeds, len(fractions) - 1)])
        short = measured.decibels - wanted if math.isfinite(measured.decibels) else math.inf
        promised = fractions[number] * 10.0 ** min(short / (10.0 * ORDER), 3.0)
        following = next((n for n, fraction in enumerate(fractions) if fraction <= promised), len(fractions))
        number = min(max(following, fails + 1), succeeds - 1)


def _candidates(field: Drawable) -> list[float]:
    """Distances to choose from, smallest spacings, the largest first."""
    smallest = min(field.spacing)
    if max(field.spacing) > ANISOTROPIC * smallest:
        return [c for c in CANDIDATES if c <= 0.5]
    sides = [(n - 1) * spacing for n, spacing in zip(field.shape, reversed(field.spacing), strict=True)]
    longest = max(1.5, max(sides) / smallest / FEWEST_SAMPLES)
    return [c for c in CANDIDATES if c <= longest]


def _drawable(field: Grid | Drawable) -> Drawable:
    return WholeField(field) if isinstance(field, Grid) else field


def _small(camera: Camera, pixels: int) -> Camera:
    shrink = min(1.0, pixels / max(camera.width, camera.height))
    return camera.resized(max(1, round(shrink * camera.width)), max(1, round(shrink * camera.height)))


def spread(cameras: Sequence[Camera], count: int) -> list[Camera]:
    """Up to `count` of `cameras`, evenly over the sequence, none at its very ends (icosphere poles)."""
    count = min(count, len(cameras))
    return [cameras[int((i + 0.5) * len(cameras) / count)] for i in range(count)]


def psnr(image: NDArray[np.floating], reference: NDArray[np.floating]) -> float:
    """Peak signal-to-noise ratio in dB over all values of two equal-shaped arrays, peak 1; inf if they are equal."""
    error = float(np.mean((np.asarray(image, dtype=np.float64) - reference) ** 2))
    return math.inf if error == 0 else -10.0 * math.log10(error)
