"""Adam with one rate per named tensor, whose whole state can be saved and edited row by row."""

from __future__ import annotations

from collections.abc import Mapping

import torch
from torch import Tensor


class Adam:
    """Adam (Kingma & Ba 2015) over named leaf tensors; torch's fused implementation.

    The epsilon of 1e-15 is that of 3D Gaussian Splatting: gradients of single Gaussians are far below 1e-8.
    """

    def __init__(self, tensors: Mapping[str, Tensor], rates: Mapping[str, float]) -> None:
        self._tensors, self._rates = dict(tensors), dict(rates)
        groups = [{"params": [tensor], "lr": rates[name]} for name, tensor in tensors.items()]
        self._adam = torch.optim.Adam(groups, betas=(0.9, 0.999), eps=1e-15, fused=True)
        for tensor in tensors.values():
            self._adam.state[tensor] = {
                "step": torch.zeros(()),
                "exp_avg": torch.zeros_like(tensor, requires_grad=False),
                "exp_avg_sq": torch.zeros_like(tensor, requires_grad=False),
            }

    def step(self, factor: float) -> None:
        """Move every tensor by its gradient with `factor` times its rate, and forget the gradients."""
        for group, rate in zip(self._adam.param_groups, self._rates.values(), strict=True):
            group["lr"] = rate * factor
        self._adam.step()
        self._adam.zero_grad(set_to_none=True)

    def moments(self) -> dict[str, tuple[Tensor, Tensor]]:
        """First and second moment of each tensor; writing to them changes the optimizer."""
        states = {name: self._adam.state[tensor] for name, tensor in self._tensors.items()}
        return {name: (state["exp_avg"], state["exp_avg_sq"]) for name, state in states.items()}

    def restore(self, moments: Mapping[str, tuple[Tensor, Tensor]], steps: int) -> None:
        """Continue from `moments` after `steps` steps."""
        for name, tensor in self._tensors.items():
            state = self._adam.state[tensor]
            state["step"].fill_(steps)
            state["exp_avg"].copy_(moments[name][0])
            state["exp_avg_sq"].copy_(moments[name][1])
