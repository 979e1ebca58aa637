"""Coarse fields of a member: box averages on the finest lattice of at most 64³ samples, or the field itself where it has no more.

A coarse sample is the mean of the field, trilinear between its samples, over the box of one coarse cell around it.  At the ends
the box shrinks symmetrically to the first and last samples themselves, so that linear fields stay exact.  The weights are products
of one factor for each axis.  Of a field in blocks every rank weighs what it owns, and rank 0 adds up.
"""

from __future__ import annotations

from collections.abc import Mapping
from math import prod
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from catalogs.store.coarse import MOST_SAMPLES, CoarseField
from insitu.fields.summarize import FieldPart, slabs
from insitu.mpi.ranks import SINGLE, RankGroup

if TYPE_CHECKING:
    from scipy import sparse

AXIS = round(MOST_SAMPLES ** (1 / 3))  # samples up to which an axis keeps its own
ROUNDING = 1e-9

Shape = tuple[int, int, int]


def coarse_fields(parts: Mapping[str, FieldPart], ranks: RankGroup = SINGLE) -> dict[str, CoarseField]:
    """The coarse field of each of a member's fields, by name, on rank 0; those that would be all holes are left out."""
    fields = {name: coarsened(part, ranks) for name, part in parts.items()}
    return {name: field for name, field in fields.items() if field is not None}


def coarse_shape(shape: Shape, spacing: tuple[float, float, float]) -> Shape:
    """The finest lattice (z, y, x) of at most `MOST_SAMPLES` over the box of a field, its own where it has no more.

    An axis of at most 64 samples keeps them.  The others share the rest in cells as near to cubic as their own samples allow;
    `spacing` is (x, y, z).
    """
    if prod(shape) <= MOST_SAMPLES:
        return shape
    samples, most = np.array(shape), np.minimum(shape, AXIS)  # [3] each
    free = samples > AXIS
    lengths = (samples - 1) * np.array(spacing[::-1])

    def counts(cell: float) -> NDArray[np.int64]:
        across = np.floor(np.minimum(lengths / cell, samples - 1) + ROUNDING).astype(np.int64) + 1
        return np.where(free, np.clip(across, 2, samples), most)

    low, high = 0.0, float(lengths.max())  # cells that are too small, and large enough
    while high - low > ROUNDING * high:
        middle = (low + high) / 2.0
        low, high = (low, middle) if prod(counts(middle).tolist()) <= MOST_SAMPLES else (middle, high)
    z, y, x = counts(high).tolist()
    return z, y, x


def coarsened(part: FieldPart, ranks: RankGroup = SINGLE) -> CoarseField | None:
    """The coarse field, on rank 0, of the field of which each rank has a `part`; None elsewhere, and where all would be holes.

    A sample is the average over the known samples of its box, and a hole where they have less than half the weight.
    """
    whole = part.whole
    shape = coarse_shape(whole.shape, whole.spacing)
    weights = [axis_weights(n, m) for n, m in zip(whole.shape, shape, strict=True)]
    has_holes = any(ranks.gather(part.holes is not None))
    sums = _gathered(_weighed(part, weights, shape, ones=False), shape, ranks)
    shares = _gathered(_weighed(part, weights, shape, ones=True), shape, ranks) if has_holes else None
    if sums is None:
        return None
    values = sums
    if shares is not None:
        values = np.where(shares >= 0.5 - ROUNDING, sums / np.where(shares > 0.0, shares, 1.0), np.nan)
        if np.isnan(values).all():
            return None
    largest = np.finfo(np.float64).max
    values = np.clip(values, -largest, largest)  # rounding may reach infinity
    with np.errstate(over="ignore"):
        single = values.astype(np.float32)
    exact = np.array_equal(single, values, equal_nan=True)
    spacing = [s * (n - 1) / (m - 1) for s, n, m in zip(whole.spacing, whole.shape[::-1], shape[::-1], strict=True)]
    place = (spacing[0], spacing[1], spacing[2]), whole.origin
    return CoarseField(single if exact else values, *place, whole=shape == whole.shape)


