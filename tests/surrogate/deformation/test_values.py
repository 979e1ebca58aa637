"""Transfer functions that are applied, against integrals of the emission and absorption model by scipy, in float64."""

from __future__ import annotations

import itertools
import json
from dataclasses import replace

import numpy as np
import pytest
import torch
from numpy.typing import NDArray
from scipy.integrate import quad

from catalogs.vocabulary.appearance import TransferFunction
from surrogate.deformation import Offsets, ValuesDeformation, load_deformation
from surrogate.deformation.extinction import extinction_table
from surrogate.deformation.values import placed_values
from surrogate.gaussians import NAMES, Gaussians

BASE = TransferFunction(
    ((-1.0, 0.1, 0.2, 0.9), (1.0, 0.9, 0.9, 0.2), (3.0, 0.9, 0.1, 0.1)), ((-1, 0), (0.4, 0.2), (2, 0.6), (3, 0.95)), 0.3
)
OTHER = replace(BASE, opacity_points=((-1, 0.5), (0, 0.05), (2.5, 0.3), (3, 0)))
RECOLORED = TransferFunction(((-1, 0, 1, 0), (0.5, 1, 0, 1), (3, 0, 0.3, 0.6)), ((-1, 0.4), (3, 0.7)), 0.3)
LONGER = replace(OTHER, opacity_unit_distance=1.2)
CLEAR = replace(BASE, opacity_points=((-1, 0), (3, 0)))
OPAQUE = replace(BASE, opacity_points=((-1, 1), (3, 1)))
STEPS = (0.5, 0.1, 0.5, 0.2)
EVEN, UNEVEN = np.linspace(-1, 3, 24), np.array([-1.0, -0.9, 0.3, 0.35, 1.4, 2.6, 3.0])


def extinction(function: TransferFunction, value: float) -> float:
    """Per world length."""
    return float(-np.log1p(-min(float(function.opacities(value)), 0.999)) / function.opacity_unit_distance)


def integral(function: TransferFunction, column: int | None, weight=lambda value: 1.0) -> float:
    """Of extinction, or of extinction times a colour, over the values from -1 to 3."""

    def integrand(value: float) -> float:
        color = 1.0 if column is None else float(function.colors(value)[column])
        return extinction(function, value) * color * weight(value)

    kinks = sorted({p[0] for p in (*function.color_points, *function.opacity_points)} | {0.3, 0.35, 1.4, 2.6, -0.9})
    return sum(quad(integrand, a, b, limit=200)[0] for a, b in itertools.pairwise(kinks))


def slab(function: TransferFunction, length: float) -> tuple[float, NDArray[np.float64]]:
    """Optical depth, and the emission-weighted mean colour (3,), of a slab in which the field rises evenly from -1 to 3."""
    depth = integral(function, None)
    return depth * length / 4.0, np.array([integral(function, c) for c in range(3)]) / depth


def gaussians(logits: NDArray[np.float64], colors: NDArray[np.float64], dtype=torch.float64) -> Gaussians:
    count = len(logits)
    random = torch.Generator().manual_seed(1)
    shapes = ((count, 3), (count, 3), (count, 4))
    rest = (torch.randn(shape, generator=random, dtype=dtype) for shape in shapes)
    return Gaussians(*rest, torch.from_numpy(logits).to(dtype), torch.from_numpy(colors).to(dtype))


def some(count: int = 9, dtype=torch.float32, color_columns: int = 3) -> Gaussians:
    random = np.random.default_rng(2)
    return gaussians(random.normal(0, 2, count), random.random((count, color_columns)), dtype)


def weighted(count: int, values: NDArray[np.float64] = EVEN, dtype=torch.float64) -> ValuesDeformation:
    weights = np.random.default_rng(3).random((count, len(values)))
    return ValuesDeformation(torch.from_numpy(weights).to(dtype), BASE, values, STEPS)


def logit_of_depth(depth: float) -> float:
    return float(np.log(np.expm1(depth)))


def depths(logits: torch.Tensor) -> NDArray[np.float64]:
    """-ln(1 - o)."""
    return -np.log1p(-1.0 / (1.0 + np.exp(-logits.detach().double().numpy())))


