"""Gradients of volume renderings: the kernel against the float64 reference's autograd and finite differences."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest
import torch
from torch import Tensor

from catalogs.vocabulary.appearance import VolumeRendering
from native import kernels
from surrogate.ray_casting import volume_image
from surrogate.ray_casting.reference import draw_volume_reference
from tests.support.cast_cases import CastCase, cast_cases, seen

CASES = {
    name: replace(case, camera=case.camera.resized(24, 20)) for name, case in cast_cases().items() if not case.shaded
}
AWAY = CASES.pop("looking away")


def leaves(case: CastCase, dtype: torch.dtype) -> list[Tensor]:
    """Values, opacities and colours."""
    arrays = (
        case.field.values,
        np.array(case.transfer.opacity_points)[:, 1],
        np.array(case.transfer.color_points)[:, 1:],
    )
    return [torch.from_numpy(np.array(array)).to(dtype).requires_grad_() for array in arrays]


def image(case: CastCase, tensors: list[Tensor], threads: int = 1) -> Tensor:
    field = case.field
    values, opacities, colors = tensors
    return volume_image(
        values,
        field.holes,
        field.spacing,
        field.origin,
        case.appearance,
        case.camera,
        opacities=opacities,
        colors=colors,
        sample_distance=case.sample_distance,
        threads=threads,
    )


def upstream(case: CastCase, seed: int = 0) -> Tensor:
    return torch.from_numpy(np.random.default_rng(seed).normal(size=(case.camera.height, case.camera.width, 4)))


@cache
def expected_gradients(name: str) -> tuple[Tensor, ...]:
    """By values, opacities and colours."""
    case = CASES[name]
    _, *function = leaves(case, torch.float64)
    filled = torch.from_numpy(case.field.filled.astype(np.float64)).requires_grad_()
    drawn = draw_volume_reference(
        case.field,
        case.appearance,
        case.camera,
        sample_distance=case.sample_distance,
        values=filled,
        opacities=function[0],
        colors=function[1],
    )
    return torch.autograd.grad((drawn * upstream(case)).sum(), [filled, *function])


@pytest.mark.parametrize("instruction_set", kernels.instruction_sets())
@pytest.mark.parametrize("name", CASES)
def test_gradients_are_those_of_the_reference(name: str, instruction_set: str, monkeypatch: Any) -> None:
    monkeypatch.setenv("GS_SURROGATE_INSTRUCTION_SET", instruction_set)
    case = CASES[name]
    asked = leaves(case, torch.float32)
    found = torch.autograd.grad((image(case, asked) * upstream(case).float()).sum(), asked)
    for one, other in zip(found, expected_gradients(name), strict=True):
        error = (one - other).norm() / other.norm().clamp(min=1e-3)
        assert error < 2e-3  # the field's kinks at knots, to either side of which a rounded value may lie


@pytest.mark.parametrize("name", ["smooth", "holes"])
def test_the_references_gradients_are_finite_differences(name: str) -> None:
    case = CASES[name]
    exact = leaves(case, torch.float64)
    exact[0] = torch.from_numpy(case.field.filled.astype(np.float64)).requires_grad_()
    weights, random = upstream(case), np.random.default_rng(1)

    def loss(tensors: list[Tensor]) -> Tensor:
        options = dict(zip(("values", "opacities", "colors"), tensors, strict=True))
        distance = case.sample_distance
        drawn = draw_volume_reference(case.field, case.appearance, case.camera, sample_distance=distance, **options)
        return (drawn * weights).sum()

    gradients = torch.autograd.grad(loss(exact), exact)
    for k, gradient in enumerate(gradients):
        direction = torch.from_numpy(random.normal(size=gradient.shape))
        ends = []
        for side in (1e-6, -1e-6):
            moved = [t.detach() + side * direction if i == k else t.detach() for i, t in enumerate(exact)]
            ends.append(float(loss(moved)))
        assert (gradient * direction).sum().item() == pytest.approx((ends[0] - ends[1]) / 2e-6, rel=2e-3)


def test_threads_change_no_bit() -> None:
    case = replace(CASES["smooth"], camera=seen(CASES["smooth"].field, 90))
    weights = upstream(case).float()
    first, *others = (
        torch.autograd.grad((image(case, tensors, threads) * weights).sum(), tensors)
        for threads, tensors in ((n, leaves(case, torch.float32)) for n in (1, 2, 5))
    )
    for other in others:
        assert all(torch.equal(a, b) for a, b in zip(first, other, strict=True))


def test_what_is_not_seen_has_no_gradient() -> None:
    tensors = leaves(AWAY, torch.float32)
    gradients = torch.autograd.grad(image(AWAY, tensors).sum(), tensors)
    assert all(not gradient.any() for gradient in gradients)


@pytest.mark.parametrize("name", ["mostly empty", "opaque"])
def test_steps_without_opacity_are_left_out_for_values_alone(name: str) -> None:
    case = CASES[name]
    values, *function = leaves(case, torch.float32)
    weights = upstream(case).float()
    everything = torch.autograd.grad((image(case, [values, *function]) * weights).sum(), [values, *function])
    fixed = [tensor.detach() for tensor in function]
    (alone,) = torch.autograd.grad((image(case, [values, *fixed]) * weights).sum(), values)
    torch.testing.assert_close(alone, everything[0], rtol=1e-4, atol=1e-4 * float(everything[0].abs().max()))


def test_a_field_is_recovered_from_its_image() -> None:
    case = CASES["smooth"]
    truth = image(case, leaves(case, torch.float32)).detach()
    values, *function = leaves(case, torch.float32)
    values = (0.8 * values.detach()).requires_grad_()
    optimizer = torch.optim.Adam([values], lr=0.02)
    errors = []
    for _ in range(30):
        optimizer.zero_grad()
        error = (image(case, [values, *function]) - truth).square().mean()
        error.backward()
        optimizer.step()
        errors.append(error.item())
    assert errors[-1] < 0.02 * errors[0]


def test_shaded_volumes_and_second_derivatives_are_refused() -> None:
    case = CASES["smooth"]
    tensors = leaves(case, torch.float32)
    shaded = VolumeRendering("lit", case.transfer, shaded=True)
    with pytest.raises(ValueError, match=r"'lit' is shaded, .*: apply draw_volume_reference"):
        volume_image(tensors[0], None, case.field.spacing, case.field.origin, shaded, case.camera)
    with pytest.raises(RuntimeError, match="draw_volume_reference"):
        torch.autograd.grad(image(case, tensors).sum(), tensors, create_graph=True)
