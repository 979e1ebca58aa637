"""The summary of a member's field, in kilobytes: histogram, range, points where something is seen, and points everywhere.

Works through the grid in slabs of whole z-slices, so that its extra memory does not grow with the field.  Of a field in blocks
every rank looks at what it owns; all draw the same random numbers.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from catalogs.store.plan import CatalogPlan
from catalogs.store.summary import FieldSummary
from catalogs.vocabulary.appearance import Appearance, Isosurface, TransferFunction, VolumeRendering, field_of
from catalogs.vocabulary.parameters import SPLITS
from insitu.mpi.ranks import SINGLE, RankGroup

if TYPE_CHECKING:
    from render.blocks import Block, Lattice
    from render.grids import Grid

BINS = 256
POINTS = 4000
EVEN_POINTS = 2000
EVEN_ROUNDS = 64  # so often is a full set drawn at most where holes swallow points
GOLDEN = 1.2207440846057596  # g^4 = g + 1
SLAB_VOXELS = 1 << 20
ROUNDING = 1e-3
SEED = 0  # the same field always leaves the same summary

SlabWeights = Callable[[int, int], NDArray[np.float64]]


@dataclass(frozen=True, eq=False)
class FieldPart:
    """One rank's part of a field.

    Attributes
    ----------
    values, holes : (nz, ny, nx), with the neighbours' samples around those that it owns.
    first : index (3,), z, y, x, in the whole of their first one.
    start, stop : indices (3,) in the whole of the samples that it owns; `stop` is not among them.
    whole : where all samples of the field lie.
    """

    values: NDArray[Any]
    holes: NDArray[np.bool_] | None
    first: NDArray[np.int64]
    start: NDArray[np.int64]
    stop: NDArray[np.int64]
    whole: Lattice

    @classmethod
    def of(cls, block: Block) -> FieldPart:
        """Of a block."""
        grid, owned = block.grid, block.owned
        first, start, stop = np.array(block.first), np.array(owned.start), np.array(owned.stop)
        return cls(grid.values, grid.holes, first, start, stop, block.whole)

    @classmethod
    def all_of(cls, grid: Grid) -> FieldPart:
        """The whole of a field."""
        from render.blocks import Lattice

        none, whole = np.zeros(3, dtype=np.int64), Lattice(grid.shape, grid.spacing, grid.origin)
        return cls(grid.values, grid.holes, none, none, np.array(grid.shape), whole)

    @classmethod
    def none_of(cls, whole: Lattice) -> FieldPart:
        """Of a rank without a block."""
        none = np.zeros(3, dtype=np.int64)
        return cls(np.empty((0, 0, 0)), None, none, none, none, whole)

    @property
    def shape(self) -> tuple[int, int, int]:
        """Of the owned samples."""
        z, y, x = (self.stop - self.start).tolist()
        return z, y, x

    def window(self, start: int, stop: int, axis: int | None = None) -> tuple[slice, ...]:
        """The place in `values` of the owned slices from `start` to before `stop`, or of their next samples along `axis`."""
        low = self.start - self.first
        high = low + self.shape
        low[0], high[0] = low[0] + start, low[0] + stop
        if axis is not None:
            low[axis] += 1
            high[axis] = min(high[axis] + 1, self.values.shape[axis])
        return tuple(map(slice, low.tolist(), high.tolist()))

    def owns(self, index: NDArray[np.int64]) -> NDArray[np.bool_]:
        """Which of the samples (M, 3), indices in the whole, it owns."""
        return np.all((index >= self.start) & (index < self.stop), axis=1)


def value_range(appearances: Sequence[Appearance], fallback: tuple[float, float]) -> tuple[float, float]:
    """The ensemble's fixed range of values: what the transfer functions and isovalues span.

    `fallback`, the first member's range, widens it where there are isosurfaces only, which state no range.
    """
    ends = [v for a in appearances if isinstance(a, VolumeRendering) for v in a.transfer_function.bounds]
    isovalues = [a.isovalue for a in appearances if isinstance(a, Isosurface)]
    if not ends:
        ends = list(fallback)
    low, high = min(ends + isovalues), max(ends + isovalues)
    return (low, high) if low < high else (low - 0.5, high + 0.5)


def value_range_of(plan: CatalogPlan, field: str) -> tuple[float, float]:
    """A field's fixed range of values, as the plan recorded it."""
    low, high = plan.provenance["value_ranges"][field] if len(plan.fields) > 1 else plan.provenance["value_range"]
    return low, high


