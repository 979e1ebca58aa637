"""F_vis that applies transfer functions instead of learning them: every Gaussian knows which field values it stands for.

A Gaussian i has weights W_ib >= 0 of B field values: how much optical depth it would have if only value b had unit extinction.
Under a transfer function with extinctions tau_b and colours c_b its optical depth and emission, both sums over what it covers, are

    kappa_i = sum_b W_ib tau_b,        kappa_i c_i = sum_b W_ib tau_b c_b

(emission and absorption, Max 1995, equations 1 to 3).  What is used are differences to the base transfer function, added to
what the Gaussian is at the base, so the base stays what it was, bit for bit, and any other transfer function can be asked
for: also colours that no training image showed.  The optical depth of a splat of opacity o is kappa = -ln(1 - o).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from functools import cached_property
from typing import Any, ClassVar

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from catalogs.appearance import TransferFunction
from catalogs.variations import displaced
from surrogate.deformation.offsets import Offsets
from surrogate.gaussians import Gaussians
from surrogate.settings import TrainingSettings

FINE = 1024  # places at which the density of values is taken
SAMPLES = 32  # of the transfer function between two neighbouring values
MOST_OPAQUE = 0.999  # an opacity of 1 would be an infinite extinction
LEAST_DEPTH = 1e-4  # a Gaussian thinner than this is never drawn (alpha 1/255)
COLOR_SPREAD = 0.1  # how far the colour of a value may lie from a Gaussian's to be thought its own at first


@dataclass(frozen=True, eq=False)
class ValuesDeformation:
    """Weights of field values.

    Attributes
    ----------
    weights : (N, B), whose absolute values are W.
    base : the transfer function at which the Gaussians are what F_sim says.
    values : (B,) increasing field values that span the base's bounds.
    steps : (4,) the displacements that normalized visualization parameters are in units of.
    """

    weights: Tensor  # [N, B]
    base: TransferFunction
    values: NDArray[np.float64]  # [B]
    steps: tuple[float, ...]

    kind: ClassVar[str] = "values"
    per_gaussian: ClassVar[frozenset[str]] = frozenset({"weights"})

    @classmethod
    def create(
        cls, gaussians: Gaussians, base: TransferFunction, values: NDArray[np.float64], steps: Sequence[float]
    ) -> ValuesDeformation:
        """Weights that give every Gaussian its optical depth under `base`, on the values whose colours are most like its own.

        Parameters
        ----------
        gaussians : N of them, as they look under `base`.
        values : (B,) increasing, from `placed_values`.
        steps : (4,) what a normalized displacement of 1 means.
        """
        table = torch.from_numpy(_table(base, values))  # [B, 4]
        extinctions, emissions = table[:, 0], table[:, 1:]
        colors = emissions / extinctions.clamp(min=1e-9)[:, None]  # [B, 3]
        distances = torch.cdist(gaussians.colors[:, :3].detach().cpu().double(), colors)  # [N, B]
        distances = distances.masked_fill(extinctions <= 0, torch.inf)  # what can't be seen has no colour
        nearest = distances.amin(dim=1, keepdim=True)  # [N, 1]
        alike = torch.exp(-0.5 * ((distances - nearest) / COLOR_SPREAD).nan_to_num(torch.inf) ** 2)  # [N, B]
        depths = torch.nn.functional.softplus(gaussians.opacity_logits.detach().cpu().double())  # [N]
        scale = depths / (alike @ extinctions).clamp(min=1e-9)  # [N]
        weights = (alike * scale[:, None]).float().to(gaussians.means.device)
        return cls(weights, base, np.asarray(values, dtype=np.float64), tuple(map(float, steps)))

    @classmethod
    def load(cls, tensors: Mapping[str, Tensor], record: Mapping[str, Any]) -> ValuesDeformation:
        """The deformation of `stored()` and `record()`."""
        values = np.array(record["values"], dtype=np.float64)
        if (
            set(tensors) != {"weights"}
            or tensors["weights"].shape[1:] != values.shape
            or not (np.diff(values) > 0).all()
        ):
            raise ValueError(f"weights of {len(values)} increasing values are needed, got {sorted(tensors)}")
        return cls(tensors["weights"], TransferFunction(**record["base"]), values, tuple(record["steps"]))

    def offsets(self, gaussians: Gaussians, parameters: Tensor) -> Offsets:
        """Offsets of `gaussians`, those of the member, at parameters (P + 4,), of which the last 4 displace control points."""
        displacement = parameters[-len(self.steps) :].double().cpu().numpy() * np.array(self.steps)  # [4]
        return self._offsets(gaussians, displaced(self.base, displacement.tolist()))

    def deformed(self, gaussians: Gaussians, parameters: Tensor) -> Gaussians:
        """The member's Gaussians under the displaced transfer function."""
        return self.offsets(gaussians, parameters).applied_to(gaussians)

    def under(self, gaussians: Gaussians, function: TransferFunction) -> Gaussians:
        """The member's Gaussians under any transfer function."""
        return self._offsets(gaussians, function).applied_to(gaussians)

    @cached_property
    def _base_table(self) -> NDArray[np.float64]:
        return _table(self.base, self.values)  # [B, 4]

    def _offsets(self, gaussians: Gaussians, function: TransferFunction) -> Offsets:
        table, units = _table(function, self.values), self.base.opacity_unit_distance / function.opacity_unit_distance
        change = torch.from_numpy(units * table - self._base_table)  # [B, 4]
        sums = _SizesTimes.apply(self.weights, change.to(self.weights))  # [N, 4]
        depth_change, emission_change = sums[:, 0], sums[:, 1:]  # [N], [N, 3]
        before = torch.nn.functional.softplus(gaussians.opacity_logits)  # [N]
        after = (before + depth_change).clamp(min=LEAST_DEPTH)  # [N]
        kept = before.clamp(min=LEAST_DEPTH)  # so that no change is none, bit for bit
        logits = _logit_of_depth(after) - _logit_of_depth(kept)  # [N]
        base_colors = gaussians.colors[:, :3]  # [N, 3]
        free = base_colors + (emission_change - base_colors * depth_change[:, None]) / after[:, None]  # [N, 3]
        colors = _between(free, base_colors, function) - base_colors  # [N, 3]
        still = torch.zeros_like
        return Offsets(still(gaussians.means), still(gaussians.log_scales), still(gaussians.quats), logits, colors)

    def tensors(self) -> dict[str, Tensor]:
        """Everything that is trained, by name."""
        return {"weights": self.weights}

    def stored(self) -> dict[str, Tensor]:
        """The same."""
        return self.tensors()

    def moves(self, attribute: str) -> bool:
        """Whether this attribute follows the parameters."""
        return attribute in ("opacity_logits", "colors")

    def without(self, attribute: str) -> ValuesDeformation:
        """Raises ValueError for opacity and colour, which only follow together."""
        if self.moves(attribute):
            raise ValueError(f"{attribute} can't hold still under a transfer function that is applied")
        return self

    def of(self, rows: Tensor) -> ValuesDeformation:
        """The weights of some of the Gaussians, by index (M,)."""
        return replace(self, weights=self.weights[rows])

    def to(self, device: torch.device) -> ValuesDeformation:
        """The same on another device."""
        return replace(self, weights=self.weights.to(device))

    def copy(self) -> ValuesDeformation:
        """The same numbers in a tensor of their own."""
        return replace(self, weights=self.weights.detach().clone())

    @property
    def latent_size(self) -> int:
        """B, the number of values."""
        return self.weights.shape[1]

    def reduced(self, size: int, places: Sequence[Tensor]) -> ValuesDeformation:
        """The same: values are no modes that could be combined."""
        return self

    def rates(self, settings: TrainingSettings) -> dict[str, float]:
        """Adam's rate for the weights."""
        return {"weights": settings.value_rate}

    def record(self) -> dict[str, Any]:
        """The base transfer function, the values and the steps."""
        return {"base": asdict(self.base), "values": self.values.tolist(), "steps": list(self.steps)}