@pytest.mark.parametrize("values", [EVEN, UNEVEN], ids=["even", "uneven"])
@pytest.mark.parametrize("length", [0.02, 0.4, 3.0])
@pytest.mark.parametrize("function", [OTHER, RECOLORED, LONGER, BASE], ids=["other", "recolored", "longer", "base"])
def test_a_slab_looks_under_any_function_as_it_must(
    function: TransferFunction, length: float, values: NDArray[np.float64]
) -> None:
    depth, color = slab(BASE, length)
    shown = gaussians(np.array([logit_of_depth(depth)]), color[None])
    hats = np.diff(values, prepend=values[0]) / 2 + np.diff(values, append=values[-1]) / 2  # [B], integrals
    weights = torch.from_numpy(hats * length / 4.0 / BASE.opacity_unit_distance)[None]  # [1, B]
    under = ValuesDeformation(weights, BASE, values, STEPS).under(shown, function)
    expected_depth, expected_color = slab(function, length)
    assert depths(under.opacity_logits)[0] == pytest.approx(expected_depth, rel=3e-3)
    np.testing.assert_allclose(under.colors[0].numpy(), expected_color, atol=3e-3)


def test_a_homogeneous_ball_on_a_value_of_its_own_is_exact_where_functions_are_flat() -> None:
    flat, thicker = (
        replace(BASE, opacity_points=((-1, 0.3), (3, 0.3))),
        replace(OPAQUE, opacity_points=((-1, 0.8), (3, 0.8))),
    )
    flat, thicker = (
        replace(f, color_points=((-1, *c), (3, *c))) for f, c in ((flat, (1, 0.5, 0)), (thicker, (0, 0.2, 1)))
    )
    chord = 0.7  # through the ball, in units of the function's distance
    shown = gaussians(np.array([logit_of_depth(-chord * np.log(0.7))]), np.array([[1, 0.5, 0.0]]))
    ball = ValuesDeformation(chord * torch.eye(5, dtype=torch.float64)[2:3], flat, np.linspace(-1, 3, 5), STEPS)
    under = ball.under(shown, thicker)
    assert 1.0 - float(under.opacities()[0]) == pytest.approx(0.2**chord, rel=1e-12)
    np.testing.assert_allclose(under.colors[0].numpy(), [0, 0.2, 1], atol=1e-12)


@pytest.mark.parametrize("color_columns", [3, 12])
def test_at_the_base_nothing_changes_bit_for_bit(color_columns: int) -> None:
    shown = some(9, torch.float32, color_columns)
    shown.opacity_logits[:4] = torch.tensor([-60.0, 60.0, -9.5, 1e4])
    deformation = weighted(9, dtype=torch.float32)
    for same in (deformation.under(shown, BASE), deformation.deformed(shown, torch.tensor([0.3, 0, 0, 0, 0]))):
        assert all(torch.equal(getattr(same, name), getattr(shown, name)) for name in NAMES)


def test_only_opacity_and_the_directionless_colour_change() -> None:
    shown = some(9, torch.float32, 12)
    moved = weighted(9, dtype=torch.float32).deformed(shown, torch.tensor([0.3, 1.0, -1.0, 0.5, 1.0]))
    assert all(torch.equal(getattr(moved, name), getattr(shown, name)) for name in ("means", "log_scales", "quats"))
    assert torch.equal(moved.colors[:, 3:], shown.colors[:, 3:])
    assert (moved.colors[:, :3] != shown.colors[:, :3]).any()
    assert (moved.opacity_logits != shown.opacity_logits).any()


def test_normalized_parameters_displace_the_inner_control_points_by_their_steps() -> None:
    shown, deformation = some(9), weighted(9, dtype=torch.float32)
    points = ((-1, 0), (0.4 + 0.5, 0.2 - 0.1), (2 - 0.25, 0.6 + 0.2), (3, 0.95))
    expected = deformation.under(shown, replace(BASE, opacity_points=points))
    found = deformation.deformed(shown, torch.tensor([0.7, 1.0, -1.0, -0.5, 1.0]))
    torch.testing.assert_close(found.opacity_logits, expected.opacity_logits)
    torch.testing.assert_close(torch.clamp(found.colors, *palette(BASE, shown)), expected.colors)


