"""Each predictor's weights against what it must reproduce."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.interpolate import LinearNDInterpolator, RBFInterpolator
from scipy.spatial import ConvexHull

from surrogate.evaluation.trivial.interpolation import (
    crossed,
    fixed_rules,
    inverse_distance,
    linear,
    mean_image,
    nearest_member,
    radial,
    ridge,
)

random = np.random.default_rng(0)


def test_mean_and_nearest() -> None:
    known, wanted = random.random((5, 2)), random.random((3, 2))
    assert np.allclose(mean_image(known, wanted), 0.2)
    distances = np.linalg.norm(wanted[:, None] - known[None], axis=2)
    assert (nearest_member(known, wanted).argmax(axis=1) == distances.argmin(axis=1)).all()


def test_linear_in_one_dimension_is_interpolation_between_neighbours_and_constant_outside() -> None:
    known = np.array([[3.0], [1.0], [2.0]])
    weights = linear(known, np.array([[1.25], [0.0], [9.0]]))
    assert np.allclose(weights, [[0.0, 0.75, 0.25], [0.0, 1.0, 0.0], [1.0, 0.0, 0.0]])


@pytest.mark.parametrize("dimensions", [2, 3])
def test_linear_in_more_dimensions_is_scipy(dimensions: int) -> None:
    known, values = random.random((30, dimensions)), random.random(30)
    wanted = random.random((40, dimensions)) * 0.4 + 0.3
    theirs = LinearNDInterpolator(known, values)(wanted)
    inside = np.isfinite(theirs)
    assert inside.sum() > 10
    assert np.allclose((linear(known, wanted) @ values)[inside], theirs[inside])


@pytest.mark.parametrize("dimensions", [2, 3])
def test_linear_on_the_hull_counts_as_inside(dimensions: int) -> None:
    known = random.uniform(-1, 1, (60, dimensions))
    edges = np.vstack([simplex[[0, 1]] for simplex in ConvexHull(known).simplices])  # [2 E]
    for first, second in edges.reshape(-1, 2):
        weights = linear(known, (known[[first]] + known[[second]]) / 2)[0]
        assert np.allclose(weights @ known, (known[first] + known[second]) / 2)
        assert weights[[first, second]].sum() == pytest.approx(1.0, abs=1e-6)


@pytest.mark.parametrize("dimensions", [2, 3])
def test_linear_through_members_in_a_line_takes_the_nearest(dimensions: int) -> None:
    known = np.outer(np.linspace(-1, 1, 6), np.ones(dimensions))
    wanted = random.uniform(-1, 1, (20, dimensions))
    assert (linear(known, wanted) == nearest_member(known, wanted)).all()


def test_linear_without_a_volume_takes_the_nearest() -> None:
    known = np.array([[0.0, 0.0], [1.0, 1.0]])
    assert np.allclose(linear(known, np.array([[0.9, 0.8]])), [[0.0, 1.0]])


@pytest.mark.parametrize("degree", [1, 2])
def test_ridge_reproduces_polynomials(degree: int) -> None:
    known, wanted = random.uniform(-1, 1, (40, 3)), random.uniform(-1, 1, (10, 3))

    def polynomial(p: np.ndarray) -> np.ndarray:
        return 1.0 + p[:, 0] - 2.0 * p[:, 2] + (p[:, 0] * p[:, 1] if degree == 2 else 0.0)

    weights = ridge(known, wanted, degree=degree, penalty=1e-10)
    assert np.allclose(weights @ polynomial(known), polynomial(wanted), atol=1e-5)


def test_radial_interpolates_its_members_as_scipy_does() -> None:
    known, values, wanted = random.random((12, 2)), random.random(12), random.random((5, 2))
    weights = radial(known, wanted, length=0.5, penalty=1e-6)
    centered = values - values.mean()
    theirs = RBFInterpolator(
        known, centered, kernel="gaussian", epsilon=1.0 / (0.5 * np.sqrt(2.0)), smoothing=1e-6, degree=-1
    )(wanted)
    assert np.allclose(weights @ values, theirs + values.mean(), atol=1e-4)
    assert np.allclose(weights.sum(axis=1), 1.0)


def test_inverse_distances_are_those_of_the_four_nearest() -> None:
    random = np.random.default_rng(3)
    known, wanted = random.random((9, 4)), random.random((5, 4))
    weights = inverse_distance(known, wanted)
    for place, row in zip(wanted, weights, strict=True):
        distances = [float(np.sqrt(sum((place - other) ** 2))) for other in known]
        near = sorted(range(9), key=lambda i, d=distances: d[i])[:4]
        total = sum(1 / distances[i] for i in near)
        expected = [1 / distances[i] / total if i in near else 0.0 for i in range(9)]
        np.testing.assert_allclose(row, expected, rtol=1e-12)


def test_inverse_distances_meet_what_they_know_and_need_no_four() -> None:
    known = np.array([[0.0], [1.0], [3.0]])
    weights = inverse_distance(known, np.array([[1.0], [2.0]]))
    np.testing.assert_allclose(weights, [[0, 1, 0], [0.2, 0.4, 0.4]])
    np.testing.assert_array_equal(inverse_distance(known[:1], np.array([[7.0]])), [[1.0]])


def test_interpolation_is_offered_up_to_three_parameters() -> None:
    assert "linear interpolation" in fixed_rules(3)
    assert "linear interpolation" not in fixed_rules(6)


def test_crossed_weights_are_products_over_a_grid() -> None:
    places, settings = np.array([[0.0, 0.0], [1.0, 0.5]]), np.array([[0.0], [1.0], [4.0]])
    known = np.array([[*place, *setting] for place in places for setting in settings])  # [6, 3]
    wanted = np.array([[0.9, 0.4, 2.0], [0.0, 0.0, 0.0]])
    found = crossed(nearest_member, linear, 2)(known, wanted)
    np.testing.assert_allclose(found, [[0, 0, 0, 0, 2 / 3, 1 / 3], [1, 0, 0, 0, 0, 0]], atol=1e-12)
