"""The least of something that will do."""

from __future__ import annotations

from collections.abc import Callable


def least(low: int, high: int, will_do: Callable[[int], bool]) -> int:
    """The smallest number in low..high that will do, by halving; `high` is known to.

    Where a larger number may fail though a smaller one does not, some number that will do.
    """
    while low < high:
        middle = (low + high) // 2
        if will_do(middle):
            high = middle
        else:
            low = middle + 1
    return high
