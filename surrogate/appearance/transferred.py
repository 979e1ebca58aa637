"""Gaussians that carry a field value, its spread and a thickness, under a transfer function: by the C++ kernel, and by its twin.

The extinction tau and the emission e of the function are averaged under N(u, s²).  Thickness is optical depth where
the extinction is 1.  A Gaussian of thickness h has optical depth h tau and colour e / tau (Max 1995, equations 1 to 3).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from catalogs.vocabulary.words import one_line
from native import kernels
from native.threads import cores
from surrogate.appearance.averages import HIGHEST, LEAST_SPREAD, LOWEST, MOST_SPREAD, Nodes, averages_reference
from surrogate.derivatives import require_no_second_derivative

Array = NDArray[np.float32]
Row = Sequence[float]

LEAST_DEPTH = 1e-4  # a Gaussian thinner than this is never drawn (alpha 1/255)
MOST_DEPTH = 12.0  # as good as opaque
RANGES = (LOWEST, HIGHEST, LEAST_SPREAD, MOST_SPREAD)
DARK = 1e-6  # of the largest extinction: below that share a colour has lost its digits


@dataclass(frozen=True, eq=False)
class AverageTable:
    """A transfer function averaged over normally distributed values.

    Attributes
    ----------
    nodes : what the function consists of.
    """

    nodes: Nodes

    __repr__ = one_line

    @classmethod
    def of(cls, nodes: Nodes) -> AverageTable:
        """The table of a function of these nodes."""
        return cls(nodes)

    @cached_property
    def cells(self) -> NDArray[np.float32]:
        """The kernel's table of `kernels.averages`, made when first needed."""
        return kernels.averages(self.nodes.places, self.nodes.columns, RANGES)

    @cached_property
    def range(self) -> tuple[list[float], list[float]]:
        """The lowest and the highest red, green and blue of what absorbs, (3,) each; black where nothing does."""
        opaque = self.nodes.columns[self.nodes.columns[:, 0] > 0.0]  # [K', 4]
        colors = opaque[:, 1:] / opaque[:, :1] if len(opaque) else np.zeros((1, 3))  # [K', 3]
        return colors.min(axis=0).tolist(), colors.max(axis=0).tolist()

    @cached_property
    def dark(self) -> float:
        """The averaged extinction below which colours fade to the lowest."""
        return max(DARK * float(self.nodes.columns[:, 0].max()), 1e-30)


def apply(table: AverageTable, logits: Tensor, values: Tensor) -> tuple[Tensor, Tensor]:
    """Logits (N,) of opacity and colours (N, 3) of Gaussians under the function of `table`; differentiable by both tensors.

    Values, spreads and depths are clamped to LOWEST to HIGHEST, LEAST_SPREAD to MOST_SPREAD and LEAST_DEPTH to MOST_DEPTH.  Beyond
    an end the derivative is that at the end where a step of descent would lead back inside, else zero.  On a CPU in float32 the
    kernel does it, else `apply_reference`.

    Parameters
    ----------
    logits : (N,) of the opacities that the Gaussians would have where the extinction is 1: their thickness is the softplus of it.
    values : (N, 2) the mean u of each Gaussian's values, and the logarithm of their standard deviation s.
    """
    single = logits.dtype == values.dtype == torch.float32
    if not single or not logits.is_cpu or not values.is_cpu:
        return apply_reference(table, logits, values)
    applied = _Applied.apply if torch.is_grad_enabled() else _applied
    return applied(table, logits, values)


def _applied(table: AverageTable, logits: Tensor, values: Tensor) -> tuple[Tensor, Tensor]:
    """New logits (N,) and colours (N, 3) by the kernel."""
    arrays = kernels.apply_averages(*_arguments(table, logits, values), cores())
    return torch.from_numpy(arrays[0]), torch.from_numpy(arrays[1])


class _Applied(torch.autograd.Function):
    """`_applied` with its derivative by logits and values."""

    @staticmethod
    def forward(ctx: Any, *inputs: Any) -> tuple[Tensor, Tensor]:
        ctx.table, logits, values = inputs
        ctx.save_for_backward(logits, values)
        return _applied(*inputs)

    @staticmethod
    def backward(ctx: Any, *gradients: Tensor) -> tuple[Tensor | None, ...]:
        require_no_second_derivative("apply", "apply_reference")
        arguments = _arguments(ctx.table, *ctx.saved_tensors)
        by_new_logits, by_colors = (gradient.numpy() for gradient in gradients)
        by_input = kernels.apply_averages_gradient(*arguments, by_new_logits, by_colors, cores())
        return None, torch.from_numpy(by_input[0]), torch.from_numpy(by_input[1])


def _arguments(table: AverageTable, logits: Tensor, values: Tensor) -> tuple[Array, Row, Array, Array, Row, Row, Row]:
    limits = (table.dark, LEAST_DEPTH, MOST_DEPTH)
    return table.cells, RANGES, logits.detach().numpy(), values.detach().numpy(), *table.range, limits


def apply_reference(table: AverageTable, logits: Tensor, values: Tensor) -> tuple[Tensor, Tensor]:
    """The same in plain torch, on any device and in any float dtype: the definition that the kernel is tested against."""
    means = clamped(values[:, 0], LOWEST, HIGHEST)  # [N]
    log_spreads = clamped(values[:, 1], math.log(LEAST_SPREAD), math.log(MOST_SPREAD))  # [N]
    averages = averages_reference(table.nodes, means, log_spreads)  # [N, 4]
    extinctions, emissions = averages[:, 0], averages[:, 1:]  # [N], [N, 3]
    depths = clamped(torch.nn.functional.softplus(logits) * extinctions, LEAST_DEPTH, MOST_DEPTH)  # [N]
    low, high = (torch.tensor(row).to(values) for row in table.range)  # [3], [3]
    return logit_of_depth(depths), clamped(emissions / extinctions.clamp(min=table.dark)[:, None], low, high)


def logit_of_depth(depths: Tensor) -> Tensor:
    """The logit of the opacity 1 - exp(-depth), (N,): ln(exp(depth) - 1), without overflow."""
    return depths + torch.log(-torch.expm1(-depths))


def clamped(numbers: Tensor, low: float | Tensor, high: float | Tensor) -> Tensor:
    """Numbers cut to a range.  Where they reach its ends, gradients pass whose descent leads back inside; NaN stays."""
    return _Held.apply(numbers, low, high)


class _Held(torch.autograd.Function):
    """torch's `clamp` has a derivative of zero outside: what once left the range would never come back."""

    @staticmethod
    def forward(ctx: Any, *inputs: Any) -> Tensor:
        numbers, low, high = inputs
        ctx.save_for_backward(numbers <= low, numbers >= high)
        return torch.clamp(numbers, low, high)

    @staticmethod
    def backward(ctx: Any, *gradients: Tensor) -> tuple[Tensor | None, ...]:
        below, above = ctx.saved_tensors
        (gradient,) = gradients
        return gradient.masked_fill((below & (gradient > 0.0)) | (above & (gradient < 0.0)), 0.0), None, None
