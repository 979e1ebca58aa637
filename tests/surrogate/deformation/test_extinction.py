"""Means of transfer functions under hat functions, against fine sums in numpy, and the kernel against its twin."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from catalogs.vocabulary.appearance import TransferFunction
from native import kernels
from surrogate.deformation.extinction import (
    MOST_OPAQUE,
    SAMPLES,
    differentiable_table,
    extinction_table,
    extinction_table_reference,
)

BASE = TransferFunction(
    ((-1.0, 0.1, 0.2, 0.9), (1.0, 0.9, 0.9, 0.2), (3.0, 0.9, 0.1, 0.1)), ((-1, 0), (0.4, 0.2), (2, 0.6), (3, 0.95)), 0.3
)
FUNCTIONS = {
    "base": BASE,
    "other": replace(BASE, opacity_points=((-1, 0.5), (0, 0.05), (2.5, 0.3), (3, 0))),
    "clear": replace(BASE, opacity_points=((-1, 0), (3, 0))),
    "opaque": replace(BASE, opacity_points=((-1, 1), (3, 1))),
    "narrower": TransferFunction(((0.2, 0, 1, 0), (0.5, 1, 0, 1)), ((0.3, 0.4), (0.31, 0.7)), 0.3),
    "wider": TransferFunction(((-50, 0, 1, 0), (90, 1, 0, 1)), ((-70, 0.1), (40, 0.9)), 0.3),
    "below": TransferFunction(((-9, 0, 1, 0), (-8, 1, 0, 1)), ((-9, 0.4), (-7, 0.7)), 0.3),
}
VALUES = {
    "even": np.linspace(-1, 3, 24),
    "uneven": np.array([-1.0, -0.9, 0.3, 0.35, 1.4, 2.6, 3.0]),
    "two": np.array([-1.0, 3.0]),
}

every_function = pytest.mark.parametrize("function", FUNCTIONS.values(), ids=list(FUNCTIONS))
every_values = pytest.mark.parametrize("values", VALUES.values(), ids=list(VALUES))


@pytest.mark.parametrize("name", ["base", "other", "clear", "wider", "below"])  # that don't jump between two samples
@every_values
def test_they_are_means_under_hat_functions(name: str, values: NDArray[np.float64]) -> None:
    function = FUNCTIONS[name]
    fine = np.linspace(-1, 3, 400_001)  # [F]
    hats = np.stack([np.interp(fine, values, row) for row in np.eye(len(values))])  # [B, F]
    tau = -np.log1p(-np.minimum(function.opacities(fine), 0.999))
    columns = np.stack([tau, *(tau * function.colors(fine).T)], axis=1)  # [F, 4]
    expected = (hats @ columns) / hats.sum(axis=1, keepdims=True)
    np.testing.assert_allclose(extinction_table_reference(function, values), expected, rtol=2e-3, atol=2e-3)


@every_function
@every_values
def test_the_kernel_is_the_definition(function: TransferFunction, values: NDArray[np.float64]) -> None:
    np.testing.assert_allclose(
        extinction_table(function, values), extinction_table_reference(function, values), rtol=1e-13, atol=1e-15
    )


numbers = st.floats(-5.0, 5.0, allow_subnormal=False)
places = st.lists(numbers, min_size=2, max_size=9, unique_by=lambda x: round(x, 3)).map(sorted)


@given(places, places, places, st.randoms(use_true_random=False))
def test_so_it_is_for_any_function(values, color_places, opacity_places, random) -> None:
    color_points = tuple((place, *(random.random() for _ in range(3))) for place in color_places)
    opacity_points = tuple((place, random.choice([0.0, 1.0, random.random()])) for place in opacity_places)
    function = TransferFunction(color_points, opacity_points, 1.0)
    found, expected = (means(function, np.array(values)) for means in (extinction_table, extinction_table_reference))
    np.testing.assert_allclose(found, expected, rtol=1e-11, atol=1e-13)


def test_places_that_are_control_points_have_their_values() -> None:
    step = 2.0 / SAMPLES  # the samples between -1 and 1 lie at -1 + (k + 1/2) step
    points = tuple((-1.0 + (k + 0.5) * step, (k % 3) / 4.0) for k in range(SAMPLES))
    function = TransferFunction(((-1.0, 1, 1, 1), (1.0, 1, 1, 1)), points, 1.0)
    tau = -np.log1p(-np.array([opacity for _, opacity in points]))  # [S]
    inside = (np.arange(SAMPLES) + 0.5) / SAMPLES
    expected = 2.0 * np.array([(1.0 - inside) @ tau, inside @ tau]) / SAMPLES
    np.testing.assert_allclose(
        extinction_table(function, np.array([-1.0, 1.0])), expected[:, None].repeat(4, axis=1), rtol=1e-14
    )


def test_wrong_shapes_are_named() -> None:
    values, colors, opacities = np.zeros(3), np.zeros((2, 4)), np.zeros((2, 2))
    with pytest.raises(ValueError, match=r"values must have shape \[2 or more\]"):
        kernels.extinction_table(values[:1], colors, opacities, SAMPLES, MOST_OPAQUE)
    with pytest.raises(ValueError, match=r"color_points must have shape \[1 or more, 4\]"):
        kernels.extinction_table(values, colors[:, :3], opacities, SAMPLES, MOST_OPAQUE)
    with pytest.raises(ValueError, match=r"opacity_points must have shape \[1 or more, 2\]"):
        kernels.extinction_table(values, colors, opacities[:0], SAMPLES, MOST_OPAQUE)
    with pytest.raises(ValueError, match="samples must lie in 1 to 65536, got 0"):
        kernels.extinction_table(values, colors, opacities, 0, MOST_OPAQUE)
    with pytest.raises(ValueError, match="most_opaque must lie in 0 to 1, and not be 1"):
        kernels.extinction_table(values, colors, opacities, SAMPLES, 1.0)


@every_function
@every_values
def test_the_differentiable_table_is_that_of_the_twin(function: TransferFunction, values: NDArray[np.float64]) -> None:
    points = torch.tensor(function.opacity_points, dtype=torch.float64)
    table = differentiable_table(function, points, values)
    np.testing.assert_allclose(table.numpy(), extinction_table_reference(function, values), rtol=1e-12, atol=1e-14)


@pytest.mark.parametrize("name", ["base", "other", "narrower", "wider"])
def test_its_gradient_by_control_points_is_their_finite_difference(name: str) -> None:
    function, values = FUNCTIONS[name], VALUES["uneven"]
    points = torch.tensor(function.opacity_points, dtype=torch.float64, requires_grad=True)
    weights = torch.linspace(-1.0, 2.0, 4 * len(values), dtype=torch.float64).reshape(-1, 4)
    (differentiable_table(function, points, values) * weights).sum().backward()
    assert points.grad is not None
    for k, coordinate in np.ndindex(*points.shape):
        sums = []
        for step in (1e-7, -1e-7):
            moved = np.array(function.opacity_points)
            moved[k, coordinate] += step
            if not 0.0 <= moved[k, 1] <= 1.0:
                break  # an end of the range
            table = extinction_table_reference(replace(function, opacity_points=moved), values)
            sums.append(float((table * weights.numpy()).sum()))
        if len(sums) == 2:
            np.testing.assert_allclose(
                float(points.grad[k, coordinate]), (sums[0] - sums[1]) / 2e-7, atol=1e-5, rtol=1e-4
            )
