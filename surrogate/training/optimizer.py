"""Adam with one rate per named tensor, whose whole state can be saved and edited row by row.

Tensors with a row per Gaussian are moved where their Gaussian has a gradient, and each row counts its own steps.  In an ensemble
most Gaussians show nothing of most members.  With Adam as it is for whole tensors their second moments decay meanwhile, and the
next gradient throws a row thirty times as far as it would have moved.  Where 5 % of the pixels show anything, training diverged.
`torch.optim.SparseAdam` leaves unseen rows as they are too, but has one count for all.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Collection, Iterator, Mapping
from contextlib import contextmanager
from types import MappingProxyType
from typing import NamedTuple

import torch
from torch import Tensor

from native import kernels

DECAY_FIRST, DECAY_SECOND = 0.9, 0.999
EPSILON = 1e-15  # as in 3D Gaussian Splatting: gradients of single Gaussians are far below the usual 1e-8


@contextmanager
def without_subnormals() -> Iterator[None]:
    """Take subnormal numbers for zero, in this thread (training runs torch on one: `surrogate.splatting.threads`).

    Processors are slow with them, and decay ends there, not at zero: 0.9 times the smallest is rounded to itself.  When every row
    decayed, half of the first moments of a training on isosurfaces were such, of Gaussians that no picture showed any more.  In
    shared tensors they still arise.
    """
    before = sys.float_info.min / 2.0 == 0.0
    torch.set_flush_denormal(True)
    try:
        yield
    finally:
        torch.set_flush_denormal(before)


def fused_update(tensor: Tensor, gradient: Tensor, first: Tensor, second: Tensor, steps: Tensor, rate: float) -> None:
    """Move `tensor` and both moments in place, by the kernel under `torch.optim.Adam`, which torch keeps private."""
    torch._fused_adam_(
        *([tensor], [gradient], [first], [second], [], [steps]),
        lr=rate,
        beta1=DECAY_FIRST,
        beta2=DECAY_SECOND,
        eps=EPSILON,
        weight_decay=0.0,
        amsgrad=False,
        maximize=False,
    )


def plain_update(tensor: Tensor, gradient: Tensor, first: Tensor, second: Tensor, steps: Tensor, rate: float) -> None:
    """The same in public operations, for a torch without that kernel."""
    first.lerp_(gradient, 1.0 - DECAY_FIRST)
    second.mul_(DECAY_SECOND).addcmul_(gradient, gradient, value=1.0 - DECAY_SECOND)
    steps = steps.double()  # or 1 - 0.999 keeps four digits
    spread = (second / (1.0 - DECAY_SECOND**steps)).sqrt_().add_(EPSILON)
    tensor.sub_(rate / (1.0 - DECAY_FIRST**steps) * first / spread)


update = fused_update if hasattr(torch, "_fused_adam_") else plain_update


def surprise(gradient: Tensor, second: Tensor, steps: float) -> float:
    """The ratio of a gradient to those lately, in the root mean square of its elements; at least 1.

    `second` is the second moment before it, `steps` counts it.  Divided by it, rates no longer let one step throw far what has seen
    small gradients for long: "update clipping" of Wortsman et al. 2023, "Stable and low-precision training for large-scale
    vision-language models", algorithm 2.
    """
    squares = gradient.square()
    lately = (second * DECAY_SECOND).add_(squares, alpha=1.0 - DECAY_SECOND).clamp_(min=EPSILON**2)
    return max(1.0, math.sqrt(float(squares.div_(lately).mean()) * (1.0 - DECAY_SECOND**steps)))


class Moments(NamedTuple):
    """Adam's memory of a tensor: both moments, of its shape, and how many steps each row has seen (N,) where rows count."""

    first: Tensor
    second: Tensor
    steps: Tensor | None = None

    def tensors(self) -> dict[str, Tensor]:
        """Those that there are, by name."""
        return {name: tensor for name, tensor in self._asdict().items() if tensor is not None}


