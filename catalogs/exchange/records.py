"""Values in the JSON records of other programs, checked."""

from __future__ import annotations

from itertools import chain
from typing import Any

import numpy as np
from numpy.typing import NDArray


class ExchangeError(ValueError):
    """A foreign data set can't be imported; the message names the file, the frame and the remedy."""


def numbers(value: Any, shape: tuple[int, ...], place: str) -> NDArray[np.float64]:
    """Finite JSON numbers nested like `shape`, as float64."""
    items = [value]
    for length in shape:
        if not all(isinstance(item, list) and len(item) == length for item in items):
            raise ExchangeError(f"{place} must hold {'x'.join(map(str, shape))} numbers, got {json_text(value)}")
        items = list(chain.from_iterable(items))
    for item in items:
        if isinstance(item, bool) or not isinstance(item, int | float) or not abs(item) < 1e300:
            raise ExchangeError(f"{place}: {json_text(item)} is not a finite number")
    return np.array(value, dtype=np.float64)


def json_text(value: Any) -> str:
    """A value in an error, cut short."""
    text = repr(value)
    return text if len(text) <= 60 else f"{text[:57]}..."
