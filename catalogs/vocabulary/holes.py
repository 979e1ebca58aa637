"""Samples of a field without a value."""

from __future__ import annotations

from itertools import product
from typing import Any

import numpy as np
from numpy.typing import NDArray

NEIGHBOURS = sorted(  # offsets (z, y, x) to the 26 samples around one, nearest first
    (offset for offset in product((-1, 0, 1), repeat=3) if any(offset)),
    key=lambda offset: (sum(map(abs, offset)), offset[::-1]),
)


def continued(values: NDArray[Any], holes: NDArray[np.bool_]) -> NDArray[Any]:
    """A copy of `values`, the `holes` filled each by the nearest of the 26 samples around that has a value.

    Deeper inside a hole is some value of the field.

    The distance transform that would fill them all takes ten times the memory.
    """
    filled = np.array(values, order="C")
    filled[holes] = filled.reshape(-1)[np.argmin(holes)]
    empty = holes.copy()
    for offset in NEIGHBOURS:
        here = tuple(slice(max(0, -o), n - max(0, o)) for o, n in zip(offset, values.shape, strict=True))
        there = tuple(slice(max(0, o), n - max(0, -o)) for o, n in zip(offset, values.shape, strict=True))
        fillable = empty[here] & ~holes[there]
        filled[here][fillable] = filled[there][fillable]
        empty[here] &= holes[there]
    return filled