def summarize_shown(
    parts: Mapping[str, FieldPart], plan: CatalogPlan, ranks: RankGroup = SINGLE
) -> dict[str, FieldSummary]:
    """The summary of each field of a member, by name, under all of the catalog's appearances of it.

    Of the settings of a transfer function's variation only the base counts: they all show the same places.
    """
    settings = {n for v in plan.variations if v.edits_base for n in v.named(*SPLITS)}
    sampled = [a for a in plan.appearances if a.name not in settings]
    return {
        name: summarize_part(part, [a for a in sampled if field_of(a) == name], value_range_of(plan, name), ranks)
        for name, part in parts.items()
    }


def summarize(
    grid: Grid,
    appearances: Sequence[Appearance],
    bounds: tuple[float, float],
    *,
    points: int = POINTS,
    even_points: int = EVEN_POINTS,
) -> FieldSummary:
    """The summary of `grid` under `appearances`, its histogram over the ensemble's value range `bounds`.

    The histogram counts the values within `bounds`, holes left out; `clipped_fraction` is the share outside.
    Each appearance gets an equal share of the points.  They are voxels drawn with probability proportional to their opacity and
    jittered within half a voxel (volume rendering), or crossings of the isovalue on grid edges (isosurface).
    An appearance of another package gets none.
    `even_points` more, whatever the appearances, fill the box evenly; there are fewer where it is nearly all holes.
    """
    return summarize_part(FieldPart.all_of(grid), appearances, bounds, points=points, even_points=even_points)


