"""Hard transfer functions and fields for Gaussians that carry field values.

Two things are checked: averages of the function against quadrature in float64, and the float32 kernel and its gradients
against the float64 reference.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from catalogs.vocabulary.appearance import TransferFunction
from surrogate.appearance.averages import (
    LEAST_SPREAD,
    MOST_OPAQUE,
    MOST_SPREAD,
    NEGLIGIBLE,
    TOLERANCE,
    averages_reference,
    resampled,
)
from surrogate.appearance.transferred import LEAST_DEPTH, AverageTable, apply, apply_reference

COUNT = 240  # Gaussians of a case
CHECKED = 24  # of them by quadrature
PANELS, REACH = 61, 10.0  # panels of a quadrature, over this many spreads to either side
ABSCISSAS, WEIGHTS = np.polynomial.legendre.leggauss(20)
# Usual bounds. The kernel interpolates a table of averages, whose slopes err more than its values.
SHOWN, GRADIENT = 1e-5, 5e-4
STEP = 1e-12  # of the range: control points must increase
WHY_STEEP = "the extinction changes within the least spread, so the rounding of a value (6e-8) is visible"
STEEP: dict[str, Any] = {"shown": 1e-4, "why": WHY_STEEP}
WHY_NARROW = "the falling half of a needle cancels its rising half, except for its width"

Apply = Callable[[AverageTable, Tensor, Tensor], tuple[Tensor, Tensor]]


@dataclass(frozen=True, eq=False)
class FunctionCase:
    """One row.

    Attributes
    ----------
    function : the transfer function.
    knots : field values of the Gaussians' scale, from u = 0 to u = 1.
    values : lowest and highest u of the Gaussians.
    spreads : smallest and largest of their spreads; those outside the table's range are clamped to it.
    shown, gradient : bounds of the largest error of opacity and of opacity times colour, and of a gradient relative to
        the largest of its kind. Gradients of Gaussians that are cut to the least depth don't count.
    why : the reason for unusual bounds.
    """

    name: str
    function: TransferFunction
    knots: tuple[float, ...] = (0.0, 1.0)
    values: tuple[float, float] = (-0.2, 1.2)
    spreads: tuple[float, float] = (LEAST_SPREAD, MOST_SPREAD)
    shown: float = SHOWN
    gradient: float = GRADIENT
    why: str = ""


@dataclass(frozen=True)
class FunctionOutcome:
    """The outcome of one case: errors as `FunctionCase` bounds them, the relative error of averages, and exceeded bounds."""

    case: FunctionCase
    average: float = 0.0
    shown: float = 0.0
    gradient: float = 0.0
    finite: bool = True
    complaints: tuple[str, ...] = ()

    @property
    def passed(self) -> bool:
        return not self.complaints


def function_cases() -> list[FunctionCase]:
    """All cases."""
    ramp, peak = gray((0.0, 0.0), (1.0, 1.0)), needle(0.5, 5e-4)
    decades = tuple(10.0**power for power in range(-6, 7))
    on_decades = replace(
        gray(*((value, 0.9 * (k % 2)) for k, value in enumerate(decades))),
        color_points=((decades[0], 0.1, 0.2, 0.9), (decades[-1], 0.9, 0.2, 0.1)),
    )
    far = gray((1e9 - 1.0, 0.0), (1e9, 0.8), (1e9 + 1.0, 0.1))
    return [
        FunctionCase("a step", gray((0.0, 0.0), (0.4, 0.0), (0.4 + STEP, 0.8), (1.0, 0.8)), **STEEP),
        FunctionCase("steps up and down to the opaque", gray(*_stairs((0.0, 0.5, 1.0, 0.1, 0.0))), **STEEP),
        FunctionCase("a needle narrower than any spread", peak, gradient=2e-3, why=WHY_NARROW),
        FunctionCase("a needle of a billionth of the range", needle(0.3, 1e-9)),
        FunctionCase("100 needles", gray(*((k / 200.0, 0.9 * (k % 2)) for k in range(201))), **STEEP),
        FunctionCase("opaque everywhere", gray((0.0, 1.0), (1.0, 1.0))),
        FunctionCase("transparent everywhere", gray((0.0, 0.0), (1.0, 0.0))),
        FunctionCase("even", gray((0.0, 0.4), (1.0, 0.4))),
        FunctionCase("a constant field, on a ramp", ramp, values=(0.25, 0.25), spreads=(1e-30, 1e-12)),
        FunctionCase(
            "a constant field, at a step",
            gray(*_stairs((0.0, 0.6))),
            values=(0.5, 0.5),
            spreads=(1e-30, 1e-12),
            gradient=2e-3,
            why="in the middle of a step no spread changes the average, so the largest of these gradients is small",
        ),
        FunctionCase("values beyond the function, to a million ranges", ramp, values=(-1e6, 1e6)),
        FunctionCase("values beyond the function, next to its ends", ramp, values=(-0.6, 1.6), spreads=(1e-3, 10.0)),
        FunctionCase("spreads from 1e-30 to 1e30", ramp, spreads=(1e-30, 1e30)),
        FunctionCase("a field over twelve decades, on a logarithmic scale", on_decades, knots=decades),
        FunctionCase(
            "a field over twelve decades, on a linear scale", on_decades, knots=(decades[0], decades[-1]), **STEEP
        ),
        FunctionCase("a field of 1e9 ± 1", far, knots=(1e9 - 1.0, 1e9 + 1.0)),
        FunctionCase("a field of 1e-30", gray((0.0, 0.0), (1e-30, 0.9)), knots=(0.0, 1e-30)),
    ]


def gray(*opacity_points: tuple[float, float]) -> TransferFunction:
    """A function with these opacities, blue at its first point and orange at its last."""
    low, high = opacity_points[0][0], opacity_points[-1][0]
    return TransferFunction(((low, 0.1, 0.3, 0.9), (high, 0.9, 0.5, 0.1)), opacity_points, 1.0)


def needle(center: float, width: float) -> TransferFunction:
    """A function that is opaque at a single value of [0, 1]."""
    return gray((0.0, 0.0), (center - width, 0.0), (center, 1.0), (center + width, 0.0), (1.0, 0.0))


def check_function(case: FunctionCase, apply: Apply = apply) -> FunctionOutcome:
    """Check one case against its bounds."""
    nodes = resampled(case.function, case.function.opacity_unit_distance, np.array(case.knots))
    table, (logits, values) = AverageTable.of(nodes), gaussians_of(case)
    got, got_gradients = _shown(apply, table, logits, values)
    true, true_gradients = _shown(apply_reference, table, logits.double(), values.double())
    drawn = true[:, 0] > 1.001 * LEAST_DEPTH
    gradients = [_relative(one[drawn], other[drawn]) for one, other in zip(got_gradients, true_gradients, strict=True)]
    finite = all(bool(torch.isfinite(tensor).all()) for tensor in (got, *got_gradients))
    outcome = FunctionOutcome(case, average_error(case), _largest(got.double() - true), max(gradients), finite)
    return replace(outcome, complaints=tuple(_complaints(outcome)))


def gaussians_of(case: FunctionCase) -> tuple[Tensor, Tensor]:
    """Logits (N,) and values (N, 2) float32 of Gaussians from thin to opaque, drawn by a fixed seed."""
    random = np.random.default_rng(5)
    low, high = np.log(case.spreads)
    columns = random.uniform(*case.values, COUNT), random.uniform(low, high, COUNT)
    values = torch.from_numpy(np.stack(columns, axis=1)).float()  # [N, 2]
    return torch.from_numpy(random.uniform(-9.0, 6.0, COUNT)).float(), values


def average_error(case: FunctionCase) -> float:
    """The largest error of the averages, relative to the averaged extinction or to `NEGLIGIBLE` of the largest one."""
    knots = np.array(case.knots)
    nodes = resampled(case.function, case.function.opacity_unit_distance, knots)
    floor, largest = NEGLIGIBLE * float(nodes.columns[:, 0].max()), 0.0
    _, values = gaussians_of(case)
    for value, log_spread in values[:CHECKED].double().clamp(min=-1e3).tolist():
        spread = min(max(math.exp(log_spread), LEAST_SPREAD), MOST_SPREAD)
        mean = min(max(value, -0.5), 1.5)
        wanted = quadrature(case.function, knots, nodes.places, mean, spread)  # [4]
        at = torch.tensor([mean], dtype=torch.float64), torch.tensor([math.log(spread)], dtype=torch.float64)
        wrong = np.abs(averages_reference(nodes, *at)[0].numpy() - wanted).max()
        largest = max(largest, float(wrong / max(wanted[0], floor, 1e-300)))
    return largest


def quadrature(
    function: TransferFunction, knots: NDArray[np.float64], breaks: NDArray[np.float64], mean: float, spread: float
) -> NDArray[np.float64]:
    """Extinction and emission (4,) averaged under N(mean, spread²), by Gauss-Legendre points in panels between the breaks."""
    low, high = mean - REACH * spread, mean + REACH * spread
    inside = breaks[(breaks > low) & (breaks < high)]
    ends = np.unique(np.concatenate([np.linspace(low, high, PANELS), inside]))
    middles, halves = (ends[1:] + ends[:-1]) / 2.0, np.diff(ends) / 2.0
    places = np.clip(middles[:, None] + halves[:, None] * ABSCISSAS, ends[:-1, None], ends[1:, None]).ravel()
    density = np.exp(-0.5 * ((places - mean) / spread) ** 2) / (spread * math.sqrt(2.0 * math.pi))
    k = np.clip(np.floor(places * (len(knots) - 1)).astype(int), 0, len(knots) - 2)
    values = knots[k] + (places * (len(knots) - 1) - k) * np.diff(knots)[k]
    extinctions = -np.log1p(-np.minimum(function.opacities(values), MOST_OPAQUE))
    columns = extinctions[:, None] * np.pad(function.colors(values), ((0, 0), (1, 0)), constant_values=1.0)
    return np.asarray(((halves[:, None] * WEIGHTS).ravel() * density) @ columns)


def _shown(apply: Apply, table: AverageTable, logits: Tensor, values: Tensor) -> tuple[Tensor, list[Tensor]]:
    """Opacity and opacity times colour (N, 4), and the gradients of a fixed random functional of them."""
    leaves = [tensor.clone().requires_grad_() for tensor in (logits, values)]
    opacity_logits, colors = apply(table, *leaves)
    opacities = torch.sigmoid(opacity_logits)[:, None]  # [N, 1]
    shown = torch.cat([opacities, opacities * colors], dim=1)  # [N, 4]
    weights = torch.randn(shown.shape, generator=torch.Generator().manual_seed(9), dtype=torch.float64).to(shown)
    gradients = torch.autograd.grad((shown * weights).sum(), leaves)
    return shown.detach(), [gradients[0], gradients[1][:, 0], gradients[1][:, 1]]


def _stairs(opacities: tuple[float, ...]) -> list[tuple[float, float]]:
    """Control points over [0, 1] of equally long steps with these opacities."""
    ends = np.linspace(0.0, 1.0, len(opacities) + 1).tolist()
    return [
        point for a, low, high in zip(opacities, ends, ends[1:], strict=False) for point in ((low + STEP, a), (high, a))
    ]


def _relative(got: Tensor, true: Tensor) -> float:
    unit, error = _largest(true), _largest(got.double() - true)
    return error / unit if unit > 0.0 else error


def _largest(tensor: Tensor) -> float:
    return float(tensor.abs().max()) if tensor.numel() else 0.0


def _complaints(outcome: FunctionOutcome) -> list[str]:
    case = outcome.case
    checks = (("average", outcome.average, TOLERANCE), ("shown", outcome.shown, case.shown))
    missed = [] if outcome.finite else ["not finite"]
    missed += [f"{what} wrong by {error:.1e}, above {bound:.0e}" for what, error, bound in checks if not error <= bound]
    if not outcome.gradient <= case.gradient:
        missed.append(f"gradient wrong by {outcome.gradient:.1e}, above {case.gradient:.0e}")
    return missed
