"""The limit of the C++ kernels' derivatives: they can be differentiated once."""

from __future__ import annotations

import torch


def require_no_second_derivative(of: str = "deformed", instead: str = "offsets") -> None:
    """Raise RuntimeError in a backward pass that is itself to be differentiated, where a kernel would count as a constant.

    torch's `once_differentiable` lets such a pass through where the gradient that comes in is itself a constant.  `of` names the
    function whose derivative it is, `instead` one that torch computes.
    """
    if torch.is_grad_enabled():  # as it is there with `create_graph` alone
        raise RuntimeError(
            "the C++ kernels can be differentiated once only, and create_graph asks for more: leave it out, or apply "
            f"`{instead}`, which torch computes, in place of `{of}`"
        )
