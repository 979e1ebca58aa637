"""Transfer functions averaged over normally distributed values: against quadrature in float64, and where nodes are placed."""

from __future__ import annotations

import math
import tomllib
from pathlib import Path

import numpy as np
import pytest
import torch
from numpy.typing import NDArray

from catalogs.vocabulary.appearance import TransferFunction
from surrogate.appearance.averages import MOST_OPAQUE, NEGLIGIBLE, TOLERANCE, Nodes, averages_reference, resampled

SCENES = Path(__file__).parents[3] / "scenes"
ABSCISSAS, WEIGHTS = np.polynomial.legendre.leggauss(20)
SPREADS = (0.002, 0.004, 0.013, 0.05, 0.2, 0.6)
PLACES = np.array([-3.0, -0.31, 0.0, 0.0999, 0.1, 0.2371, 0.25, 0.5, 0.50003, 0.77, 1.0, 1.4])


def colored(places: list[float], extinctions: list[float]) -> Nodes:
    colors = np.random.default_rng(len(places)).random((len(places), 3))
    return Nodes(np.array(places), np.array(extinctions)[:, None] * np.pad(colors, ((0, 0), (1, 0)), constant_values=1))


FUNCTIONS = {
    "constant": colored([0.3], [0.7]),
    "constant on both sides": colored([0.3, 0.4], [0.7, 0.7]),
    "ramp": colored([0.0, 1.0], [0.0, 6.9]),
    "step": colored([0.25, 0.25], [0.0, 2.0]),
    "steps, of which one has a node in the middle": colored([0.1, 0.1, 0.25, 0.25, 0.25, 0.8], [1, 0, 0.5, 7, 3, 0]),
    "needle narrower than any spread": colored([0.0, 0.4999, 0.5, 0.5001, 1.0], [0.01, 0.01, 6.9, 0.0, 0.0]),
    "needle of no width": colored([0.0, 0.5, 0.5, 0.5, 1.0], [0.01, 0.01, 6.9, 0.0, 0.0]),
    "almost a step": colored([0.25, 0.25 + 1e-13], [0.0, 2.0]),
    "parts as wide as the narrowest spread": colored([0.01 * k * 0.2 for k in range(100)], [k % 7 for k in range(100)]),
    "far places": colored([-1e6, -2.0, 0.3, 4.0, 1e6], [3.0, 1.0, 0.0, 2.0, 5.0]),
}


def at(nodes: Nodes, values: NDArray[np.float64]) -> NDArray[np.float64]:
    """The function (M, 4) at places that are not its own."""
    k = np.searchsorted(nodes.places, values)  # [M]
    low, high = np.maximum(k - 1, 0), np.minimum(k, len(nodes) - 1)
    widths = nodes.places[high] - nodes.places[low]
    shares = np.where(widths > 0, (values - nodes.places[low]) / np.where(widths > 0, widths, 1), 0.0)[:, None]
    return nodes.columns[low] * (1 - shares) + nodes.columns[high] * shares


def quadrature(function, breaks: NDArray[np.float64], value: float, spread: float) -> NDArray[np.float64]:
    """The mean (4,) of a function under N(value, spread²), by 20 Gauss-Legendre points in each of many panels."""
    low, high = value - 10 * spread, value + 10 * spread
    inside = breaks[(breaks > low) & (breaks < high)]
    ends = np.unique(np.concatenate([np.linspace(low, high, 61), inside]))
    middles, halves = (ends[1:] + ends[:-1]) / 2, np.diff(ends) / 2
    places = np.clip((middles[:, None] + halves[:, None] * ABSCISSAS), ends[:-1, None], ends[1:, None]).ravel()
    density = np.exp(-0.5 * ((places - value) / spread) ** 2) / (spread * math.sqrt(2 * math.pi))
    return ((halves[:, None] * WEIGHTS).ravel() * density) @ function(places)


def averaged(nodes: Nodes, values: NDArray[np.float64], spread: float, dtype=torch.float64) -> NDArray[np.float64]:
    means = torch.from_numpy(values).to(dtype)
    return averages_reference(nodes, means, torch.full_like(means, math.log(spread))).double().numpy()


@pytest.mark.parametrize("kind", FUNCTIONS)
@pytest.mark.parametrize("spread", SPREADS)
def test_averages_are_those_of_quadrature(kind: str, spread: float) -> None:
    nodes = FUNCTIONS[kind]
    wanted = np.stack([quadrature(lambda u: at(nodes, u), nodes.places, value, spread) for value in PLACES])
    floor = 1e-6 * nodes.columns.max()
    assert (np.abs(averaged(nodes, PLACES, spread) - wanted) <= 1e-8 * np.maximum(wanted, floor)).all()
    single = averaged(nodes, PLACES.astype(np.float32).astype(np.float64), spread, torch.float32)
    nearby = averaged(nodes, PLACES.astype(np.float32).astype(np.float64), spread)
    assert np.abs(single - nearby).max() <= 1e-5 * nodes.columns.max()


