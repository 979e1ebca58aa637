"""Opacities along rays: against the line integral of a Gaussian's density, and the kernel against its twin."""

from __future__ import annotations

import math

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from torch import Tensor

from native import kernels
from surrogate.splatting.along_rays import opacities_along_rays, opacities_along_rays_reference
from surrogate.splatting.reference import rotations
from tests.support.kernel_calls import recorded

softplus = torch.nn.functional.softplus
POSITION = torch.tensor([0.4, -3.0, 1.2])


def media(count: int, seed: int = 0, aspect: float = 1.0) -> tuple[Tensor, ...]:
    """Means, logarithms of scales, quaternions and logits; `aspect` is the spread of the logarithms."""
    random = np.random.default_rng(seed)
    columns = (
        random.uniform(-1.0, 1.0, (count, 3)),
        random.normal(-3.0, aspect, (count, 3)),
        random.normal(size=(count, 4)),
        random.normal(-1.0, 2.0, count),
    )
    return tuple(torch.from_numpy(column).float() for column in columns)


def gradients(tensors: tuple[Tensor, ...], upstream: Tensor) -> tuple[Tensor, ...]:
    leaves = tuple(t.clone().requires_grad_() for t in tensors)
    found = opacities_along_rays(*leaves, POSITION.to(tensors[0].dtype))
    return torch.autograd.grad((found * upstream.to(found)).sum(), leaves)


def check(tensors: tuple[Tensor, ...]) -> None:
    """The kernel's opacities and gradients are the float64 twin's, each Gaussian's within 1e-5 of its largest.

    Gradients decay as exp(-depth), of which errors of the depth's last digits are a larger part the deeper it is.  Those by
    shape and place are differences, which may cancel.
    """
    doubles = tuple(t.double() for t in tensors)
    found, wanted = (
        opacities_along_rays(*tensors, POSITION),
        opacities_along_rays_reference(*doubles, POSITION.double()),
    )
    assert ((found.double() - wanted).abs() <= 2e-6 * wanted + 1e-30).all()
    depths = -torch.log1p(-wanted).clamp(min=-80.0)[:, None]  # [N, 1]
    upstream = torch.randn(len(found), generator=torch.Generator().manual_seed(len(found)))
    whole = (upstream.abs() * (1.0 - wanted))[:, None] * depths  # [N, 1]
    for mine, exact in zip(gradients(tensors, upstream), gradients(doubles, upstream), strict=True):
        rows = exact.reshape(len(found), -1)  # [N, columns]
        largest = rows.abs().amax(dim=1, keepdim=True)  # [N, 1]
        assert (
            (mine.double().reshape(rows.shape) - rows).abs() <= 1e-5 * (1.0 + depths) * largest + 1e-6 * whole + 1e-12
        ).all()


@pytest.mark.parametrize("aspect", [0.0, 0.5, 3.0])
def test_the_kernel_is_the_definition(aspect: float) -> None:
    check(media(3000, aspect=aspect))


@settings(max_examples=60)
@given(st.integers(1, 150), st.sampled_from([0.0, 0.3, 2.0, 6.0]), st.integers(0, 1000))
def test_whatever_the_shapes_the_kernel_is_the_definition(count: int, aspect: float, seed: int) -> None:
    check(media(count, seed, aspect))


@pytest.mark.parametrize("instruction_set", kernels.instruction_sets())
@pytest.mark.parametrize("count", [0, 1, 7, 65, 2000])
def test_every_instruction_set_has_the_same_and_threads_change_no_bit(instruction_set: str, count: int) -> None:
    arrays = [tensor.numpy() for tensor in media(count, seed=count)]
    given = arrays, POSITION.tolist(), 1e-12
    upstream = np.linspace(-1.0, 1.0, count, dtype=np.float32)

    def made(threads: int, name: str) -> list[np.ndarray]:
        forward = kernels.ray_opacities(*given, threads, name)
        return [forward, *kernels.ray_opacities_gradient(*given, upstream, threads, name)]

    alone, best = made(1, instruction_set), made(1, "")
    assert [a.shape for a in alone] == [(count,), (count, 3), (count, 3), (count, 4), (count,)]
    for mine, other, shared in zip(alone, best, made(3, instruction_set), strict=True):
        np.testing.assert_array_equal(mine, shared)
        np.testing.assert_allclose(mine, other, rtol=1e-4, atol=1e-5 * np.abs(other).max(initial=0.0))


