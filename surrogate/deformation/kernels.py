"""The C++ kernel of bilinear deformations as a differentiable torch function: latents times modes, added to Gaussians."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import torch
from torch import Tensor

from native import kernels
from native.threads import cores
from surrogate.appearance.field_gaussians import AnyGaussians
from surrogate.derivatives import require_no_second_derivative

Factors = tuple[Tensor, Tensor]  # latents [N, L] and modes [L, C]


def add_products(gaussians: AnyGaussians, factors: Sequence[Factors]) -> AnyGaussians:
    """The Gaussians with one product or two of latents (N, L) and modes (L, C) added to their parameters, one after the other.

    The C columns are those of means, log_scales, quats, opacity_logits and colours (or values) side by side.  Colours with fewer
    columns than the modes are padded by zeros; of more, the last stay.  In main memory and float32; differentiable.
    """
    tensors = [*(tensor for pair in factors for tensor in pair), *gaussians.tensors().values()]
    added = _AddProducts.apply if torch.is_grad_enabled() else _added  # a torch function takes 0.02 ms more
    return gaussians.with_tensors(added(len(factors), *tensors))


def _added(number: int, *tensors: Tensor) -> tuple[Tensor, ...]:
    """The products of `number` pairs of latents and modes, which come first, added to the five tensors that follow."""
    arrays = [tensor.detach().numpy() for tensor in tensors]
    factors = list(zip(arrays[: 2 * number : 2], arrays[1 : 2 * number : 2], strict=True))
    return tuple(map(torch.from_numpy, kernels.add_bilinear(factors, arrays[2 * number :], cores())))


class _AddProducts(torch.autograd.Function):
    """`_added` with its derivative.

    torch takes 1.1 ms for each of the three products of a pair (N = 20,000, L = 16, C = 14), which are too narrow for its kernels.
    """

    @staticmethod
    def forward(ctx: Any, *inputs: Any) -> tuple[Tensor, ...]:
        number, *tensors = inputs
        ctx.save_for_backward(*tensors[: 2 * number])
        ctx.widths = [tensor.shape[1:] for tensor in tensors[2 * number :]]
        return _added(*inputs)

    @staticmethod
    def backward(ctx: Any, *gradients: Tensor) -> tuple[Tensor | None, ...]:
        require_no_second_derivative()
        arrays = [gradient.numpy() for gradient in gradients]
        by_factors: list[Tensor | None] = []
        for k in range(0, len(ctx.saved_tensors), 2):
            latents, modes = (tensor.detach().numpy() for tensor in ctx.saved_tensors[k : k + 2])
            needed = any(ctx.needs_input_grad[1 + k : 3 + k])
            arrays_of_kernel = kernels.bilinear_gradients(latents, modes, arrays, cores()) if needed else ()
            by_factors += map(torch.from_numpy, arrays_of_kernel) if needed else (None, None)
        by_rows = [g[:, : w[0]] if w else g for g, w in zip(gradients, ctx.widths, strict=True)]
        return None, *by_factors, *by_rows
