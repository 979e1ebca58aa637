"""Colours by direction: the kernel against its twin, whose harmonics `test_gaussians.py` compares with scipy's."""

from __future__ import annotations

import math

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from torch import Tensor

from native import kernels
from surrogate.splatting.directional import directional_colors, directional_colors_reference
from tests.support.kernel_calls import recorded

POSITION = torch.tensor([0.4, -3.0, 1.2])


def colored(count: int, seed: int = 0, size: float = 1.0) -> tuple[Tensor, Tensor]:
    """Means (N, 3) in a box of this size, and coefficients (N, 12)."""
    random = np.random.default_rng(seed)
    return (
        torch.from_numpy(random.uniform(-size, size, (count, 3))).float(),
        torch.from_numpy(random.normal(size=(count, 12))).float(),
    )


def gradients(tensors: tuple[Tensor, ...], upstream: Tensor) -> tuple[Tensor, ...]:
    leaves = tuple(t.clone().requires_grad_() for t in tensors)
    found = directional_colors(*leaves, POSITION.to(tensors[0].dtype))
    return torch.autograd.grad((found * upstream.to(found)).sum(), leaves)


def check(tensors: tuple[Tensor, Tensor]) -> None:
    """Colours and gradients are the float64 twin's, to the last digits of a Gaussian's largest coefficient and gradient."""
    means, colors = (t.double() for t in tensors)
    wanted = directional_colors_reference(means, colors, POSITION.double())
    found = directional_colors(*tensors, POSITION)
    largest = colors.abs().amax(dim=1, keepdim=True)  # [N, 1]
    assert ((found.double() - wanted).abs() <= 2e-7 * largest).all()
    upstream = torch.randn(found.shape, generator=torch.Generator().manual_seed(len(found)))
    distances = (means - POSITION.double()).norm(dim=1, keepdim=True)  # [N, 1]
    pulls = upstream.abs().amax(dim=1, keepdim=True)  # [N, 1]
    by_means, by_colors = gradients(tensors, upstream)
    exact_means, exact_colors = gradients((means, colors), upstream)
    assert ((by_means.double() - exact_means).abs() <= 1e-6 * pulls * largest / distances).all()
    assert ((by_colors.double() - exact_colors).abs() <= 2e-7 * pulls).all()


@pytest.mark.parametrize("size", [0.1, 1.0, 1e4, 1e30])
def test_the_kernel_is_the_definition(size: float) -> None:
    check(colored(3000, size=size))


@settings(max_examples=60)
@given(st.integers(1, 150), st.sampled_from([1e-3, 1.0, 1e8]), st.integers(0, 1000))
def test_whatever_the_places_the_kernel_is_the_definition(count: int, size: float, seed: int) -> None:
    check(colored(count, seed, size))


@pytest.mark.parametrize("instruction_set", kernels.instruction_sets())
@pytest.mark.parametrize("count", [0, 1, 7, 65, 2000])
def test_every_instruction_set_has_the_same_and_threads_change_no_bit(instruction_set: str, count: int) -> None:
    given = *(tensor.numpy() for tensor in colored(count, seed=count)), POSITION.tolist()
    upstream = np.linspace(-1.0, 1.0, 3 * count, dtype=np.float32).reshape(count, 3)

    def made(threads: int, name: str) -> list[np.ndarray]:
        forward = kernels.directional_colors(*given, threads, name)
        return [forward, *kernels.directional_colors_gradient(*given, upstream, threads, name)]

    alone, best = made(1, instruction_set), made(1, "")
    assert [a.shape for a in alone] == [(count, 3), (count, 3), (count, 12)]
    for mine, other, shared in zip(alone, best, made(3, instruction_set), strict=True):
        np.testing.assert_array_equal(mine, shared)
        np.testing.assert_allclose(mine, other, rtol=1e-5, atol=1e-6)


@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
def test_at_the_very_place_the_constant_is_the_colour_and_nothing_pulls_at_the_mean(dtype: torch.dtype) -> None:
    means, colors = (t.to(dtype).requires_grad_() for t in colored(3))
    found = directional_colors(means, colors, means[1].detach())
    torch.testing.assert_close(found[1], colors[1, :3])
    by_means, by_colors = torch.autograd.grad(found[1].sum(), (means, colors))
    assert not by_means.any()
    assert by_colors[1].tolist() == [1.0] * 3 + [0.0] * 9


@pytest.mark.parametrize("number", [math.nan, math.inf, -math.inf])
@pytest.mark.parametrize("attribute", range(2))
def test_what_is_not_finite_is_as_in_the_twin_and_stays_in_its_row(attribute: int, number: float) -> None:
    tensors = colored(40)
    clean = directional_colors(*tensors, POSITION)
    tensors[attribute][4, 0] = number
    found = directional_colors(*tensors, POSITION)
    assert torch.equal(torch.cat([found[:4], found[5:]]), torch.cat([clean[:4], clean[5:]]))
    wanted = directional_colors_reference(*(t.double() for t in tensors), POSITION.double())
    torch.testing.assert_close(found.double(), wanted, rtol=1e-5, atol=1e-6, equal_nan=True)


def test_the_twin_is_differentiable_also_by_the_position() -> None:
    tensors = tuple(t.double().requires_grad_() for t in colored(6))
    position = POSITION.double().requires_grad_()
    assert torch.autograd.gradcheck(directional_colors_reference, (*tensors, position))


def test_only_where_it_can_the_kernel_is_taken(monkeypatch: pytest.MonkeyPatch) -> None:
    calls = recorded(monkeypatch, "directional_colors", "directional_colors_gradient")
    tensors = colored(5)
    with torch.no_grad():
        directional_colors(*tensors, POSITION)
    assert calls == ["directional_colors"]
    gradients(tensors, torch.ones(5, 3))
    assert calls == ["directional_colors", "directional_colors", "directional_colors_gradient"]
    gradients(tuple(t.double() for t in tensors), torch.ones(5, 3))
    directional_colors(*tensors, POSITION.clone().requires_grad_())
    assert len(calls) == 3


def test_there_is_no_second_derivative_of_the_kernel() -> None:
    means, colors = colored(5)
    leaf = means.requires_grad_()
    with pytest.raises(RuntimeError, match=r"differentiated once only.*apply `directional_colors_reference`"):
        torch.autograd.grad(directional_colors(leaf, colors, POSITION).sum(), leaf, create_graph=True)


@pytest.mark.parametrize("broken", [(4, 12), (5, 3)])
def test_other_shapes_are_refused(broken: tuple[int, int]) -> None:
    means, _ = colored(5)
    with pytest.raises(ValueError, match="must have shape"):
        kernels.directional_colors(means.numpy(), np.zeros(broken, np.float32), (0.0, 0.0, 0.0), 1)