def test_it_is_the_density_integrated_along_the_ray() -> None:
    """By quadrature: ray by ray, every Gaussian with the density that gives a ball of its volume its optical depth."""
    tensors = tuple(t.double() for t in media(40, aspect=0.6))
    means, log_scales, quats, logits = tensors
    radius = log_scales.mean(dim=1).exp()  # [N], of that ball
    densities = softplus(logits) / (math.sqrt(2.0 * math.pi) * radius)  # [N]
    ways = torch.linspace(-8.0, 8.0, 4001, dtype=torch.float64)[:, None] * log_scales.exp().amax(dim=1)  # [K, N]
    rays = torch.nn.functional.normalize(means - POSITION, dim=1)  # [N, 3]
    local = torch.einsum("kn,nc,ncj->knj", ways, rays, rotations(quats)) / log_scales.exp()  # [K, N, 3]
    depths = torch.trapezoid(densities * torch.exp(-0.5 * local.square().sum(2)), ways, dim=0)  # [N]
    found = opacities_along_rays(*tensors, POSITION.double())
    torch.testing.assert_close(found, -torch.expm1(-depths), rtol=1e-9, atol=0.0)


def test_a_ball_has_its_opacity_from_everywhere_and_a_needle_the_highest_from_its_end() -> None:
    means, log_scales, quats, logits = media(2)
    log_scales[0] = -2.0
    log_scales[1] = torch.tensor([-5.0, -5.0, -1.0])
    quats[1] = torch.tensor([1.0, 0.0, 0.0, 0.0])
    logits[1] = -6.0
    seen = {}
    for name, direction in {"x": (1.0, 0.0, 0.0), "z": (0.0, 0.0, 1.0)}.items():
        away = means[1] + 5.0 * torch.tensor(direction)
        seen[name] = opacities_along_rays(means, log_scales, quats, logits, away)
    for opacities in seen.values():
        torch.testing.assert_close(opacities[0], logits[0].sigmoid())
    depths = [-torch.log1p(-seen[name][1]) for name in ("x", "z")]
    torch.testing.assert_close(depths[1] / depths[0], torch.tensor(math.exp(4.0)), rtol=1e-3, atol=0.0)


def test_seen_from_its_centre_it_counts_as_a_ball_and_only_its_logit_has_a_gradient() -> None:
    for dtype in (torch.float32, torch.float64):
        tensors = tuple(t.to(dtype).requires_grad_() for t in media(3))
        found = opacities_along_rays(*tensors, tensors[0][1].detach())
        torch.testing.assert_close(found[1], tensors[3][1].sigmoid())
        for tensor, by in zip(tensors, torch.autograd.grad(found[1], tensors), strict=True):
            assert bool(by.isfinite().all())
            assert bool(by.any()) == (tensor is tensors[3])


@pytest.mark.parametrize("number", [math.nan, math.inf, -math.inf, 3e38])
@pytest.mark.parametrize("attribute", range(4))
def test_what_is_not_finite_is_as_in_the_twin_and_stays_in_its_row(attribute: int, number: float) -> None:
    tensors = media(40)
    clean = opacities_along_rays(*tensors, POSITION)
    tensors[attribute].reshape(40, -1)[4, 0] = number
    found = opacities_along_rays(*tensors, POSITION)
    assert torch.equal(torch.cat([found[:4], found[5:]]), torch.cat([clean[:4], clean[5:]]))
    wanted = opacities_along_rays_reference(*(t.double() for t in tensors), POSITION.double())
    if attribute == 2 and math.isnan(number):  # which the twin takes for no rotation, and no backend draws
        wanted[4] = math.nan
    torch.testing.assert_close(found.double(), wanted, rtol=1e-5, atol=1e-30, equal_nan=True)


def test_the_twin_is_differentiable_also_by_the_position() -> None:
    tensors = tuple(t.double().requires_grad_() for t in media(6, aspect=0.5))
    position = POSITION.double().requires_grad_()
    assert torch.autograd.gradcheck(opacities_along_rays_reference, (*tensors, position))


def test_only_where_it_can_the_kernel_is_taken(monkeypatch: pytest.MonkeyPatch) -> None:
    calls = recorded(monkeypatch, "ray_opacities", "ray_opacities_gradient")
    tensors = media(5)
    opacities_along_rays(*tensors, POSITION)
    assert calls == ["ray_opacities"]
    gradients(tensors, torch.ones(5))
    assert calls == ["ray_opacities", "ray_opacities", "ray_opacities_gradient"]
    gradients(tuple(t.double() for t in tensors), torch.ones(5))
    opacities_along_rays(*tensors, POSITION.clone().requires_grad_())
    assert len(calls) == 3


def test_there_is_no_second_derivative_of_the_kernel() -> None:
    means, *others = media(5)
    leaf = means.requires_grad_()
    with pytest.raises(RuntimeError, match=r"differentiated once only.*apply `opacities_along_rays_reference`"):
        torch.autograd.grad(opacities_along_rays(leaf, *others, POSITION).sum(), leaf, create_graph=True)


def test_other_shapes_are_refused() -> None:
    means, log_scales, quats, logits = (tensor.numpy() for tensor in media(5))
    for broken in ([means[:4], log_scales, quats, logits], [means, log_scales[:, :2].copy(), quats, logits]):
        with pytest.raises(ValueError, match="must have shape"):
            kernels.ray_opacities(broken, (0.0, 0.0, 0.0), 1e-12, 1)
