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
    values : (B,) field values, evenly spread over the base's bounds.
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
        cls, gaussians: Gaussians, base: TransferFunction, steps: Sequence[float], settings: TrainingSettings
    ) -> ValuesDeformation:
        """Weights that give every Gaussian its optical depth under `base`, on the values whose colours are most like its own."""
        values = np.linspace(*base.bounds, settings.value_bins)  # [B]
        table = torch.from_numpy(_table(base, values))  # [B, 4]
        extinctions, emissions = table[:, 0], table[:, 1:]
        colors = emissions / extinctions.clamp(min=1e-9)[:, None]  # [B, 3]
        distances = torch.cdist(gaussians.colors[:, :3].detach().cpu().double(), colors)  # [N, B]
        nearest = distances.amin(dim=1, keepdim=True)  # [N, 1]
        alike = torch.exp(-0.5 * ((distances - nearest) / COLOR_SPREAD) ** 2)  # [N, B]
        alike = alike * torch.where(extinctions > 0, 1.0, 0.0)
        depths = torch.nn.functional.softplus(gaussians.opacity_logits.detach().cpu().double())  # [N]
        scale = depths / (alike @ extinctions).clamp(min=1e-9)  # [N]
        weights = (alike * scale[:, None]).float().to(gaussians.means.device)
        return cls(weights, base, values, tuple(map(float, steps)))

    @classmethod
    def load(cls, tensors: Mapping[str, Tensor], record: Mapping[str, Any]) -> ValuesDeformation:
        """The deformation of `stored()` and `record()`."""
        base = TransferFunction(**record["base"])
        values = np.linspace(*base.bounds, tensors["weights"].shape[1])
        return cls(tensors["weights"], base, values, tuple(record["steps"]))

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

    def _offsets(self, gaussians: Gaussians, function: TransferFunction) -> Offsets:
        change = _table(function, self.values) - _table(self.base, self.values)  # [B, 4]
        sums = self.weights.abs() @ torch.from_numpy(change).to(self.weights)  # [N, 4]
        depth_change, emission_change = sums[:, 0], sums[:, 1:]  # [N], [N, 3]
        before = torch.nn.functional.softplus(gaussians.opacity_logits)  # [N]
        after = (before + depth_change).clamp(min=LEAST_DEPTH)  # [N]
        kept = before.clamp(min=LEAST_DEPTH)  # so that no change is none, bit for bit
        logits = _logit_of_depth(after) - _logit_of_depth(kept)  # [N]
        base_colors = gaussians.colors[:, :3]  # [N, 3]
        colors = (emission_change - base_colors * depth_change[:, None]) / after[:, None]  # [N, 3]
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
        """The base transfer function and the steps."""
        return {"base": asdict(self.base), "steps": list(self.steps)}


def _table(function: TransferFunction, values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Extinction, and extinction times colour, at each of B evenly spaced values: (B, 4), in units of the function's distance.

    Each is the mean over the values around, weighted by the hat function that linear interpolation between the values gives.
    """
    fine = np.linspace(values[0], values[-1], (len(values) - 1) * SAMPLES + 1)  # [F]
    extinctions = -np.log1p(-np.minimum(function.opacities(fine), MOST_OPAQUE))  # [F]
    columns = np.concatenate([extinctions[:, None], extinctions[:, None] * function.colors(fine)], axis=1)  # [F, 4]
    offsets = np.arange(-SAMPLES, SAMPLES + 1) / SAMPLES  # [2 SAMPLES + 1]
    hat = 1.0 - np.abs(offsets)
    padded = np.pad(columns, ((SAMPLES, SAMPLES), (0, 0)))  # [F + 2 SAMPLES, 4]
    inside = np.pad(np.ones(len(fine)), SAMPLES)
    means = [
        hat @ padded[i * SAMPLES : i * SAMPLES + len(hat)] / (hat @ inside[i * SAMPLES : i * SAMPLES + len(hat)])
        for i in range(len(values))
    ]
    return np.stack(means)


def _logit_of_depth(depths: Tensor) -> Tensor:
    """The logit of the opacity 1 - exp(-depth), (N,): ln(exp(depth) - 1), without overflow."""
    return depths + torch.log(-torch.expm1(-depths))
