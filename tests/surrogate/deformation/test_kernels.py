"""Second derivatives are refused where the kernels would silently leave them out, and had where torch computes."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
import torch

from surrogate.deformation.kernels import add_products
from surrogate.deformation.transfer import Transfer
from surrogate.gaussians import Gaussians

TRANSFER = Transfer(np.random.default_rng(3).normal(0, 0.3, (5, 4)), ((0.1, 0.0, 0.3), (0.8, 0.4, 0.5)))


def gaussians(dtype: torch.dtype = torch.float32) -> Gaussians:
    random = torch.Generator().manual_seed(1)
    shapes = ((9, 3), (9, 3), (9, 4), (9,), (9, 3))
    return Gaussians(*(torch.randn(shape, generator=random, dtype=dtype) for shape in shapes))


def multiplied(leaf: torch.Tensor) -> Gaussians:
    return add_products(gaussians(), [(leaf, torch.ones(5, 14))])


def transferred(leaf: torch.Tensor) -> Gaussians:
    return TRANSFER.applied_to(gaussians(leaf.dtype), leaf)


def loss(shown: Gaussians, power: int) -> torch.Tensor:
    return (shown.opacity_logits**power).sum() + (shown.colors**power).sum()


@pytest.mark.parametrize("deform", [multiplied, transferred])
@pytest.mark.parametrize("power", [1, 2])
def test_the_kernels_refuse_what_they_would_take_for_constant(
    deform: Callable[[torch.Tensor], Gaussians], power: int
) -> None:
    leaf = torch.randn(9, 5, requires_grad=True)
    with pytest.raises(RuntimeError, match="differentiated once only, and create_graph asks for more: leave it out"):
        torch.autograd.grad(loss(deform(leaf), power), leaf, create_graph=True)
    (found,) = torch.autograd.grad(loss(deform(leaf), power), leaf)
    assert found.shape == leaf.shape


def test_where_torch_computes_there_are_second_derivatives() -> None:
    leaf = (1.0 + torch.rand(9, 5, dtype=torch.float64)).requires_grad_()
    (first,) = torch.autograd.grad(loss(transferred(leaf), 2), leaf, create_graph=True)
    (second,) = torch.autograd.grad(first.sum(), leaf)
    assert second.abs().max() > 0
