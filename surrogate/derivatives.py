"""The limit of the C++ kernels' derivatives: they can be differentiated once."""

from __future__ import annotations

import torch


def require_no_second_derivative(of: str = "deformed", instead: str = "offsets") -> None:
    """Raise RuntimeError in a backward pass that is itself to be differentiated, where a kernel would count as a constant.

    torch's `once_differentiable` lets such a pass through where the gradient that comes in is itself a constant.  `of` names the
    function whose derivative it is, `instead` one that torch computes, if there is one.
    """
    if torch.is_grad_enabled():  # as it is there with `create_graph` alone
        what, remedy = ("the C++ kernels", f", or apply `{instead}`, which torch computes, in place of `{of}`")
        if not instead:
            what, remedy = of, ""
        raise RuntimeError(
            f"{what} can be differentiated once only, and create_graph asks for more: leave it out{remedy}"
        )
