"""The C++ kernels have first derivatives only."""

from __future__ import annotations

import torch


def require_no_second_derivative() -> None:
    """Raise RuntimeError in a backward pass that is itself to be differentiated, where a kernel would count as constant."""
    if torch.is_grad_enabled():  # as it is there with `create_graph` alone
        raise RuntimeError(
            "the C++ kernels can be differentiated once only, and create_graph asks for more: leave it out, or apply `offsets`, "
            "which torch computes, in place of `deformed`"
        )
