"""What is kept of a member's field, in kilobytes: histogram, range, points where something is seen, and points everywhere.

Works through the grid in slabs of whole z-slices, so that its extra memory does not grow with the field.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from catalogs.appearance import Appearance, Isosurface, TransferFunction, VolumeRendering, field_of
from catalogs.parameters import SPLITS
from catalogs.plan import CatalogPlan
from catalogs.summary import FieldSummary

if TYPE_CHECKING:
    from render.grids import Grid

BINS = 256
POINTS = 4000
EVEN_POINTS = 2000
EVEN_ROUNDS = 64  # so often is a full set drawn at most where holes swallow points
GOLDEN = 1.2207440846057596  # g^4 = g + 1
SLAB_VOXELS = 1 << 20
ROUNDING = 1e-3
SEED = 0  # the same field always leaves the same summary

Weights = Callable[[int, int], NDArray[np.float64]]


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


def summarize_shown(grids: Mapping[str, Grid], plan: CatalogPlan) -> dict[str, FieldSummary]:
    """The summary of each field of a member, by name, under all of the catalog's appearances of it.

    Of the settings of a transfer function's variation only the base counts: they all show the same places.
    """
    settings = {n for v in plan.variations if v.edits_base for n in v.named(*SPLITS)}
    sampled = [a for a in plan.appearances if a.name not in settings]
    return {
        name: summarize(grid, [a for a in sampled if field_of(a) == name], value_range_of(plan, name))
        for name, grid in grids.items()
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
    Of the points, each appearance gets an equal share: voxels drawn with probability proportional to their opacity
    and jittered within half a voxel (volume rendering), or crossings of the isovalue on grid edges (isosurface).
    `even_points` more, whatever the appearances, fill the box evenly; there are fewer where it is nearly all holes.
    """
    values = grid.values  # [nz, ny, nx]
    edges = np.linspace(bounds[0], bounds[1], BINS + 1)  # [257]
    histogram = np.zeros(BINS, dtype=np.int64)
    known, low, high = 0, np.inf, -np.inf
    for start, stop in _slabs(values.shape):
        slab = values[start:stop] if grid.holes is None else values[start:stop][~grid.holes[start:stop]]
        histogram += np.histogram(slab, bins=edges)[0]
        known += slab.size
        if slab.size:
            low, high = min(low, float(slab.min())), max(high, float(slab.max()))
    rng = np.random.default_rng(SEED)
    shown = [a for a in appearances if isinstance(a, VolumeRendering | Isosurface)]
    shares = [points // len(shown) + (i < points % len(shown)) for i in range(len(shown))]
    sampled = [_sample(grid, a, n, rng) for a, n in zip(shown, shares, strict=True)]
    even = sample_evenly(grid, even_points, _shift(low, high, histogram))
    return FieldSummary(
        minimum=low,
        maximum=high,
        clipped_fraction=1.0 - float(histogram.sum()) / known,
        histogram=histogram,
        bin_edges=edges,
        points=_narrowed(np.concatenate([s[0] for s in sampled]), min(grid.spacing)),  # [M, 3]
        point_values=_narrowed(np.concatenate([s[1] for s in sampled]), edges[-1] - edges[0]),  # [M]
        point_opacities=np.concatenate([s[2] for s in sampled]).astype(np.float32),  # [M]
        even_points=_narrowed(even[0], min(grid.spacing)),  # [E, 3]
        even_values=_narrowed(even[1], edges[-1] - edges[0]),  # [E]
    )


def sample_evenly(
    grid: Grid, count: int, shift: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """World points (M, 3) that fill the grid's box evenly, none in a cell with a hole at a corner, and values (M,); M <= `count`.

    They are the first ones of a low-discrepancy sequence, the multiples of the generalized golden ratio (Roberts 2018, "The
    Unreasonable Effectiveness of Quasirandom Sequences"), moved by `shift` (3,) around the box (Cranley and Patterson 1976).
    """
    steps = GOLDEN ** -np.arange(1.0, 4.0)  # [3]
    last = np.array(grid.shape) - 1  # [3]
    kept = np.empty((0, 3))  # z, y, x
    for draw in range(EVEN_ROUNDS if grid.holes is not None else 1):
        numbers = np.arange(draw * count, (draw + 1) * count)[:, None]  # [count, 1]
        index = (shift + numbers * steps) % 1.0 * last  # [count, 3]
        kept = np.concatenate([kept, index[_in_whole_cells(grid, index)]])[:count]
        if len(kept) == count:
            break
    return _world(grid, kept), _interpolate(grid.values, kept)


def _shift(low: float, high: float, histogram: NDArray[np.int64]) -> NDArray[np.float64]:
    """Three numbers in [0, 1) that differ from field to field and are always the same for the same one."""
    content = np.array([low, high], dtype="<f8").tobytes() + histogram.astype("<i8").tobytes()
    key = int.from_bytes(hashlib.sha256(content).digest()[:16], "little")
    return np.random.default_rng(key).random(3)


def _in_whole_cells(grid: Grid, index: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Whether no corner of the cell around each fractional index (M, 3) is a hole, (M,)."""
    whole = np.ones(len(index), dtype=bool)
    if grid.holes is not None:
        low = np.minimum(np.floor(index).astype(np.int64), np.array(grid.shape) - 2)  # [M, 3]
        for corner in np.ndindex(2, 2, 2):
            whole &= ~grid.holes[tuple((low + corner).T)]
    return whole


def _world(grid: Grid, index: NDArray[np.float64]) -> NDArray[np.float64]:
    """World points (M, 3) x, y, z of fractional indices (M, 3) z, y, x."""
    return np.asarray(grid.origin) + index[:, ::-1] * np.asarray(grid.spacing)


def _narrowed(numbers: NDArray[np.float64], unit: float) -> NDArray[np.floating]:
    """`numbers` in float32 where that moves none by more than `ROUNDING` units."""
    with np.errstate(over="ignore", invalid="ignore"):
        single = numbers.astype(np.float32)
        return single if (np.abs(single - numbers) <= ROUNDING * unit).all() else numbers


def _sample(
    grid: Grid, appearance: VolumeRendering | Isosurface, count: int, rng: np.random.Generator
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """World points (M, 3), values (M,) and opacities (M,) where `appearance` shows something; M is `count` or 0."""
    if isinstance(appearance, Isosurface):
        index = _edge_crossings(grid, appearance.isovalue, count, rng)  # [M, 3] z, y, x
        values = np.full(len(index), appearance.isovalue)  # [M]
        opacities = np.ones(len(index))  # [M]
    else:
        index = _opaque_voxels(grid, appearance.transfer_function, count, rng)  # [M, 3]
        values = _interpolate(grid.values, index)  # [M]
        opacities = appearance.transfer_function.opacities(values)  # [M]
    return _world(grid, index), values, opacities


def _opaque_voxels(
    grid: Grid, transfer_function: TransferFunction, count: int, rng: np.random.Generator
) -> NDArray[np.float64]:
    """Fractional indices (M, 3) of voxels drawn in proportion to their opacity, jittered within their cells."""
    values = grid.values  # [nz, ny, nx]

    def weights(start: int, stop: int) -> NDArray[np.float64]:
        opacities = transfer_function.opacities(values[start:stop])
        if grid.holes is not None:
            opacities[grid.holes[start:stop]] = 0.0
        return opacities.ravel()

    voxels = _draw(values.shape, weights, count, rng)
    index = np.stack(np.unravel_index(voxels, values.shape), axis=1)  # [M, 3]
    jittered = index + rng.uniform(-0.5, 0.5, index.shape)
    return np.clip(jittered, 0.0, np.array(values.shape) - 1.0)


def _edge_crossings(grid: Grid, isovalue: float, count: int, rng: np.random.Generator) -> NDArray[np.float64]:
    """Fractional indices (M, 3) of points where the isosurface cuts grid edges, edges drawn evenly."""
    values = grid.values  # [nz, ny, nx]
    cuts = np.array([sum(int(_cut(grid, isovalue, *s, axis).sum()) for s in _slabs(values.shape)) for axis in range(3)])
    if not cuts.any():
        return np.empty((0, 3))
    points = []
    for axis, number in enumerate(rng.multinomial(count, cuts / cuts.sum())):

        def weights(start: int, stop: int, axis: int = axis) -> NDArray[np.float64]:
            return _cut(grid, isovalue, start, stop, axis).ravel().astype(np.float64)

        voxels = _draw(values.shape, weights, number, rng)
        index = np.stack(np.unravel_index(voxels, values.shape), axis=1)  # [M, 3]
        first = values[tuple(index.T)].astype(np.float64)  # [M]
        following = index + np.eye(3, dtype=np.int64)[axis]
        second = values[tuple(following.T)].astype(np.float64) if number else first  # [M]
        points.append(index + np.eye(3)[axis] * ((isovalue - first) / (second - first))[:, None])
    return np.concatenate(points)


def _cut(grid: Grid, isovalue: float, start: int, stop: int, axis: int) -> NDArray[np.bool_]:
    """Whether the surface cuts the edge from each sample of a slab (K, ny, nx) to the next one along `axis`."""
    nz = grid.values.shape[0]
    end = min(stop + 1, nz) if axis == 0 else stop
    above = grid.values[start:end] > isovalue
    cut = np.zeros((stop - start, *above.shape[1:]), dtype=bool)
    inner = tuple(slice(0, above.shape[a] - 1) if a == axis else slice(None) for a in range(3))
    outer = tuple(slice(1, None) if a == axis else slice(None) for a in range(3))
    cut[inner] = above[inner] != above[outer]
    if grid.holes is not None:
        holes = grid.holes[start:end]
        cut[inner] &= ~(holes[inner] | holes[outer])
    return cut


def _draw(shape: tuple[int, ...], weights: Weights, count: int, rng: np.random.Generator) -> NDArray[np.int64]:
    """Flat voxel indices (count,) drawn with replacement in proportion to `weights(start, stop)` of each slab."""
    slabs = list(_slabs(shape))
    totals = np.array([weights(*slab).sum() for slab in slabs])  # [S]
    if not totals.sum() > 0:
        return np.empty(0, dtype=np.int64)
    drawn = []
    for (start, stop), number in zip(slabs, rng.multinomial(count, totals / totals.sum()), strict=True):
        if number:
            cumulative = np.cumsum(weights(start, stop))  # [K]
            picks = np.searchsorted(cumulative, rng.random(number) * cumulative[-1], side="right")
            last = np.searchsorted(cumulative, cumulative[-1])  # a product may round up to the total
            drawn.append(np.minimum(picks, last) + start * shape[1] * shape[2])
    return np.concatenate(drawn).astype(np.int64)


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


def _slabs(shape: tuple[int, ...]) -> Iterator[tuple[int, int]]:
    """Ranges of z-slices of about SLAB_VOXELS voxels each."""
    step = max(1, SLAB_VOXELS // max(1, shape[1] * shape[2]))
    for start in range(0, shape[0], step):
        yield start, min(start + step, shape[0])
