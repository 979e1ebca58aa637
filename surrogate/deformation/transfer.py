"""Gaussians under a changed transfer function: by the C++ kernel, and by its reference implementation.

Gaussian i has weights W_ib >= 0 of B field values, at which the extinction changes by T_b0, and the extinction times each
colour by T_bc, c = 1, 2, 3.  So its optical depth kappa_i and its emission kappa_i c_i change by the sums

    sum_b W_ib T_b0        and        sum_b W_ib T_bc
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from catalogs.vocabulary.words import one_line
from native import kernels
from native.threads import cores
from surrogate.appearance.transferred import LEAST_DEPTH, logit_of_depth
from surrogate.deformation.offsets import Offsets
from surrogate.derivatives import require_no_second_derivative
from surrogate.gaussians import Gaussians

Array = NDArray[np.float32]


@dataclass(frozen=True, eq=False)
class Transfer:
    """The difference of a transfer function from the base.

    Attributes
    ----------
    changes : (B, 4) of the extinction, and of the extinction times each colour, at B field values, in the unit distance of the
        base.  A tensor has gradients in `offsets`.
    palette : red, green and blue of each of the function's control points.
    """

    changes: NDArray[np.float64] | Tensor
    palette: Sequence[tuple[float, float, float]]

    __repr__ = one_line

    def applied_to(self, gaussians: Gaussians, weights: Tensor) -> Gaussians:
        """The Gaussians of weights (N, B), whose absolute values are W, with logits and colours in new tensors.

        On a CPU in float32 the kernel does it, else `offsets`, which also has the derivative by the Gaussians.
        """
        logits, colors = gaussians.opacity_logits, gaussians.colors
        moving = torch.is_grad_enabled() and (logits.requires_grad or colors.requires_grad)
        single = weights.dtype == logits.dtype == colors.dtype == torch.float32
        if moving or not single or not weights.is_cpu:
            return self.offsets(gaussians, weights).applied_to(gaussians).drawn()
        transferred = _Transferred.apply if torch.is_grad_enabled() else _transferred
        logits, colors = transferred(weights, logits, colors, self)
        return replace(gaussians, opacity_logits=logits, colors=colors)

    def offsets(self, gaussians: Gaussians, weights: Tensor) -> Offsets:
        """Offsets of the opacities' logits and of the colours' first three columns; of all else zero."""
        changes = self.changes if isinstance(self.changes, Tensor) else torch.from_numpy(self.changes)  # [B, 4]
        sums = _SizesTimes.apply(weights, changes.to(weights))  # [N, 4]
        depth_change, emission_change = sums[:, 0], sums[:, 1:]  # [N], [N, 3]
        before = torch.nn.functional.softplus(gaussians.opacity_logits)  # [N]
        after = (before + depth_change).clamp(min=LEAST_DEPTH)  # [N]
        depths = before.clamp(min=LEAST_DEPTH)  # so that no change is none, bit for bit
        logits = logit_of_depth(after) - logit_of_depth(depths)  # [N]
        base_colors = gaussians.colors[:, :3]  # [N, 3]
        free = base_colors + (emission_change - base_colors * depth_change[:, None]) / after[:, None]  # [N, 3]
        colors = self._between(free, base_colors) - base_colors  # [N, 3]
        still = torch.zeros_like
        return Offsets(still(gaussians.means), still(gaussians.log_scales), still(gaussians.quats), logits, colors)

    @property
    def range(self) -> tuple[list[float], list[float]]:
        """The lowest and the highest of each of the palette's colours, (3,) each."""
        columns = list(zip(*self.palette, strict=True))  # [3, P]
        return [min(column) for column in columns], [max(column) for column in columns]

    def _between(self, colors: Tensor, own: Tensor) -> Tensor:
        """Colours (N, 3) cut to the range of the function's and of the Gaussians' own: thin Gaussians would take on any."""
        low, high = (torch.tensor(row).to(colors) for row in self.range)  # [3], [3]
        return torch.clamp(colors, torch.minimum(own, low), torch.maximum(own, high))


def _transferred(weights: Tensor, logits: Tensor, colors: Tensor, transfer: Transfer) -> tuple[Tensor, Tensor]:
    """New logits (N,) and colours (N, 3 K) by the kernel."""
    arrays = kernels.transfer(*_arguments(transfer, weights, logits, colors), cores())
    return torch.from_numpy(arrays[0]), torch.from_numpy(arrays[1])


class _Transferred(torch.autograd.Function):
    """`_transferred` with its derivative by the weights (N, B) alone."""

    @staticmethod
    def forward(ctx: Any, *inputs: Any) -> tuple[Tensor, Tensor]:
        *tensors, ctx.transfer = inputs
        ctx.save_for_backward(*tensors)
        return _transferred(*inputs)

    @staticmethod
    def backward(ctx: Any, *gradients: Tensor) -> tuple[Tensor | None, ...]:
        require_no_second_derivative()
        arguments = _arguments(ctx.transfer, *ctx.saved_tensors)
        by_logits, by_colors = (gradient.numpy() for gradient in gradients)
        by_weights = kernels.transfer_gradient(*arguments, by_logits, by_colors, cores())
        return torch.from_numpy(by_weights), None, None, None


def _arguments(
    transfer: Transfer, weights: Tensor, logits: Tensor, colors: Tensor
) -> tuple[Array, Array, Array, Array, list[float], list[float], float]:
    arrays = [tensor.detach().numpy() for tensor in (weights, logits, colors)]
    changes = np.asarray(transfer.changes, dtype=np.float32)
    return arrays[0], changes, arrays[1], arrays[2], *transfer.range, LEAST_DEPTH


class _SizesTimes(torch.autograd.Function):
    """Absolute weights (N, B) times a table (B, 4).

    The gradient at zero is not zero as that of torch's absolute value is: a weight of zero could never grow.
    """

    @staticmethod
    def forward(ctx: Any, *inputs: Tensor) -> Tensor:
        weights, table = inputs
        ctx.save_for_backward(weights, table)
        return weights.abs() @ table

    @staticmethod
    def backward(ctx: Any, *gradients: Tensor) -> tuple[Tensor, Tensor | None]:
        weights, table = ctx.saved_tensors
        by_weights = torch.copysign(torch.ones((), dtype=weights.dtype), weights) * (gradients[0] @ table.T)
        return by_weights, weights.abs().T @ gradients[0] if ctx.needs_input_grad[1] else None