def test_far_outside_averages_are_the_ends() -> None:
    nodes = FUNCTIONS["steps, of which one has a node in the middle"]
    for value, end in ((-1e9, 0), (-30.0, 0), (30.0, -1), (1e9, -1)):
        found = averaged(nodes, np.array([value]), 0.3)
        np.testing.assert_allclose(found[0], nodes.columns[end], rtol=0, atol=1e-14 * nodes.columns.max())


@pytest.mark.parametrize("kind", FUNCTIONS)
def test_the_twin_is_differentiable(kind: str) -> None:
    nodes = FUNCTIONS[kind]
    values = torch.tensor(
        [-0.2, 0.1, 0.11, 0.25, 0.3, 0.5, 0.9], dtype=torch.float64, requires_grad=True
    )  # some at nodes
    log_spreads = torch.tensor([-3.0, -4.0, -0.7, -2.0, -5.0, -1.0, -3.0], dtype=torch.float64, requires_grad=True)
    torch.autograd.gradcheck(lambda u, s: averages_reference(nodes, u, s), (values, log_spreads), eps=1e-7, atol=1e-5)


def test_derivatives_are_the_closed_forms() -> None:
    """Of a step: phi / s by u, and -z phi by ln s; of a ramp of slope 1 / w: differences of Phi / w, and of phi s / w."""
    step, ramp = FUNCTIONS["step"], FUNCTIONS["ramp"]
    u, log_s = (
        torch.tensor(x, dtype=torch.float64, requires_grad=True) for x in ([0.3, -0.1, 0.2501], [-2.0, -1.0, -5.0])
    )
    s, means = log_s.detach().exp(), u.detach()
    normal = torch.distributions.Normal(0.0, 1.0)

    def density(z: torch.Tensor) -> torch.Tensor:
        return normal.log_prob(z).exp()

    z = (means - 0.25) / s
    found = torch.autograd.grad(averages_reference(step, u, log_s)[:, 0].sum(), (u, log_s))
    torch.testing.assert_close(found[0], 2.0 * density(z) / s)
    torch.testing.assert_close(found[1], -2.0 * z * density(z))
    a, b = means / s, (means - 1.0) / s
    found = torch.autograd.grad(averages_reference(ramp, u, log_s)[:, 0].sum(), (u, log_s))
    torch.testing.assert_close(found[0], 6.9 * (normal.cdf(a) - normal.cdf(b)))
    torch.testing.assert_close(found[1], 6.9 * s * (density(a) - density(b)))