def axis_weights(samples: int, coarse: int) -> sparse.csc_array:
    """The weights (coarse, samples) of an axis's samples in its coarse ones, each row's sum 1; unit weights for equal numbers."""
    from scipy import sparse  # not needed where nothing is rendered

    if samples == coarse:
        return sparse.csc_array(sparse.identity(samples))
    cell = (samples - 1) / (coarse - 1)
    middles = np.arange(coarse) * cell  # [M] in samples
    halves = np.minimum(cell / 2.0, np.minimum(middles, samples - 1 - middles).clip(0.0))
    reach = int(np.ceil(cell / 2.0)) + 1
    columns = np.rint(middles).astype(np.int64)[:, None] + np.arange(-reach, reach + 1)  # [M, 2 reach + 1]
    low, high = (middles - halves)[:, None] - columns, (middles + halves)[:, None] - columns
    wide = halves[:, None] > 0.0
    means = (_hat_integral(high) - _hat_integral(low)) / np.where(wide, high - low, 1.0)
    weights = np.where(wide, means, np.maximum(0.0, 1.0 - np.abs(low)))
    inside = (columns >= 0) & (columns < samples) & (weights > 0.0)
    rows = np.broadcast_to(np.arange(coarse)[:, None], columns.shape)
    return sparse.csc_array((weights[inside], (rows[inside], columns[inside])), shape=(coarse, samples))


def _hat_integral(at: NDArray[np.float64]) -> NDArray[np.float64]:
    """The integral up to `at` of a sample's share in linear interpolation, which falls from 1 at 0 to 0 at -1 and 1."""
    near = np.clip(at, -1.0, 1.0)
    return 0.5 + near - 0.5 * near * np.abs(near)


def _weighed(
    part: FieldPart, weights: list[sparse.csc_array], shape: Shape, *, ones: bool
) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """The weighed sums of a part's known samples, or with `ones` of ones in their place, and the first coarse sample (3,) of them.

    Works through the part in slabs, so that its extra memory does not grow with the field.
    """
    from scipy import sparse

    own = [w[:, a:b] for w, a, b in zip(weights, part.start.tolist(), part.stop.tolist(), strict=True)]
    rows = [np.unique(w.indices) for w in own]
    if not all(map(len, rows)):
        return np.zeros(3, dtype=np.int64), np.zeros((0, 0, 0))
    first = np.array([r[0] for r in rows])
    z, y, x = (sparse.csr_array(w)[r[0] : r[-1] + 1] for w, r in zip(own, rows, strict=True))
    sums, z = np.zeros((z.shape[0], y.shape[0] * x.shape[0])), sparse.csc_array(z)
    for start, stop in slabs(part.shape):
        window = part.window(start, stop)
        holes = None if part.holes is None else part.holes[window]
        slab = np.ones((stop - start, *part.shape[1:])) if ones else part.values[window].astype(np.float64)
        if holes is not None:
            slab[holes] = 0.0
        count, _, across = slab.shape
        along_y = y @ slab.transpose(1, 0, 2).reshape(-1, count * across)  # [Y, count * nx]
        along_x = x @ along_y.reshape(-1, across).T  # [X, Y * count]
        planes = along_x.reshape(x.shape[0], y.shape[0], count).transpose(2, 1, 0)  # [count, Y, X]
        sums += z[:, start:stop] @ planes.reshape(count, -1)
    return first, sums.reshape(z.shape[0], y.shape[0], x.shape[0])


def _gathered(
    own: tuple[NDArray[np.int64], NDArray[np.float64]], shape: Shape, ranks: RankGroup
) -> NDArray[np.float64] | None:
    """The sums of all ranks, on rank 0; None elsewhere."""
    first, sums = own
    places = ranks.gather((first, sums.shape))
    nothing = np.empty(0, dtype=np.uint8)
    arrived = ranks.send([sums.reshape(-1).view(np.uint8), *[nothing] * (ranks.size - 1)])
    if ranks.number:
        return None
    total = np.zeros(shape)
    for (start, size), data in zip(places, arrived, strict=True):
        box = tuple(slice(a, a + n) for a, n in zip(start.tolist(), size, strict=True))
        total[box] += data.view(np.float64).reshape(size)
    return total
