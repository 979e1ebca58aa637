"""Values of an emulated field in Gaussians: they follow the parameters as the emulator does, and training learns what is left.

The value that Gaussian i carries changes with the parameters p by

    a (s(m_i + sum_k c_k(p) B_ik) - s(m_i))

besides its offset.  Here m_i and B_ik are the emulator's mean and modes at the Gaussian's place when training began.  The means
of the emulator's Gaussian processes are c_k(p), and s is the scale of carried values.

The share a is a half: offsets learn the other half, and all that is finer, moves, or is wrong with the emulator.  So between
members the values are the mean of two predictions whose errors differ.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from catalogs.vocabulary.numbers import fraction
from catalogs.vocabulary.words import one_line
from surrogate.appearance.field_gaussians import FieldGaussians
from surrogate.appearance.scale import ValueScale
from surrogate.emulation.processes import Processes
from surrogate.emulation.storage import processes_of

PER_GAUSSIAN = ("emulated_means", "emulated_modes")
# Of the processes; they are stored in float32 whatever else is rounded, for predictions between members are ill-conditioned.
EXACT = ("emulated_points", "emulated_coefficients", "emulated_lengths", "emulated_noises")
SHARE = 0.5
BEYOND = 0.2  # of the scale, by which emulated values may lie outside its ends
RIDGE = 0.01  # of `EmulatedValues.like`
TINY = 1e-24  # squared distance, below which a derivative by the parameters is zero


@dataclass(frozen=True, eq=False)
class EmulatedValues:
    """The emulated field in N Gaussians.

    Attributes
    ----------
    means, modes : (N,) and (N, K), in the field's unit, or on the scale of carried values where `scale` is None.
    processes : through the coefficients of the K modes.
    scale : of carried values.
    share : of the emulator's prediction, a.
    """

    means: Tensor  # [N]
    modes: Tensor  # [N, K]
    processes: Processes
    scale: ValueScale | None = None
    share: float = SHARE

    __repr__ = one_line

    def added_to(self, gaussians: FieldGaussians, parameters: Tensor) -> FieldGaussians:
        """The Gaussians whose values follow the field at normalized `parameters` (P,), differentiable by them alone."""
        with torch.set_grad_enabled(parameters.requires_grad and torch.is_grad_enabled()):
            shifts = self.shifts(parameters)  # [N]
        values = torch.stack([gaussians.values[:, 0] + shifts, gaussians.values[:, 1]], dim=1)
        return replace(gaussians, values=values)

    def shifts(self, parameters: Tensor) -> Tensor:
        """The changes of the values (N,) on their scale, from the mean of the members, at normalized parameters (P,)."""
        return self.shifts_of(self.coefficients(parameters))

    def shifts_of(self, coefficients: Tensor) -> Tensor:
        """The same by coefficients (K,) of the modes."""
        return self.share * (self._carried_by(coefficients) - self._carried(self.means.detach()))

    def like(self, before: EmulatedValues) -> EmulatedValues:
        """The same with means and modes that differ as little as lets the members that `before` knows keep their values.

        Ridge regression of these values (M, N) on a constant and the coefficients (M, K), of the size that each has.
        """
        points = torch.from_numpy(before.processes.points)  # [M, P]
        ones = torch.ones(1, dtype=torch.float64)
        factors = torch.stack([torch.cat([ones, self.coefficients(point)]) for point in points])  # [M, 1 + K]
        sizes = factors.std(dim=0, correction=0)  # [1 + K]
        sizes = torch.where(sizes > 0.0, sizes, 1.0)
        factors, own = (
            factors / sizes,
            torch.cat([self.means[:, None], self.modes], dim=1).double() * sizes,
        )  # [N, 1 + K]
        error = torch.zeros_like(own)  # [N, 1 + K]
        for point, row in zip(points, factors, strict=True):
            error += torch.outer(self._uncarried(before.carried(point)).double() - own @ row, row)
        gram = factors.T @ factors  # [1 + K, 1 + K]
        ridge = RIDGE * gram.diagonal().mean() * torch.eye(len(gram))
        table = ((own + torch.linalg.solve(gram + ridge, error.T).T) / sizes).to(self.means)
        return replace(self, means=table[:, 0].contiguous(), modes=table[:, 1:].contiguous())

    def carried(self, parameters: Tensor) -> Tensor:
        """The emulated field (N,) on the scale of carried values, at normalized parameters (P,)."""
        return self._carried_by(self.coefficients(parameters))

    def _carried_by(self, coefficients: Tensor) -> Tensor:
        return self._carried(torch.addmv(self.means.detach(), self.modes.detach(), coefficients.to(self.means)))

    @property
    def carried_means(self) -> Tensor:
        """The means (N,) on the scale of carried values."""
        return self._carried(self.means)

    def coefficients(self, parameters: Tensor) -> Tensor:
        """The means (K,) of the processes at normalized parameters (P,), float64 (Rasmussen & Williams 2006, equation 2.25)."""
        points, weights, lengths, groups = self._predictor
        squares = ((parameters.double().cpu() - points) ** 2) @ (lengths**-2.0).T  # [M, G]
        scaled = torch.sqrt(5.0 * squares + TINY)  # [M, G]
        covariances = (1.0 + scaled + scaled**2 / 3.0) * torch.exp(-scaled)  # equation 4.17
        return (covariances[:, groups] * weights).sum(dim=0)

    @cached_property
    def _predictor(self) -> tuple[Tensor, Tensor, Tensor, Tensor]:
        processes = self.processes
        arrays = (processes.points, processes.weights, processes.lengths, processes.groups)
        points, weights, lengths, groups = (torch.from_numpy(array) for array in arrays)
        return points, weights, lengths, groups

    @cached_property
    def _bends(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Values and places (J + 2,) where the scale bends: its knots, and where places are cut."""
        assert self.scale is not None
        places = np.concatenate([[-BEYOND], np.linspace(0.0, 1.0, len(self.scale.knots)), [1.0 + BEYOND]])
        return self.scale.values(places), places

    def _carried(self, values: Tensor) -> Tensor:
        """Values (N,) on the scale of carried ones, cut beyond its ends; see `ValueScale.places`."""
        if self.scale is None:
            return values.clamp(-BEYOND, 1.0 + BEYOND)
        if values.is_cpu and not values.requires_grad:  # which numpy does in a third of the time
            return torch.from_numpy(np.interp(values.numpy(), *self._bends)).to(values)
        knots = torch.from_numpy(self.scale.knots).to(values)  # [J]
        last = len(knots) - 1
        low = torch.bucketize(values.detach(), knots[1:-1].contiguous(), right=True)  # [N]
        shares = (values - knots[low]) / (knots[low + 1] - knots[low])
        return ((low + shares) / last).clamp(-BEYOND, 1.0 + BEYOND)

    def _uncarried(self, places: Tensor) -> Tensor:
        """The values (N,) at places on the scale of carried ones."""
        if self.scale is None:
            return places
        values, bends = self._bends
        return torch.from_numpy(np.interp(places.numpy(), bends, values)).to(places)

    def tensors(self) -> dict[str, Tensor]:
        """Those that have a row per Gaussian, by the names of `PER_GAUSSIAN`."""
        return dict(zip(PER_GAUSSIAN, (self.means, self.modes), strict=True))

    def with_tensors(self, tensors: Mapping[str, Tensor]) -> EmulatedValues:
        """The same with others for both of `tensors`."""
        means, modes = (tensors[name] for name in PER_GAUSSIAN)
        return replace(self, means=means, modes=modes)

    def stored(self) -> dict[str, Tensor]:
        """All tensors that `load` needs."""
        processes = self.processes
        arrays = (processes.points, processes.coefficients, processes.lengths, processes.noises)
        return self.tensors() | {n: torch.from_numpy(a).float() for n, a in zip(EXACT, arrays, strict=True)}

    def record(self) -> dict[str, Any]:
        """JSON values that `load` needs beside the tensors."""
        return {
            "groups": self.processes.groups.tolist(),
            "share": self.share,
            "knots": None if self.scale is None else self.scale.to_json(),
        }

    @classmethod
    def load(cls, tensors: Mapping[str, Tensor], record: Mapping[str, Any]) -> EmulatedValues:
        """Those of `stored()` and `record()`; raises ValueError where they do not belong together."""
        means, modes = (tensors[name] for name in PER_GAUSSIAN)
        if means.ndim != 1 or modes.ndim != 2 or len(modes) != len(means):
            raise ValueError(
                f"emulated_means must be (N,) and emulated_modes (N, K), got {list(means.shape)} and {list(modes.shape)}"
            )
        named = {name.removeprefix("emulated_"): tensors[name] for name in EXACT}
        processes = processes_of(named, record["groups"], modes.shape[1])
        scale = None if record["knots"] is None else ValueScale.from_json(record["knots"])
        return cls(means, modes, processes, scale, fraction(record["share"], "share"))

    @property
    def parameters(self) -> int:
        """P, how many it is a function of."""
        return self.processes.points.shape[1]