def _between(colors: Tensor, own: Tensor, function: TransferFunction) -> Tensor:
    """Colours (N, 3) cut to the range of the function's and of the Gaussians' own: thin Gaussians would take on any."""
    palette = torch.tensor([point[1:] for point in function.color_points]).to(colors)  # [P, 3]
    return torch.clamp(colors, torch.minimum(own, palette.amin(0)), torch.maximum(own, palette.amax(0)))


def placed_values(
    count: int, bounds: tuple[float, float], histogram: NDArray[np.int64] | None, edges: NDArray[np.float64] | None
) -> NDArray[np.float64]:
    """`count` increasing values that span `bounds`, denser where the field has more of its volume.

    Half of their density is even, half follows the square root of the field's histogram (K,) over `edges` (K + 1,): a transfer
    function's control point may stand anywhere, but most pictures are made of the frequent values.  Even where both are None.
    """
    low, high = bounds
    if histogram is None or edges is None or not histogram.sum():
        return np.linspace(low, high, count)
    fine = np.linspace(low, high, FINE + 1)  # [FINE + 1]
    places = (fine[1:] + fine[:-1]) / 2.0  # [FINE]
    frequency = np.interp(places, (edges[1:] + edges[:-1]) / 2.0, histogram)  # [FINE]
    density = np.sqrt(np.where((places >= edges[0]) & (places <= edges[-1]), frequency, 0.0))  # [FINE]
    density = density / max(density.sum(), 1e-300) + 1.0 / FINE  # [FINE]
    cumulative = np.concatenate([[0.0], np.cumsum(density)])  # [FINE + 1]
    return np.interp(np.linspace(0.0, cumulative[-1], count), cumulative, fine)


