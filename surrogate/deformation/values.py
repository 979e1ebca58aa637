"""A visualization deformation that applies transfer functions: each Gaussian has weights of field values.

A Gaussian i has weights W_ib >= 0 of B field values: how much optical depth it would have if only value b had unit extinction.
Under a transfer function with extinctions tau_b and colours c_b its optical depth and emission, both sums over what it covers, are

    kappa_i = sum_b W_ib tau_b,        kappa_i c_i = sum_b W_ib tau_b c_b

(emission and absorption, Max 1995, equations 1 to 3).  Only differences to the base transfer function are added, so the base stays
as it was, bit for bit.  Any other transfer function can be applied, also with colours that no training image showed.  The optical
depth of a splat of opacity o is kappa = -ln(1 - o).
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

from catalogs.vocabulary.appearance import TransferFunction
from catalogs.vocabulary.numbers import row
from catalogs.vocabulary.variations import POINT_PARAMETERS, displaced
from catalogs.vocabulary.words import joined_names, one_line
from surrogate.appearance.field_gaussians import AnyGaussians
from surrogate.deformation.extinction import differentiable_table, extinction_table
from surrogate.deformation.offsets import Offsets
from surrogate.deformation.transfer import Transfer
from surrogate.gaussians import Gaussians
from surrogate.settings import TrainingSettings

VALUE_BINS = 32  # field values for which each Gaussian has weights
VALUE_RATE = 2e-3  # Adam's step size for the weights
FINE = 1024  # places at which the density of values is taken
COLOR_SPREAD = 0.1  # how far the colour of a value may lie from a Gaussian's to be thought its own at first


def displaced_by(base: TransferFunction, steps: Sequence[float], parameters: Tensor) -> TransferFunction:
    """`base` with its inner control points moved by normalized parameters (4,) times `steps`."""
    return displaced(base, [step * place for step, place in zip(steps, parameters.tolist(), strict=True)])


@dataclass(frozen=True, eq=False)
class ValuesDeformation:
    """Weights of field values.

    Attributes
    ----------
    weights : (N, B), whose absolute values are W.
    base : the transfer function at which the Gaussians are those of the simulation deformation.
    values : (B,) increasing field values that span the base's bounds.
    steps : (4,) the displacements that normalized visualization parameters are in units of.
    """

    weights: Tensor  # [N, B]
    base: TransferFunction
    values: NDArray[np.float64]  # [B]
    steps: tuple[float, ...]

    kind: ClassVar[str] = "values"

    __repr__ = one_line

    @property
    def per_gaussian(self) -> frozenset[str]:
        """The names in `tensors` that have one row per Gaussian."""
        return frozenset({"weights"})

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
        table = torch.from_numpy(extinction_table(base, values))  # [B, 4]
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
        """The deformation of `stored()` and `record()`; raises ValueError where they do not belong together."""
        count = len(record["values"]) if isinstance(record["values"], list) else 0
        values = np.array(row(record["values"], count, "values"))  # [B]
        fits = set(tensors) == {"weights"} and tensors["weights"].ndim == 2
        if not fits or tensors["weights"].shape[1] != count or count < 2 or not (np.diff(values) > 0).all():
            raise ValueError(f"weights of {count} increasing values are needed, got {joined_names(sorted(tensors))}")
        base = TransferFunction(**record["base"])
        steps = row(record["steps"], len(POINT_PARAMETERS), "steps")
        if len(base.opacity_points) != 4 or min(steps) <= 0.0:
            raise ValueError(f"base must have four opacity points, and steps be positive, got {base} and {steps}")
        return cls(tensors["weights"], base, values, steps)

    def offsets(self, gaussians: AnyGaussians, parameters: Tensor) -> Offsets:
        """Offsets of `gaussians`, those of the member, at parameters (P + 4,), of which the last 4 displace control points."""
        return self._transfer(self._displaced(parameters)).offsets(gaussians.drawn(), self.weights)

    def deformed(self, gaussians: AnyGaussians, parameters: Tensor) -> Gaussians:
        """The member's Gaussians under the displaced transfer function: by torch where its gradient by that is asked for."""
        base = gaussians.drawn()
        if torch.is_grad_enabled() and parameters.requires_grad:
            return self._moving(parameters).offsets(base, self.weights).applied_to(base).drawn()
        return self.under(base, self._displaced(parameters))

    def under(self, gaussians: Gaussians, function: TransferFunction) -> Gaussians:
        """The member's Gaussians under any transfer function."""
        return self._transfer(function).applied_to(gaussians, self.weights)

    def _displaced(self, parameters: Tensor) -> TransferFunction:
        return displaced_by(self.base, self.steps, parameters[-len(self.steps) :])

    def _moving(self, parameters: Tensor) -> Transfer:
        """The transfer at parameters (P + 4,), differentiable by them."""
        function = self._displaced(parameters.detach())
        points = torch.tensor(self.base.opacity_points, dtype=torch.float64)  # [4, 2]
        moved = torch.tensor(self.steps) * parameters[-len(self.steps) :].cpu().double()  # [4]
        table = differentiable_table(
            function, points + torch.nn.functional.pad(moved.view(2, 2), (0, 0, 1, 1)), self.values
        )
        return Transfer(table - torch.from_numpy(self._base_means), tuple(p[1:] for p in function.color_points))

    def _transfer(self, function: TransferFunction) -> Transfer:
        units = self.base.opacity_unit_distance / function.opacity_unit_distance
        changes = units * extinction_table(function, self.values) - self._base_means  # [B, 4]
        return Transfer(changes, tuple(point[1:] for point in function.color_points))

    @cached_property
    def _base_means(self) -> NDArray[np.float64]:
        return extinction_table(self.base, self.values)  # [B, 4]

    def tensors(self) -> dict[str, Tensor]:
        """Everything that is trained, by name."""
        return {"weights": self.weights}

    def stored(self) -> dict[str, Tensor]:
        """The same."""
        return self.tensors()

    def of(self, rows: Tensor) -> ValuesDeformation:
        """The weights of some of the Gaussians, by index (M,)."""
        return replace(self, weights=self.weights[rows])

    def to(self, device: torch.device | torch.dtype) -> ValuesDeformation:
        """The same on another device, or in another precision."""
        return replace(self, weights=self.weights.to(device))

    def copy(self) -> ValuesDeformation:
        """The same numbers in a tensor of their own."""
        return replace(self, weights=self.weights.detach().clone())

    def with_tensors(self, tensors: Mapping[str, Tensor]) -> ValuesDeformation:
        """The same with other weights."""
        return replace(self, weights=tensors["weights"])

    def rates(self, settings: TrainingSettings) -> dict[str, float]:
        """Adam's rate for the weights."""
        return {"weights": VALUE_RATE}

    def record(self) -> dict[str, Any]:
        """The kind, the base transfer function, the values and the steps."""
        values = {"values": self.values.tolist(), "steps": list(self.steps)}
        return {"kind": self.kind, "base": asdict(self.base)} | values


def placed_values(
    count: int, bounds: tuple[float, float], histogram: NDArray[np.int64] | None, edges: NDArray[np.float64] | None
) -> NDArray[np.float64]:
    """`count` increasing values that span `bounds`, denser where the field has more of its volume.

    Half of their density is even, half follows the square root of the field's histogram (K,) over `edges` (K + 1,).  All of it is
    even where both are None.
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
