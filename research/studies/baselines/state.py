"""State of a training from which it resumes as if it had never stopped."""

from __future__ import annotations

from collections.abc import Mapping

import torch
from torch import Tensor

State = Mapping[str, Tensor]


def of_optimizer(optimizer: torch.optim.Optimizer) -> dict[str, Tensor]:
    """The optimizer's tensors by number, and its moments of each: "3" and "3.exp_avg"."""
    tensors = {}
    for number, tensor in enumerate(_trained(optimizer)):
        tensors[f"{number}"] = tensor.detach()
        tensors |= {f"{number}.{name}": remembered for name, remembered in optimizer.state.get(tensor, {}).items()}
    return tensors


@torch.no_grad()
def restore_optimizer(optimizer: torch.optim.Optimizer, state: State) -> None:
    """Restore an optimizer and its tensors from a `state`; raises KeyError where one is missing."""
    remembered = dict[int, dict[str, Tensor]]()
    for number, tensor in enumerate(_trained(optimizer)):
        tensor.copy_(state[f"{number}"])
        own = inner(state, f"{number}")  # empty before its first step
        if own:
            remembered[number] = {name: _laid_out_as(tensor, other) for name, other in own.items()}
    optimizer.load_state_dict({"state": remembered, "param_groups": optimizer.state_dict()["param_groups"]})


def outer(**parts: State) -> dict[str, Tensor]:
    """The tensors of all parts, each name prefixed by its part's; `inner` reverses it."""
    return {f"{part}.{name}": tensor for part, state in parts.items() for name, tensor in state.items()}


def inner(state: State, part: str) -> dict[str, Tensor]:
    """The tensors of one part, by their names in it."""
    return {name.removeprefix(f"{part}."): t for name, t in state.items() if name.startswith(f"{part}.")}


def _laid_out_as(tensor: Tensor, other: Tensor) -> Tensor:
    """Moments have the memory layout of their tensors: kernels go through both by one address."""
    return torch.empty_like(tensor).copy_(other) if other.shape == tensor.shape and other.ndim else other.clone()


def _trained(optimizer: torch.optim.Optimizer) -> list[Tensor]:
    return [tensor for group in optimizer.param_groups for tensor in group["params"]]