def _table(function: TransferFunction, values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Extinction, and extinction times colour, at each of B increasing values: (B, 4), in units of the function's distance.

    Each is the mean over the values around, weighted by the hat function that linear interpolation between the values gives.
    """
    inside = (np.arange(SAMPLES) + 0.5) / SAMPLES  # [S], places between two values
    fine = values[:-1, None] + np.diff(values)[:, None] * inside  # [B - 1, S]
    extinctions = -np.log1p(-np.minimum(function.opacities(fine), MOST_OPAQUE))  # [B - 1, S]
    columns = np.concatenate([extinctions[..., None], extinctions[..., None] * function.colors(fine)], axis=2)
    lengths = np.diff(values)[:, None]  # [B - 1, 1]
    rising = (
        lengths * np.einsum("s,bsc->bc", inside, columns) / SAMPLES
    )  # [B - 1, 4], to the upper value of each interval
    falling = lengths * np.einsum("s,bsc->bc", 1.0 - inside, columns) / SAMPLES
    total = np.pad(rising, ((1, 0), (0, 0))) + np.pad(falling, ((0, 1), (0, 0)))  # [B, 4]
    weight = np.pad(lengths, ((1, 0), (0, 0))) / 2.0 + np.pad(lengths, ((0, 1), (0, 0))) / 2.0  # [B, 1]
    return total / weight


class _SizesTimes(torch.autograd.Function):
    """Absolute weights (N, B) times a table (B, 4), with a gradient for the weights alone.

    The gradient at zero is not zero as that of torch's absolute value is: a weight of zero could never grow.
    """

    @staticmethod
    def forward(ctx: Any, *inputs: Tensor) -> Tensor:
        weights, table = inputs
        ctx.save_for_backward(weights, table)
        return weights.abs() @ table

    @staticmethod
    def backward(ctx: Any, *gradients: Tensor) -> tuple[Tensor, None]:
        weights, table = ctx.saved_tensors
        return torch.copysign(torch.ones((), dtype=weights.dtype), weights).mul_(gradients[0] @ table.T), None


def _logit_of_depth(depths: Tensor) -> Tensor:
    """The logit of the opacity 1 - exp(-depth), (N,): ln(exp(depth) - 1), without overflow."""
    return depths + torch.log(-torch.expm1(-depths))