def palette(function: TransferFunction, shown: Gaussians) -> tuple[torch.Tensor, torch.Tensor]:
    """The lowest and highest colours (N, 3) among a function's and a Gaussian's own."""
    colors = function.colors(np.linspace(*function.bounds, 1001))  # [1001, 3]
    own = shown.colors[:, :3].numpy()
    low, high = np.minimum(own, colors.min(axis=0)), np.maximum(own, colors.max(axis=0))
    return torch.from_numpy(low).to(shown.colors), torch.from_numpy(high).to(shown.colors)


@pytest.mark.parametrize("function", [OTHER, RECOLORED, CLEAR, OPAQUE], ids=["other", "recolored", "clear", "opaque"])
def test_any_function_shows_only_colours_that_it_has_or_that_were_there(function: TransferFunction) -> None:
    shown = some(60)
    low, high = palette(function, shown)
    colors = weighted(60, dtype=torch.float32).under(shown, function).colors
    assert (colors >= low - 1e-6).all()
    assert (colors <= high + 1e-6).all()


@pytest.mark.parametrize("base", [BASE, replace(BASE, opacity_points=((-1, 0), (1.2, 0), (2, 0.6), (3, 1)))])
def test_at_first_every_gaussian_has_its_depth_under_the_base(base: TransferFunction) -> None:
    shown = some(40)
    shown.colors[:2] = torch.tensor([[0.0, 0.0, 0.0], [-0.2, -0.1, 0.0]])  # like what can't be seen
    deformation = ValuesDeformation.create(shown, base, EVEN, STEPS)
    found = (deformation.weights.double() @ torch.from_numpy(extinction_table(base, EVEN)[:, 0])).numpy()
    np.testing.assert_allclose(found, depths(shown.opacity_logits), rtol=1e-5)


def test_at_first_a_gaussian_stands_for_the_values_of_its_colour() -> None:
    value = 2.2
    shown = gaussians(np.zeros(1), BASE.colors([value]), torch.float32)
    weights = ValuesDeformation.create(shown, BASE, EVEN, STEPS).weights[0].numpy()
    assert abs(np.average(EVEN, weights=weights) - value) < 0.1
    assert weights[np.abs(EVEN - value) > 1.0].max() < 0.02 * weights.max()


def test_a_weight_of_zero_can_grow() -> None:
    deformation = replace(weighted(3), weights=torch.zeros(3, len(EVEN), dtype=torch.float64, requires_grad=True))
    deformation.under(some(3, torch.float64), OTHER).opacity_logits.sum().backward()
    assert deformation.weights.grad is not None
    assert (deformation.weights.grad.abs() > 0).all()


@pytest.mark.parametrize("function", [OTHER, RECOLORED, LONGER])
@pytest.mark.parametrize("values", [EVEN, np.array([-1.0, 3.0])], ids=["24", "two"])
def test_gradients_agree_with_finite_differences(function: TransferFunction, values: NDArray[np.float64]) -> None:
    shown, deformation = some(4, torch.float64), weighted(4, values)
    deformation.weights[0] *= -1.0  # a weight may pass zero while it is trained

    def deformed(weights: torch.Tensor, logits: torch.Tensor, colors: torch.Tensor) -> tuple[torch.Tensor, ...]:
        moved = replace(shown, opacity_logits=logits, colors=colors)
        found = replace(deformation, weights=weights).under(moved, function)
        return found.opacity_logits, found.colors

    inputs = (deformation.weights, 2.0 + shown.opacity_logits.abs(), shown.colors)
    assert torch.autograd.gradcheck(deformed, [t.requires_grad_() for t in inputs])


