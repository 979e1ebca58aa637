"""Points far apart, the first one first."""

import numpy as np
import pytest

from catalogs.vocabulary.farthest import farthest_points


@pytest.mark.parametrize(
    ("points", "count", "first", "taken"),
    [
        ([[0.0], [1.0], [5.0], [3.0]], 3, 0, [0, 2, 3]),
        ([[0.0], [1.0], [5.0], [3.0]], 9, 2, [2, 0, 3, 1]),
        ([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]], 2, 0, [0, 1]),  # the lowest of equals
        ([[7.0]], 3, 0, [0]),
    ],
)
def test_each_next_one_is_the_farthest_from_those_taken(
    points: list[list[float]], count: int, first: int, taken: list[int]
) -> None:
    assert farthest_points(np.array(points), count, first) == taken