@pytest.mark.parametrize(
    ("places", "columns", "message"),
    [
        ([0.0, 1.0], np.zeros((3, 4)), r"places \(K,\) and columns \(K, 4\), K from 1 on, got \(2,\) and \(3, 4\)"),
        ([], np.zeros((0, 4)), "K from 1 on"),
        ([1.0, 0.0], np.zeros((2, 4)), "never decrease"),
        ([0.0, np.nan], np.zeros((2, 4)), "finite"),
        ([0.0, 1.0], np.array([[0.0] * 4, [1.0, -0.1, 0, 0]]), "not negative, got .* at node 1"),
        ([0.0, 1.0], np.array([[0.0] * 4, [np.inf, 0, 0, 0]]), "finite and not negative, got .* at node 1"),
        ([0.0, 1.0], np.array([[0.0] * 4, [0.0, 0.1, 0, 0]]), "only what absorbs can emit, got .* at node 1"),
    ],
)
def test_nodes_that_are_none_are_refused(places: list[float], columns: NDArray[np.float64], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        Nodes(np.array(places), columns)


def scene_function(name: str) -> TransferFunction:
    scene = tomllib.loads((SCENES / f"{name}.toml").read_text())
    return TransferFunction(**scene["appearance"][0]["transfer_function"])


def drawn(seed: int, points: int = 12) -> TransferFunction:
    """Random colours and opacities at the same values, some of them transparent."""
    random = np.random.default_rng(seed)
    values = np.sort(random.random(points))
    opacities = random.random(points) * random.choice([0.3, 0.7, 1.0], points) * (random.random(points) < 0.8)
    colors = random.random((points, 3))
    return TransferFunction(
        tuple((v, *c) for v, c in zip(values, colors.tolist(), strict=True)),
        tuple(zip(values, opacities, strict=True)),
        0.3,
    )


GRAY = ((0.0, 0.0, 0.0, 0.0), (1.0, 1.0, 1.0, 1.0))
GIVEN = {
    **{name: scene_function(name) for name in ("cloverleaf", "tgv", "tgv-dvr", "tgv-tf")},
    **{f"random {seed}": drawn(seed) for seed in range(3)},
    "opaque ramp": TransferFunction(GRAY, ((0.0, 0.0), (1.0, 1.0)), 1.0),
    "needle": TransferFunction(GRAY, ((0.0, 0.0), (0.5, 0.0), (0.501, 0.95), (0.502, 0.0), (1.0, 1.0)), 1.0),
    "needle half as wide as the least spread": TransferFunction(
        GRAY, ((0.0, 0.0), (0.499, 0.0), (0.5, 1.0), (0.501, 0.0), (1.0, 0.0)), 1.0
    ),
    "transparent": TransferFunction(GRAY, ((0.0, 0.0), (1.0, 0.0)), 1.0),
    "even": TransferFunction(GRAY, ((0.0, 0.4), (1.0, 0.4)), 1.0),
    "steps": TransferFunction(GRAY, ((0, 0.0), (0.3, 0.1), (0.3 + 1e-12, 0.8), (0.6, 0.8), (0.6 + 1e-12, 0)), 1.0),
}


def truth(function: TransferFunction, unit: float, knots: NDArray[np.float64], places: NDArray[np.float64]):
    """Extinction and emission (M, 4) of a transfer function at places on the scale of `knots`, (M,)."""
    k = np.clip(np.floor(places * (len(knots) - 1)).astype(int), 0, len(knots) - 2)
    values = knots[k] + (places * (len(knots) - 1) - k) * np.diff(knots)[k]
    extinctions = (
        -np.log1p(-np.minimum(function.opacities(values), MOST_OPAQUE)) * unit / function.opacity_unit_distance
    )
    return extinctions[:, None] * np.pad(function.colors(values), ((0, 0), (1, 0)), constant_values=1.0)


@pytest.mark.parametrize("kind", GIVEN)
@pytest.mark.parametrize("spread", [0.004, 0.007, 0.05, 0.6])
def test_resampled_functions_have_the_averages_of_the_function(kind: str, spread: float) -> None:
    function, unit = GIVEN[kind], 0.45
    low, high = function.bounds
    even = np.linspace(low, high, 8)
    for knots in (np.array([p[0] for p in function.opacity_points]), even[1:-1] ** 1.0):
        if (np.diff(knots) < 1e-9 * (high - low)).any():  # a scale that gives a step some length is another function
            continue
        nodes = resampled(function, unit, knots)
        values = np.random.default_rng(0).uniform(-0.3, 1.3, 40)
        wanted = np.stack(
            [quadrature(lambda u, k=knots: truth(function, unit, k, u), nodes.places, u, spread) for u in values]
        )
        floor = NEGLIGIBLE * nodes.columns[:, 0].max()
        wrong = np.abs(averaged(nodes, values, spread) - wanted)
        assert (wrong <= TOLERANCE * np.maximum(wanted[:, :1], floor)).all()


def test_a_typical_function_has_few_nodes() -> None:
    for kind in ("cloverleaf", "tgv", "tgv-dvr", "tgv-tf"):
        assert len(resampled(GIVEN[kind], 0.45, np.array([p[0] for p in GIVEN[kind].opacity_points]))) <= 200
    assert np.mean([len(resampled(drawn(seed), 0.3, np.linspace(0, 1, 9))) for seed in range(20)]) <= 300


def test_nodes_lie_at_knots_and_control_points_and_follow_units() -> None:
    function = TransferFunction(((1.0, 1, 0, 0), (3.0, 0, 1, 0)), ((0.0, 0.5), (10.0, 0.5)), 0.5)
    nodes = resampled(function, 1.0, np.array([2.0, 4.0, 12.0]))
    np.testing.assert_allclose(nodes.places, [-0.5, -0.25, 0.0, 0.25, 0.5, 0.875, 1.0])  # values 0, 1, 2, 3, 4, 10, 12
    np.testing.assert_allclose(nodes.columns[:, 0], 2.0 * math.log(2.0))
    np.testing.assert_allclose(nodes.columns[2], 2.0 * math.log(2.0) * np.array([1.0, 0.5, 0.5, 0.0]))


@pytest.mark.parametrize("knots", [[1.0], [1.0, 1.0], [2.0, 1.0], [0.0, np.inf], [[0.0, 1.0]]])
def test_a_scale_needs_increasing_knots(knots: list[float]) -> None:
    with pytest.raises(ValueError, match="knots must be two or more increasing field values"):
        resampled(GIVEN["even"], 1.0, np.array(knots))