@pytest.mark.parametrize("function", [CLEAR, OPAQUE, OTHER], ids=["clear", "opaque", "other"])
@pytest.mark.parametrize("base", [BASE, CLEAR, OPAQUE], ids=["base", "clear base", "opaque base"])
@pytest.mark.parametrize("values", [EVEN, np.array([-1.0, 3.0])], ids=["24", "two"])
def test_nothing_is_ever_nan(function: TransferFunction, base: TransferFunction, values: NDArray[np.float64]) -> None:
    shown = some(8)
    shown.opacity_logits[:6] = torch.tensor([-100.0, -20.0, -5.5, 20.0, 100.0, 3e4])
    shown = Gaussians(*(t.requires_grad_() for t in shown.tensors().values()))
    deformation = ValuesDeformation.create(shown, base, values, STEPS)
    assert torch.isfinite(deformation.weights).all()
    deformation.weights.requires_grad_()
    under = deformation.under(shown, function)
    (under.opacities().sum() + (under.colors * under.opacities()[:, None]).sum()).backward()
    for tensor in (under.opacity_logits, under.colors, deformation.weights.grad, shown.opacity_logits.grad):
        assert tensor is not None
        assert torch.isfinite(tensor).all()


def test_a_clear_function_hides_what_stands_for_values_only() -> None:
    shown = some(20)
    under = ValuesDeformation.create(shown, BASE, EVEN, STEPS).under(shown, CLEAR)
    assert float(under.opacities().max()) < 1.0 / 255.0


def test_it_survives_being_saved() -> None:
    deformation, shown = weighted(5, UNEVEN, torch.float32), some(5)
    record = json.loads(json.dumps(deformation.record()))
    loaded = load_deformation(deformation.stored(), record)
    for found, expected in zip(flat(loaded, shown), flat(deformation, shown), strict=True):
        assert torch.equal(found, expected)


@pytest.mark.parametrize("change", [{"values": [0.0, 1.0]}, {"values": list(UNEVEN[::-1])}])
def test_weights_that_are_not_those_of_the_values_are_refused(change: dict) -> None:
    deformation = weighted(5, UNEVEN, torch.float32)
    with pytest.raises(ValueError, match="increasing values are needed"):
        ValuesDeformation.load(deformation.stored(), deformation.record() | change)


def test_it_is_a_deformation_like_others() -> None:
    deformation, shown = weighted(5, dtype=torch.float32), some(5)
    rows = torch.tensor([3, 1])
    for found, expected in zip(flat(deformation.of(rows), shown.of(rows)), flat(deformation, shown), strict=True):
        assert torch.equal(found, expected[rows])
    copied = deformation.copy()
    copied.weights.zero_()
    assert deformation.weights.any()


def flat(deformation, shown: Gaussians) -> tuple[torch.Tensor, ...]:
    offsets: Offsets = deformation.offsets(shown, torch.tensor([0.1, 0.5, -0.5, 1.0, 1.0]))
    return offsets.means, offsets.opacity_logits, offsets.colors


@pytest.mark.parametrize("count", [2, 3, 32, 3000])
def test_values_span_the_bounds(count: int) -> None:
    histogram, edges = np.array([0, 5, 1000, 5, 0, 0]), np.linspace(-1, 3, 7)
    for given in ((None, None), (histogram, edges), (np.zeros(6, np.int64), edges), (histogram, edges + 10.0)):
        values = placed_values(count, (-1.0, 3.0), *given)
        assert len(values) == count
        assert (values[0], values[-1]) == (-1.0, 3.0)
        assert (np.diff(values) > 0).all()


def test_frequent_values_lie_denser_and_none_lies_alone() -> None:
    histogram, edges = np.zeros(64, np.int64), np.linspace(-1, 3, 65)
    histogram[20:24] = 10_000
    spacing = np.diff(placed_values(40, (-1.0, 3.0), histogram, edges))
    middles = placed_values(40, (-1.0, 3.0), histogram, edges)[:-1] + spacing / 2
    frequent = (middles > edges[20]) & (middles < edges[24])
    assert spacing[frequent].mean() < 0.3 * spacing[~frequent].mean()
    assert spacing.max() < 2.2 * 4.0 / 39


def test_values_that_the_histogram_does_not_reach_are_not_frequent() -> None:
    histogram, edges = np.full(8, 100), np.linspace(1.0, 3.0, 9)
    values = placed_values(41, (-1.0, 3.0), histogram, edges)
    assert (values < 1.0).sum() < 0.35 * len(values)
