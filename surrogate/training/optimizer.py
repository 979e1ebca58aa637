"""Adam with one rate per named tensor, whose whole state can be saved and edited row by row."""

from __future__ import annotations

import math
import sys
from collections.abc import Collection, Iterator, Mapping
from contextlib import contextmanager

import torch
from torch import Tensor

DECAY_FIRST, DECAY_SECOND = 0.9, 0.999
EPSILON = 1e-15  # as in 3D Gaussian Splatting: gradients of single Gaussians are far below the usual 1e-8


@contextmanager
def without_subnormals() -> Iterator[None]:
    """Take subnormal numbers for zero, in this thread (training runs torch on one: `surrogate.splatting.threads`).

    Processors are slow with them, and decay ends there, not at zero: 0.9 times the smallest is rounded to itself.  Of a training
    on isosurfaces half of the first moments were such, of Gaussians that no picture shows any more (52 % of 520,000).
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
    """How many times larger a gradient is than those lately, in the root mean square of its elements; at least 1.

    `second` is the second moment before it, `steps` counts it.  Divided by it, rates no longer let one step throw far what has seen
    small gradients for long: "update clipping" of Wortsman et al. 2023, "Stable and low-precision training for large-scale
    vision-language models", algorithm 2.
    """
    squares = gradient.square()
    lately = (second * DECAY_SECOND).add_(squares, alpha=1.0 - DECAY_SECOND).clamp_(min=EPSILON**2)
    return max(1.0, math.sqrt(float(squares.div_(lately).mean()) * (1.0 - DECAY_SECOND**steps)))


class Adam:
    """Adam (Kingma & Ba 2015, algorithm 1) over named leaf tensors.

    `torch.optim.Adam` would do the same: but it loads torch's compiler at its first use, which takes seconds, and spends as long
    around the kernel as in it.
    """

    def __init__(
        self, tensors: Mapping[str, Tensor], rates: Mapping[str, float], steps: int = 0, calmed: Collection[str] = ()
    ) -> None:
        """Go on after so many `steps`, with zero moments until `moments` is written to; the rates of some are `calmed`."""
        self._tensors, self._rates, self._calmed = dict(tensors), dict(rates), frozenset(calmed)
        self._steps = torch.tensor(float(steps), device=next(iter(tensors.values())).device)
        self._moments = {
            name: (torch.zeros_like(t, requires_grad=False), torch.zeros_like(t, requires_grad=False))
            for name, t in tensors.items()
        }

    @torch.no_grad()
    @without_subnormals()
    def step(self, factor: float) -> None:
        """Move every tensor by its gradient with `factor` times its rate, and forget the gradients."""
        self._steps += 1.0
        for name, tensor in self._tensors.items():
            if tensor.grad is None:
                continue
            first, second = self._moments[name]
            rate = self._rates[name] * factor
            if name in self._calmed:
                rate /= surprise(tensor.grad, second, float(self._steps))
            update(tensor, tensor.grad, first, second, self._steps, rate)
            tensor.grad = None

    def moments(self) -> dict[str, tuple[Tensor, Tensor]]:
        """First and second moment of each tensor; writing to them changes the optimizer."""
        return dict(self._moments)