def step_rows(tensor: Tensor, gradient: Tensor, first: Tensor, second: Tensor, steps: Tensor, rate: float) -> None:
    """Move the rows of `tensor` (N, ...) whose `gradient` is not zero, with their moments and `steps` (N,), in place.

    In main memory and float32 the C++ kernel does it, else the reference implementation.
    """
    tensors = (tensor, gradient, first, second, steps)
    if all(t.is_cpu and t.dtype == torch.float32 and t.is_contiguous() for t in tensors):
        moved, by, mean, square, counts = (t.detach().numpy() for t in tensors)
        kernels.step_rows(moved, by, mean, square, counts, rate)
    else:
        step_rows_reference(*tensors, rate)


def step_rows_reference(
    tensor: Tensor, gradient: Tensor, first: Tensor, second: Tensor, steps: Tensor, rate: float
) -> None:
    """The same in plain torch: the definition that the kernel is tested against.

    Corrections multiply the rate (Kingma & Ba 2015, end of section 2).
    """
    by_row = (-1, *[1] * (tensor.ndim - 1))
    moving = (gradient != 0.0).reshape(len(tensor), math.prod(tensor.shape[1:])).any(dim=1)  # [N]
    steps.add_(moving)
    mask, count = moving.view(by_row), steps.double().clamp(min=1.0).view(by_row)
    first.copy_(torch.where(mask, first.lerp(gradient, 1.0 - DECAY_FIRST), first))
    second.copy_(torch.where(mask, second.lerp(gradient**2, 1.0 - DECAY_SECOND), second))
    corrected = rate * (1.0 - DECAY_SECOND**count).sqrt() / (1.0 - DECAY_FIRST**count)
    change = corrected * first / (second.sqrt() + EPSILON)
    tensor.sub_(torch.where(mask, change, 0.0).to(tensor.dtype))


class Adam:
    """Adam (Kingma & Ba 2015, algorithm 1) over named leaf tensors.

    `torch.optim.Adam` would do the same for whole tensors: but it loads torch's compiler at its first use, which takes seconds, and
    spends as long around the kernel as in it.
    """

    def __init__(
        self, tensors: Mapping[str, Tensor], rates: Mapping[str, float], steps: int = 0, shared: Collection[str] = ()
    ) -> None:
        """Go on after `steps`, with moments of zero until `moments` is written to.

        The `shared` tensors move as a whole, calmed by `surprise`; all others have a row per Gaussian.
        """
        self._tensors, self._rates, self._shared = dict(tensors), dict(rates), frozenset(shared)
        self._steps = torch.tensor(float(steps), device=next(iter(tensors.values())).device)
        self._moments = {name: self._none(name) for name in tensors}

    def _none(self, name: str) -> Moments:
        tensor = self._tensors[name].detach()
        rows = None if name in self._shared else tensor.new_zeros(len(tensor))
        return Moments(torch.zeros_like(tensor), torch.zeros_like(tensor), rows)

    @torch.no_grad()
    @without_subnormals()
    def step(self, factor: float, factors: Mapping[str, float] = MappingProxyType({})) -> None:
        """Move every tensor by its gradient with `factor` times its rate, times its own of `factors`, and forget the gradients."""
        self._steps += 1.0
        for name, tensor in self._tensors.items():
            if tensor.grad is None:
                continue
            first, second, rows = self._moments[name]
            rate = self._rates[name] * factor * factors.get(name, 1.0)
            if rows is None:
                rate /= surprise(tensor.grad, second, float(self._steps))
                update(tensor, tensor.grad, first, second, self._steps, rate)
            else:
                step_rows(tensor, tensor.grad, first, second, rows, rate)
            tensor.grad = None

    def moments(self) -> dict[str, Moments]:
        """The memory of each tensor; writing to it changes the optimizer."""
        return dict(self._moments)
