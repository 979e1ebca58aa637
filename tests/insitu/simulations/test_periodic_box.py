"""The plain solver against exact solutions of the Navier-Stokes equations and the invariants of the Euler equations."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from numpy.typing import NDArray

from tests.support.periodic_box import PeriodicBox

VISCOSITY = 0.05
DRIFT = (0.7, -0.4)


def grid(n: int, dimension: int) -> list[NDArray[np.float64]]:
    """Coordinates (x, y[, z]) of the points, each of a shape [z,] y, x to broadcast."""
    points = 2.0 * np.pi * np.arange(n) / n
    return list(reversed(np.meshgrid(*[points] * dimension, indexing="ij", sparse=True)))


def planar_vortex(n: int, time: float, drift: tuple[float, float] = (0.0, 0.0)) -> NDArray[np.float64]:
    """The exact decaying Taylor-Green solution in two dimensions, carried along by a uniform flow (2, y, x)."""
    x, y = grid(n, 2)
    x, y = x - drift[0] * time, y - drift[1] * time
    fading = np.exp(-2.0 * VISCOSITY * time)
    return np.stack([drift[0] + fading * np.sin(x) * np.cos(y), drift[1] - fading * np.cos(x) * np.sin(y)])


def abc_flow(n: int, a: float = 1.0, b: float = 0.8, c: float = 0.6) -> NDArray[np.float64]:
    """Arnold-Beltrami-Childress: equals its own vorticity, so advection only makes pressure (3, z, y, x)."""
    x, y, z = grid(n, 3)
    components = (a * np.sin(z) + c * np.cos(y), b * np.sin(x) + a * np.cos(z), c * np.sin(y) + b * np.cos(x))
    return np.stack([np.broadcast_to(component, (n, n, n)) for component in components])


def random_velocity(n: int, seed: int = 0) -> NDArray[np.float64]:
    """Random waves of |k| <= 3 with helicity, not free of divergence (3, z, y, x)."""
    rng = np.random.default_rng(seed)
    x, y, z = grid(n, 3)
    velocity = np.zeros((3, n, n, n))
    for k in rng.integers(-3, 4, size=(12, 3)):
        phase = k[0] * x + k[1] * y + k[2] * z + rng.uniform(0.0, 2.0 * np.pi, (3, 1, 1, 1))
        velocity += rng.normal(size=(3, 1, 1, 1)) * np.cos(phase)
    return 0.3 * velocity + 0.3 * abc_flow(n)


def test_planar_taylor_green_decays_exactly():
    box = PeriodicBox(16, VISCOSITY, dimension=2, dtype="float64")
    state = box.advance(box.initial(planar_vortex(16, 0.0)), until=3.0)
    assert np.abs(box.velocity(state) - planar_vortex(16, 3.0)).max() < 1e-13
    assert box.kinetic_energy(state) == pytest.approx(0.25 * np.exp(-4.0 * VISCOSITY * 3.0), rel=1e-12)
    assert box.enstrophy(state) == pytest.approx(0.5 * np.exp(-4.0 * VISCOSITY * 3.0), rel=1e-12)


def test_planar_taylor_green_in_a_uniform_stream_converges_with_the_step():
    errors = []
    for cfl in (1.0, 0.5, 0.25):
        box = PeriodicBox(16, VISCOSITY, dimension=2, dtype="float64", cfl=cfl)
        state = box.advance(box.initial(planar_vortex(16, 0.0, DRIFT)), until=2.0)
        errors.append(np.abs(box.velocity(state) - planar_vortex(16, 2.0, DRIFT)).max())
    orders = [np.log2(coarse / fine) for coarse, fine in itertools.pairwise(errors)]
    assert errors[-1] < 1e-5
    assert orders == pytest.approx([4.0, 4.0], abs=0.3), f"errors {errors}"


def test_beltrami_flow_decays_exactly():
    box = PeriodicBox(12, VISCOSITY, dtype="float64")
    state = box.advance(box.initial(abc_flow(12)), until=2.0)
    assert np.abs(box.velocity(state) - abc_flow(12) * np.exp(-2.0 * VISCOSITY)).max() < 1e-13
    assert np.abs(box.vorticity(state) - box.velocity(state)).max() < 1e-12
    assert box.helicity(state) == pytest.approx(2.0 * np.exp(-4.0 * VISCOSITY), rel=1e-12)


def test_without_viscosity_energy_and_helicity_are_conserved_to_the_order_of_the_step():
    energies, helicities = [], []
    for cfl in (0.8, 0.4, 0.2):
        box = PeriodicBox(16, 0.0, dtype="float64", cfl=cfl)
        start = box.initial(random_velocity(16))
        end = box.advance(start, until=1.0)
        energies.append(abs(box.kinetic_energy(end) / box.kinetic_energy(start) - 1.0))
        helicities.append(abs(box.helicity(end) / box.helicity(start) - 1.0))
        assert np.abs(box.velocity(end) - box.velocity(start)).max() > 0.3, "the flow must have changed"
    assert energies[-1] < 1e-6
    assert helicities[-1] < 1e-5
    assert np.log2(energies[-2] / energies[-1]) > 3.7, f"energy errors {energies}"
    assert np.log2(helicities[-2] / helicities[-1]) > 3.7, f"helicity errors {helicities}"


def test_the_flow_stays_free_of_divergence():
    box = PeriodicBox(16, 0.01, dtype="float64")
    state = box.advance(box.initial(random_velocity(16)), until=1.0)
    gradient = box.gradient(state)
    assert np.abs(np.einsum("ii...->...", gradient)).max() < 1e-12 * np.abs(gradient).max()


def test_the_initial_velocity_loses_its_gradient_part_only():
    x, y, _ = grid(12, 3)
    gradient = np.stack(
        [np.broadcast_to(part, (12, 12, 12)) for part in (np.cos(x) * np.sin(y), np.sin(x) * np.cos(y), 0.0)]
    )
    box = PeriodicBox(12, 0.0, dtype="float64")
    assert np.abs(box.velocity(box.initial(abc_flow(12) + 3.0 * gradient)) - abc_flow(12)).max() < 1e-13


def test_gradient_and_q_of_a_known_field():
    x, y = grid(16, 2)
    box = PeriodicBox(16, 0.0, dimension=2, dtype="float64")
    velocity = np.stack([np.sin(2.0 * x) * np.cos(3.0 * y) * 3.0, -np.cos(2.0 * x) * np.sin(3.0 * y) * 2.0])
    state = box.initial(velocity)
    stretching = 6.0 * np.cos(2.0 * x) * np.cos(3.0 * y)
    du_dy, dv_dx = -9.0 * np.sin(2.0 * x) * np.sin(3.0 * y), 4.0 * np.sin(2.0 * x) * np.sin(3.0 * y)
    expected = np.stack([np.stack([stretching, dv_dx]), np.stack([du_dy, -stretching])])
    assert np.abs(box.gradient(state) - expected).max() < 1e-12
    assert np.abs(box.q_criterion(state) - (-(stretching**2) - du_dy * dv_dx)).max() < 1e-11


def test_energy_and_enstrophy_are_means_over_the_box():
    box = PeriodicBox(12, 0.1, dtype="float64")
    state = box.initial(random_velocity(12))
    assert box.kinetic_energy(state) == pytest.approx(0.5 * (box.velocity(state) ** 2).sum(axis=0).mean(), rel=1e-12)
    assert box.enstrophy(state) == pytest.approx(0.5 * (box.vorticity(state) ** 2).sum(axis=0).mean(), rel=1e-12)
    assert box.dissipation(state) == pytest.approx(0.2 * box.enstrophy(state), rel=1e-12)


def test_single_precision_stays_single():
    box = PeriodicBox(12, VISCOSITY)
    state = box.advance(box.initial(abc_flow(12)), until=1.0)
    assert state.modes.dtype == np.complex64
    assert box.velocity(state).dtype == np.float32
    assert np.abs(box.velocity(state) - abc_flow(12) * np.exp(-VISCOSITY)).max() < 1e-5


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"dimension": 4}, "dimension must be 2 or 3"),
        ({"resolution": 3}, "resolution at least 4"),
        ({"viscosity": -1.0}, "viscosity must be finite and not negative"),
        ({"viscosity": float("inf")}, "viscosity must be finite and not negative"),
        ({"cfl": 0.0}, "cfl positive"),
        ({"dtype": "float16"}, "'float32' or 'float64', got 'float16'"),
    ],
)
def test_what_cannot_be_solved_is_refused(arguments: dict, message: str):
    with pytest.raises(ValueError, match=message):
        PeriodicBox(**{"resolution": 8, "viscosity": 0.1, **arguments})


@pytest.mark.parametrize("velocity", [np.zeros((3, 8, 8, 7)), np.zeros((2, 8, 8)), np.full((3, 8, 8, 8), np.nan)])
def test_a_wrong_initial_velocity_is_refused(velocity: NDArray[np.float64]):
    with pytest.raises(ValueError, match=r"finite and of shape \(3, 8, 8, 8\)"):
        PeriodicBox(8, 0.1).initial(velocity)
