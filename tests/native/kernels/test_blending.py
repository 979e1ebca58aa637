"""Values that Gaussians carry, by the compiled module: every instruction set, and refusals.

`tests/surrogate/training/test_value_loss.py` holds them against the definition.
"""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from native import kernels

Arrays = list[NDArray[np.float32]]


def carriers(count: int) -> Arrays:
    random = np.random.default_rng(0)
    arrays = (
        random.uniform(-1.0, 1.0, (count, 3)),
        np.exp(random.uniform(-5.0, -1.0, (count, 3))),
        random.normal(size=(count, 4)),
        random.random(count),
        random.random(count),
    )
    return [array.astype(np.float32) for array in arrays]


def places(count: int) -> NDArray[np.float32]:
    return np.random.default_rng(1).uniform(-1.2, 1.2, (count, 3)).astype(np.float32)


@pytest.mark.parametrize("count", [1, 3, 4, 17, 900])
@pytest.mark.parametrize("gaussians", [1, 7, 16, 1001])
def test_every_instruction_set_finds_the_same_pairs(gaussians: int, count: int) -> None:
    made = {name: kernels.blend(carriers(gaussians), places(count), 3.0, name) for name in kernels.instruction_sets()}
    first, *others = made.values()
    upstream = np.linspace(-1.0, 1.0, count, dtype=np.float32)
    gradients = kernels.blend_gradients(first, upstream, True)
    for other in others:
        assert other.pairs == first.pairs
        np.testing.assert_allclose(other.values, first.values, rtol=1e-5)
        for mine, wanted in zip(kernels.blend_gradients(other, upstream, True), gradients, strict=True):
            np.testing.assert_allclose(mine, wanted, rtol=1e-4, atol=1e-5 * np.abs(wanted).max() + 1e-9)


def test_the_same_input_gives_the_same_bits_and_fewer_gradients_the_same_ones() -> None:
    first, again = (kernels.blend(carriers(500), places(100), 3.0) for _ in range(2))
    np.testing.assert_array_equal(first.values, again.values)
    upstream = np.ones(100, np.float32)
    whole, some = kernels.blend_gradients(first, upstream, True), kernels.blend_gradients(again, upstream, False)
    assert [array.shape for array in whole] == [(500, 3), (500, 3), (500, 4), (500,), (500,)]
    for mine, wanted in zip(some, whole[3:], strict=True):
        np.testing.assert_array_equal(mine, wanted)


@pytest.mark.parametrize("scale", [0.0, 1e-38, 1e38])
def test_gaussians_without_extent_or_without_end_do_no_harm(scale: float) -> None:
    given = carriers(50)
    given[1][10] = scale
    given[0][11] = 3e38
    found = kernels.blend(given, np.concatenate([places(20), given[0][10:11]]), 3.0)
    assert np.isfinite(found.values[:20]).any()
    assert all(np.isfinite(array).all() for array in kernels.blend_gradients(found, np.ones(21, np.float32), False))


@pytest.mark.parametrize(
    ("index", "array", "message"),
    [
        (0, np.zeros((5, 2)), r"means must have shape \[N, 3\]"),
        (1, np.zeros((4, 3)), r"scales must have shape \[5, 3\]"),
        (2, np.zeros((5, 3)), r"quats must have shape \[5, 4\]"),
        (3, np.zeros((5, 1)), r"weights must have shape \[5\]"),
        (4, np.zeros(6), r"values must have shape \[5\]"),
    ],
)
def test_shapes_that_do_not_fit_are_refused(index: int, array: NDArray, message: str) -> None:
    given = carriers(5)
    given[index] = array.astype(np.float32)
    with pytest.raises(ValueError, match=message):
        kernels.blend(given, places(3), 3.0)


@pytest.mark.parametrize("reach", [0.0, -1.0, np.nan, np.inf])
def test_a_reach_that_is_none_is_refused(reach: float) -> None:
    with pytest.raises(ValueError, match="reach must be positive"):
        kernels.blend(carriers(5), places(3), reach)


def test_places_and_gradients_of_other_shapes_are_refused() -> None:
    with pytest.raises(ValueError, match=r"places must have shape \[Q, 3\]"):
        kernels.blend(carriers(5), places(3)[:, :2].copy(), 3.0)
    with pytest.raises(ValueError, match=r"gradient must have shape \[3\]"):
        kernels.blend_gradients(kernels.blend(carriers(5), places(3), 3.0), np.ones(4, np.float32), True)
