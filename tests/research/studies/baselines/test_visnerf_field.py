from __future__ import annotations

import math

import numpy as np
import pytest
import torch

from research.studies.baselines.visnerf import (
    SIZES,
)
from research.studies.baselines.visnerf_field import (
    Quantity,
    ViSNeRFArchitecture,
    ViSNeRFField,
    encoded,
    grid_of,
    variation,
    vector_lengths,
)
from tests.research.support.visnerf_formula import (
    QUANTITIES,
    UNEVEN,
    expected_components,
    expected_outputs,
    field_of,
    in_float64,
)


@pytest.mark.parametrize(
    ("sides", "grid"),
    [((0.36, 0.36, 0.36), (128, 128, 128)), ((4.0, 2.0, 2.0), (203, 101, 101)), ((1.0, 1.0, 1e-3), (1279, 1279, 2))],
)
def test_voxels_are_cubes(sides: tuple[float, ...], grid: tuple[int, ...]) -> None:
    low = torch.tensor([-0.18, 3.0, 0.0])
    high = low + torch.tensor(sides)
    if sides[0] == 0.36:
        low, high = torch.full((3,), -0.18), torch.full((3,), 0.18)
    found = grid_of(torch.stack([low, high]), SIZES["official"].voxels)
    assert found == pytest.approx(grid, rel=0.05)
    assert found[2] == grid[2]


def test_vectors_have_an_entry_for_each_value_but_not_many() -> None:
    random = np.random.default_rng(0)
    columns = [np.zeros(60), np.arange(60) % 2, np.arange(60) % 7, np.arange(60) % 16, random.uniform(-1, 1, 60)]
    assert vector_lengths(torch.from_numpy(np.stack(columns, axis=1)).float()) == (3, 3, 7, 16, 16)
    assert vector_lengths(torch.zeros(5, 0)) == ()


@pytest.mark.parametrize("quantity", QUANTITIES)
def test_components_are_sums_of_planes_times_lines(quantity: Quantity) -> None:
    """With sides of different lengths, so that no two axes can be confused."""
    field = field_of(UNEVEN)
    points = np.random.default_rng(1).uniform(-1.0, 1.0, (20, 3))
    points[:4] = [[-1, -1, -1], [1, 1, 1], [1, -1, 0], [-1, 1, 1]]
    expected = np.stack([expected_components(in_float64(field), quantity, point) for point in points])
    found = field.components(quantity, torch.from_numpy(points).float())
    np.testing.assert_allclose(found.numpy(), expected, atol=2e-5)


@pytest.mark.parametrize("quantity", QUANTITIES)
def test_parameters_read_their_vectors_from_end_to_end(quantity: Quantity) -> None:
    field = field_of(UNEVEN)
    first, second = (in_float64(field)[f"{quantity}.vector_{j}"][..., 0] for j in (0, 1))  # [4, 3], [4, 6]
    asked = torch.tensor([[-1.0, -1.0], [1.0, 1.0], [0.0, -0.6], [0.5, 0.0], [-1.4, 1.4]])
    expected = [
        np.append(first[:, 0], second[:, 0]),
        np.append(first[:, 2], second[:, 5]),
        np.append(first[:, 1], second[:, 1]),
        np.append((first[:, 1] + first[:, 2]) / 2, (second[:, 2] + second[:, 3]) / 2),
        np.append(first[:, 0], second[:, 5]),
    ]
    np.testing.assert_allclose(field.vectors_at(quantity, asked).numpy(), expected, atol=1e-5)


def test_without_parameters_there_are_no_vectors() -> None:
    field = field_of(ViSNeRFArchitecture((4, 4, 4), ()))
    assert field.vectors_at("density", torch.zeros(7, 0)).shape == (7, 0)
    assert field.densities(torch.zeros(7, 3), torch.zeros(7, 0)).shape == (7,)


def test_values_are_encoded_by_sines_and_cosines_without_pi() -> None:
    found = encoded(torch.tensor([[0.3, -0.7]]))[0]
    sines = [math.sin(v) for v in (0.3, 0.6, -0.7, -1.4)]
    np.testing.assert_allclose(found, sines + [math.cos(v) for v in (0.3, 0.6, -0.7, -1.4)], atol=1e-6)


def test_densities_and_colours_are_those_of_the_formula() -> None:
    field, random = field_of(UNEVEN, spread=3.0), np.random.default_rng(2)
    points, parameters = random.uniform(-1, 1, (12, 3)), random.uniform(-1, 1, (12, 2))
    directions = random.normal(size=(12, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    rows = list(zip(points, parameters, directions, strict=True))
    at, ways, asked = (torch.from_numpy(values).float() for values in (points, directions, parameters))

    logits = np.array([expected_outputs(field, "density", *row)[0] for row in rows])
    densities = field.densities(at, field.vectors_at("density", asked))
    np.testing.assert_allclose(densities, np.log1p(np.exp(logits - 10.0)), rtol=1e-3)
    assert np.ptp(logits) > 1.0

    logits = np.array([expected_outputs(field, "color", *row) for row in rows])
    colors = field.colors(at, field.vectors_at("color", asked), ways)
    np.testing.assert_allclose(colors, 1.0 / (1.0 + np.exp(-logits)), atol=1e-4)
    assert np.ptp(logits) > 1.0


def test_it_begins_almost_empty() -> None:
    first = ViSNeRFArchitecture((40, 40, 40), (3,)).initial(np.random.default_rng(0))
    for quantity in QUANTITIES:
        assert (first[f"{quantity}.vector_0"] == 0.1).all()
        assert (first[f"{quantity}.layer_3.biases"] == 0.0).all()
        assert float(first[f"{quantity}.plane_xz"].std()) == pytest.approx(0.1, rel=0.02)
        assert float(first[f"{quantity}.line_y"].std()) == pytest.approx(0.1, rel=0.1)
        bound = 1.0 / math.sqrt(150.0)
        assert float(first[f"{quantity}.layer_1.weights"].abs().max()) == pytest.approx(bound, rel=1e-3)
    field = ViSNeRFField(first, ViSNeRFArchitecture((40, 40, 40), (3,)))
    points = torch.rand(200, 3, generator=torch.Generator().manual_seed(0)) * 2.0 - 1.0
    densities = field.densities(points, field.vectors_at("density", torch.zeros(200, 1)))
    assert float(densities.max()) < 2.0 * math.log1p(math.exp(-10.0))


def test_total_variation_is_that_of_neighbours() -> None:
    grid = np.random.default_rng(0).normal(size=(3, 4, 5))
    across = [(grid[c, i, j + 1] - grid[c, i, j]) ** 2 for c in range(3) for i in range(4) for j in range(4)]
    down = [(grid[c, i + 1, j] - grid[c, i, j]) ** 2 for c in range(3) for i in range(3) for j in range(5)]
    assert float(variation(torch.from_numpy(grid))) == pytest.approx(2.0 * (np.mean(across) + np.mean(down)))
    narrow = torch.from_numpy(grid[:, :, :1])
    assert float(variation(narrow)) == pytest.approx(2.0 * np.mean(np.diff(grid[:, :, 0], axis=1) ** 2))
    assert float(variation(narrow[:, :1])) == 0.0
