"""Gaussian processes agree with scikit-learn, finite differences and fits without a member."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from surrogate.emulation import processes
from surrogate.emulation.processes import Processes
from tests.support.ensembles_of_fields import some_points


def some_processes(count: int = 24, coefficients: int = 5) -> Processes:
    points = some_points(count, 3)
    waves = np.stack([np.sin((1 + k) * points[:, 0] + points[:, 1] * k) / (1 + k) for k in range(coefficients)], 1)
    fitted = Processes.fit(points, waves - waves.mean(0))
    return replace(fitted, noises=np.maximum(fitted.noises, 1e-5))  # less is a matter of rounding


def test_means_and_deviations_are_those_of_scikit_learn() -> None:
    from sklearn.gaussian_process import GaussianProcessRegressor
    from sklearn.gaussian_process.kernels import ConstantKernel, Matern

    fitted, points = some_processes(), some_points(7, 3, seed=9)
    means, deviations = fitted.predict(points)
    for k, group in enumerate(fitted.groups):
        kernel = ConstantKernel(fitted.variances[k]) * Matern(fitted.lengths[group], nu=2.5)
        alpha = fitted.noises[group] * fitted.variances[k]
        other = GaussianProcessRegressor(kernel, alpha=alpha, optimizer=None)
        expected, spread = other.fit(fitted.points, fitted.coefficients[:, k]).predict(points, return_std=True)
        scale = np.sqrt(fitted.variances[k])
        np.testing.assert_allclose(means[:, k], expected, rtol=0, atol=1e-6 * scale)
        np.testing.assert_allclose(deviations[:, k], spread, rtol=1e-3, atol=1e-5 * scale)


def test_the_likelihood_has_the_derivatives_of_finite_differences() -> None:
    fitted = some_processes()
    squares, shares = processes._squares(fitted.points, fitted.points), np.array([1.0, 0.5, 0.3, 0.1, 0.05])
    at = np.array([0.5, 0.1, 1.0, -4.0])

    def value(logarithms: np.ndarray) -> float:
        return processes._unlikelihood(logarithms, squares, fitted.coefficients, shares)[0]

    _, gradient = processes._unlikelihood(at, squares, fitted.coefficients, shares)
    numeric = [(value(at + step) - value(at - step)) / 2e-5 for step in 1e-5 * np.eye(4)]
    np.testing.assert_allclose(gradient, numeric, rtol=1e-6)


def test_means_have_the_derivatives_of_finite_differences() -> None:
    fitted, point = some_processes(), np.array([0.2, -0.4, 0.7])
    steps = 1e-5 * np.eye(3)
    numeric = [
        (fitted.predict((point + s)[None])[0][0] - fitted.predict((point - s)[None])[0][0]) / 2e-5 for s in steps
    ]
    np.testing.assert_allclose(fitted.derivative(point), numeric, rtol=1e-5, atol=1e-6)


def test_leave_one_out_errors_are_those_of_processes_without_the_member() -> None:
    fitted = some_processes()
    left_out = fitted.left_out()
    for member in (0, 7):
        kept = np.arange(len(fitted.points)) != member
        without = Processes(
            fitted.points[kept], fitted.coefficients[kept], fitted.lengths, fitted.noises, fitted.groups
        )
        means, _ = without.predict(fitted.points[[member]])
        np.testing.assert_allclose(left_out[member], fitted.coefficients[member] - means[0], rtol=1e-5, atol=1e-9)