def summarize_part(
    part: FieldPart,
    appearances: Sequence[Appearance],
    bounds: tuple[float, float],
    ranks: RankGroup = SINGLE,
    *,
    points: int = POINTS,
    even_points: int = EVEN_POINTS,
) -> FieldSummary:
    """The summary, on every rank, of the field of which each has a `part`; see `summarize`."""
    edges = np.linspace(bounds[0], bounds[1], BINS + 1)  # [257]
    low, high, count, histogram = _statistics(part, edges, ranks)
    rng = np.random.default_rng(SEED)
    sampled_for = [a for a in appearances if isinstance(a, VolumeRendering | Isosurface)]
    shares = [points // len(sampled_for) + (i < points % len(sampled_for)) for i in range(len(sampled_for))]
    sampled = [_sample(part, a, n, rng, ranks) for a, n in zip(sampled_for, shares, strict=True)]
    even = sample_evenly(part, even_points, _shift(low, high, histogram), ranks)
    smallest = min(part.whole.spacing)
    return FieldSummary(
        minimum=low,
        maximum=high,
        clipped_fraction=1.0 - float(histogram.sum()) / count,
        histogram=histogram,
        bin_edges=edges,
        points=_narrowed(np.concatenate([np.empty((0, 3)), *(s[0] for s in sampled)]), smallest),  # [M, 3]
        point_values=_narrowed(np.concatenate([np.empty(0), *(s[1] for s in sampled)]), edges[-1] - edges[0]),  # [M]
        point_opacities=np.concatenate([np.empty(0), *(s[2] for s in sampled)]).astype(np.float32),  # [M]
        even_points=_narrowed(even[0], smallest),  # [E, 3]
        even_values=_narrowed(even[1], edges[-1] - edges[0]),  # [E]
    )


def _statistics(
    part: FieldPart, edges: NDArray[np.float64], ranks: RankGroup
) -> tuple[float, float, int, NDArray[np.int64]]:
    """Smallest and largest value of all parts, how many there are, and how many in each bin (256,)."""
    histogram = np.zeros(BINS, dtype=np.int64)
    count, low, high = 0, np.inf, -np.inf
    for start, stop in slabs(part.shape):
        window = part.window(start, stop)
        slab = part.values[window] if part.holes is None else part.values[window][~part.holes[window]]
        histogram += np.histogram(slab, bins=edges)[0]
        count += slab.size
        if slab.size:
            low, high = min(low, float(slab.min())), max(high, float(slab.max()))
    lows, highs, counts, histograms = zip(*ranks.gather((low, high, count, histogram)), strict=True)
    return min(lows), max(highs), sum(counts), np.sum(histograms, axis=0)


def sample_evenly(
    part: FieldPart, count: int, shift: NDArray[np.float64], ranks: RankGroup = SINGLE
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """World points (M, 3) that fill the grid's box evenly, none in a cell with a hole at a corner, and values (M,); M <= `count`.

    They are the first points of a low-discrepancy sequence, multiples of the generalized golden ratio, moved by `shift` (3,)
    around the box (Cranley and Patterson 1976).  Source: Roberts 2018, "The Unreasonable Effectiveness of Quasirandom Sequences".
    """
    steps = GOLDEN ** -np.arange(1.0, 4.0)  # [3]
    last = np.array(part.whole.shape) - 1  # [3]
    has_holes = any(ranks.gather(part.holes is not None))
    indices = np.empty((0, 3))  # z, y, x
    for draw in range(EVEN_ROUNDS if has_holes else 1):
        numbers = np.arange(draw * count, (draw + 1) * count)[:, None]  # [count, 1]
        index = (shift + numbers * steps) % 1.0 * last  # [count, 3]
        if has_holes:
            mine = part.owns(np.floor(index).astype(np.int64))
            index = index[_combined(_in_whole_cells(part, index[mine]), mine, ranks)]
        indices = np.concatenate([indices, index])[:count]
        if len(indices) == count:
            break
    return _world(part.whole, indices), _valued(part, indices, np.floor(indices).astype(np.int64), ranks)


def _shift(low: float, high: float, histogram: NDArray[np.int64]) -> NDArray[np.float64]:
    """Three numbers in [0, 1) that differ from field to field and are always the same for the same one."""
    content = np.array([low, high], dtype="<f8").tobytes() + histogram.astype("<i8").tobytes()
    key = int.from_bytes(hashlib.sha256(content).digest()[:16], "little")
    return np.random.default_rng(key).random(3)


def _in_whole_cells(part: FieldPart, index: NDArray[np.float64]) -> NDArray[np.bool_]:
    """True if no corner of the cell around each fractional index (M, 3) that the part owns is a hole, (M,)."""
    whole = np.ones(len(index), dtype=bool)
    if part.holes is not None:
        low = np.minimum(np.floor(index).astype(np.int64), np.array(part.whole.shape) - 2) - part.first  # [M, 3]
        for corner in np.ndindex(2, 2, 2):
            whole &= ~part.holes[tuple((low + corner).T)]
    return whole


def _world(whole: Lattice, index: NDArray[np.float64]) -> NDArray[np.float64]:
    """World points (M, 3) x, y, z of fractional indices (M, 3) z, y, x."""
    return np.asarray(whole.origin) + index[:, ::-1] * np.asarray(whole.spacing)


def _narrowed(numbers: NDArray[np.float64], unit: float) -> NDArray[np.floating]:
    """`numbers` in float32 where that moves none by more than `ROUNDING` units."""
    with np.errstate(over="ignore", invalid="ignore"):
        single = numbers.astype(np.float32)
        return single if (np.abs(single - numbers) <= ROUNDING * unit).all() else numbers


def _sample(
    part: FieldPart, appearance: VolumeRendering | Isosurface, count: int, rng: np.random.Generator, ranks: RankGroup
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """World points (M, 3), values (M,) and opacities (M,) where `appearance` shows something; M is `count` or 0."""
    if isinstance(appearance, Isosurface):
        index = _edge_crossings(part, appearance.isovalue, count, rng, ranks)  # [M, 3] z, y, x
        values = np.full(len(index), appearance.isovalue)  # [M]
        opacities = np.ones(len(index))  # [M]
    else:
        index, values = _opaque_voxels(part, appearance.transfer_function, count, rng, ranks)  # [M, 3], [M]
        opacities = appearance.transfer_function.opacities(values)  # [M]
    return _world(part.whole, index), values, opacities


def _opaque_voxels(
    part: FieldPart, transfer_function: TransferFunction, count: int, rng: np.random.Generator, ranks: RankGroup
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Fractional indices (M, 3) of voxels drawn in proportion to their opacity, jittered within their cells, and values (M,)."""

    def weights(start: int, stop: int) -> NDArray[np.float64]:
        window = part.window(start, stop)
        opacities = transfer_function.opacities(part.values[window])
        if part.holes is not None:
            opacities[part.holes[window]] = 0.0
        return opacities.ravel()

    voxels = _draw(part, weights, count, rng, ranks)  # [M, 3]
    jittered = voxels + rng.uniform(-0.5, 0.5, voxels.shape)
    index = np.clip(jittered, 0.0, np.array(part.whole.shape) - 1.0)
    return index, _valued(part, index, voxels, ranks)


def _edge_crossings(
    part: FieldPart, isovalue: float, count: int, rng: np.random.Generator, ranks: RankGroup
) -> NDArray[np.float64]:
    """Fractional indices (M, 3) of points where the isosurface cuts grid edges, edges drawn evenly."""
    own = [sum(int(_cut(part, isovalue, *s, axis).sum()) for s in slabs(part.shape)) for axis in range(3)]
    cuts = np.sum(ranks.gather(own), axis=0)
    if not cuts.any():
        return np.empty((0, 3))
    points = []
    for axis, number in enumerate(rng.multinomial(count, cuts / cuts.sum())):

        def weights(start: int, stop: int, axis: int = axis) -> NDArray[np.float64]:
            return _cut(part, isovalue, start, stop, axis).ravel().astype(np.float64)

        voxels = _draw(part, weights, number, rng, ranks)  # [M, 3]
        mine, step = part.owns(voxels), np.eye(3, dtype=np.int64)[axis]
        here = voxels[mine] - part.first
        first = part.values[tuple(here.T)].astype(np.float64)
        second = part.values[tuple((here + step).T)].astype(np.float64)
        along = _combined((isovalue - first) / (second - first), mine, ranks)  # [M]
        points.append(voxels + step * along[:, None])
    return np.concatenate(points)


def _cut(part: FieldPart, isovalue: float, start: int, stop: int, axis: int) -> NDArray[np.bool_]:
    """True if the surface cuts the edge from each owned sample of a slab (K, ny, nx) to the next one along `axis`."""
    here, following = part.window(start, stop), part.window(start, stop, axis)
    above, beyond = part.values[here] > isovalue, part.values[following] > isovalue
    cut = np.zeros(above.shape, dtype=bool)
    inner = tuple(map(slice, beyond.shape))  # the last samples of the whole have no next ones
    cut[inner] = above[inner] != beyond
    if part.holes is not None:
        cut[inner] &= ~(part.holes[here][inner] | part.holes[following])
    return cut


def _draw(
    part: FieldPart, weights: SlabWeights, count: int, rng: np.random.Generator, ranks: RankGroup
) -> NDArray[np.int64]:
    """Samples (count, 3) of the whole, drawn with replacement in proportion to `weights(start, stop)` of each owned slab."""
    own = list(slabs(part.shape))
    totals = ranks.gather(np.array([weights(*slab).sum() for slab in own]))  # of each rank [S]
    every = np.concatenate(totals)
    if not every.sum() > 0:
        return np.empty((0, 3), dtype=np.int64)
    numbers = iter(rng.multinomial(count, every / every.sum()).tolist())
    samples = [np.empty((0, 3), dtype=np.int64)]
    for rank, of_rank in enumerate(totals):
        for slab in range(len(of_rank)):
            number = next(numbers)
            uniform = rng.random(number)  # by every rank, so that all go on with the same numbers
            if number and rank == ranks.number:
                samples.append(_picked(part, *own[slab], weights, uniform))
    return np.concatenate(ranks.gather(np.concatenate(samples)))


def _picked(
    part: FieldPart, start: int, stop: int, weights: SlabWeights, uniform: NDArray[np.float64]
) -> NDArray[np.int64]:
    """Samples (M, 3) of the whole in a slab, in proportion to `weights`, for numbers (M,) in [0, 1)."""
    cumulative = np.cumsum(weights(start, stop))  # [K]
    picks = np.searchsorted(cumulative, uniform * cumulative[-1], side="right")
    last = np.searchsorted(cumulative, cumulative[-1])  # a product may round up to the total
    places = np.unravel_index(np.minimum(picks, last), (stop - start, *part.shape[1:]))
    return np.stack(places, axis=1) + part.start + np.array([start, 0, 0])


def _valued(
    part: FieldPart, index: NDArray[np.float64], owned: NDArray[np.int64], ranks: RankGroup
) -> NDArray[np.float64]:
    """Values (M,) at fractional indices (M, 3), by the ranks that own the samples `owned` (M, 3) next to them."""
    mine = part.owns(owned)
    return _combined(_interpolate(part.values, index[mine] - part.first), mine, ranks)


def _combined(own: NDArray[Any], mine: NDArray[np.bool_], ranks: RankGroup) -> NDArray[Any]:
    """(M, ...) from what each rank has of them, `own`, at the places that are `mine` (M,), on every rank."""
    result = np.zeros((len(mine), *own.shape[1:]), dtype=own.dtype)
    for places, values in ranks.gather((mine, own)):
        result[places] = values
    return result


def _interpolate(values: NDArray[Any], index: NDArray[np.float64]) -> NDArray[np.float64]:
    """Trilinear values (M,) at fractional indices (M, 3); the nearest voxel's where a neighbour is not finite."""
    low = np.floor(index).astype(np.int64)  # [M, 3]
    high = np.minimum(low + 1, np.array(values.shape) - 1)
    fraction = index - low
    result = np.zeros(len(index))
    for corner in np.ndindex(2, 2, 2):
        upper = np.array(corner, dtype=bool)  # [3]
        at = np.where(upper, high, low)  # [M, 3]
        weight = np.where(upper, fraction, 1.0 - fraction).prod(axis=1)  # [M]
        result += weight * values[tuple(at.T)]
    nearest = values[tuple(np.rint(index).astype(np.int64).T)]
    return np.where(np.isfinite(result), result, nearest)


def slabs(shape: tuple[int, ...]) -> Iterator[tuple[int, int]]:
    """Ranges of z-slices of about SLAB_VOXELS voxels each."""
    step = max(1, SLAB_VOXELS // max(1, shape[1] * shape[2]))
    for start in range(0, shape[0], step):
        yield start, min(start + step, shape[0])
