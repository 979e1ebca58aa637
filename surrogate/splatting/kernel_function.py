"""A C++ kernel and the kernel of its gradient as one differentiable torch function."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from catalogs.vocabulary.words import one_line
from surrogate.derivatives import require_no_second_derivative


@dataclass(frozen=True, eq=False, repr=False)
class KernelFunction:
    """A differentiable function of several tensors, on a CPU in float32.

    Attributes
    ----------
    name, reference : names of the function, and of its reference implementation, which has second derivatives.
    forward : computes the result from the tensors' arrays.
    gradient : computes the gradients by the tensors, from the gradient by the result and the arrays.
    """

    name: str
    reference: str
    forward: Callable[..., NDArray[np.float32]]
    gradient: Callable[..., Sequence[NDArray[np.float32]]]

    __repr__ = one_line

    def __call__(self, *tensors: Tensor) -> Tensor:
        """The result, differentiable once where gradients are wanted."""
        if torch.is_grad_enabled():
            result: Tensor = _Differentiable.apply(self, *tensors)
            return result
        return self.of(tensors)

    def of(self, tensors: Sequence[Tensor]) -> Tensor:
        """The result alone."""
        return torch.from_numpy(self.forward(*(tensor.detach().numpy() for tensor in tensors)))


class _Differentiable(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, function: KernelFunction, *tensors: Tensor) -> Tensor:
        ctx.function = function
        ctx.save_for_backward(*tensors)
        return function.of(tensors)

    @staticmethod
    def backward(ctx: Any, *gradients: Tensor) -> tuple[Tensor | None, ...]:
        require_no_second_derivative(ctx.function.name, ctx.function.reference)
        arrays = [tensor.detach().numpy() for tensor in ctx.saved_tensors]
        by_tensors = ctx.function.gradient(gradients[0].numpy(), *arrays)
        return None, *(torch.from_numpy(array) for array in by_tensors)


def kernel_takes(position: Tensor, *tensors: Tensor) -> bool:
    """True if kernels can evaluate the tensors from `position` (3,): on a CPU in float32, without a gradient by the position."""
    return not position.requires_grad and all(t.is_cpu and t.dtype == torch.float32 for t in tensors)
