"""Gradients of whole pictures hold what passes the edges of Gaussians, against finite differences of pictures."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import torch

from catalogs.vocabulary.cameras import Camera
from surrogate.rasterizer import Rasterizer
from surrogate.splatting import render
from tests.support.surrogates import CENTER, some_surrogate

CAMERA = Camera.look_at((0.0, -4.0, 0.5), (0.0, 0.0, 0.0), vertical_fov_degrees=35, width=96, height=96)
BACKDROP = torch.tensor([1.0, 1.0, 1.0])


def picture(parameters: torch.Tensor, edges: bool) -> torch.Tensor:
    """Two thousand Gaussians, nearly transparent as those of volumes are: larger, more opaque and farther right by parameters."""
    torch.manual_seed(3)
    means, log_scales, quats, logits, colors = (torch.randn(2000, n) for n in (3, 3, 4, 1, 3))
    size, strength, right = parameters.float()
    return render(
        0.4 * means + right * torch.tensor([0.1, 0.0, 0.0]) * (1.0 + means),
        (0.2 * log_scales - 2.6 + 0.3 * size).exp(),
        quats,
        (logits[:, 0] - 3.5 + strength).sigmoid(),
        colors.sigmoid(),
        CAMERA,
        edges=edges,
    ).over(BACKDROP)


@pytest.mark.parametrize("weights", ["even", "a ramp", "waves"])
def test_gradients_of_whole_pictures_are_finite_differences(weights: str) -> None:
    rows, columns = np.mgrid[0:96, 0:96] / 96.0
    each = {"even": np.ones((96, 96)), "a ramp": rows, "waves": np.sin(6.0 * columns) ** 2}[weights]
    weight = torch.tensor(each, dtype=torch.float32)[..., None]

    def mean(parameters: torch.Tensor, edges: bool = True) -> torch.Tensor:
        return (picture(parameters, edges) * weight).double().mean()

    place, step = torch.zeros(3, dtype=torch.float64), 0.01
    expected = np.array(
        [float(mean(step * axis) - mean(-step * axis)) / (2.0 * step) for axis in torch.eye(3).double()]
    )
    errors = []
    for edges in (True, False):
        at = place.clone().requires_grad_()
        (gradient,) = torch.autograd.grad(mean(at, edges), at)
        errors.append(float(np.linalg.norm(gradient.numpy() - expected) / np.linalg.norm(expected)))
    assert errors[0] < 0.02
    assert errors[1] > 0.1  # of single pixels, which the edges pass unseen


def test_a_surrogate_has_them_unless_it_is_asked_for_those_of_pixels() -> None:
    surrogate = replace(some_surrogate(count=300), rasterizer=Rasterizer())
    camera = Camera.look_at(CENTER + 90.0, CENTER, vertical_fov_degrees=35, width=32, height=32)
    gradients: list[Any] = []
    for options in ({}, {"edges": True}, {"edges": False}):
        parameters = torch.tensor([1830.0, 0.9], requires_grad=True)
        surrogate.differentiable(**options)(parameters, camera).sum().backward()
        gradients.append(parameters.grad)
    assert torch.equal(gradients[0], gradients[1])
    assert not torch.allclose(gradients[0], gradients[2], rtol=0.01)


@pytest.mark.parametrize("backend", ["cpu", "reference"])
@pytest.mark.parametrize("opacity", [0.0045, 0.006, 0.02, 0.3])
@pytest.mark.parametrize("by", ["opacity", "size"])
def test_the_edge_of_one_gaussian_counts_by_its_length(backend: str, opacity: float, by: str) -> None:
    """Its opacities sum to 2π a² (o - floor), a in pixels, of which the derivatives are known."""
    pixels, floor = 40.0, 1.0 / 255.0
    camera = Camera.look_at((0.0, -100.0, 0.0), (0.0, 0.0, 0.0), vertical_fov_degrees=30, width=256, height=256)
    size = torch.tensor(pixels * 100.0 / camera.fx, requires_grad=True)
    strength = torch.tensor(opacity, requires_grad=True)
    image = render(
        torch.zeros(1, 3),
        size.expand(1, 3),
        torch.tensor([[1.0, 0.0, 0.0, 0.0]]),
        strength.reshape(1),
        torch.ones(1, 3),
        camera,
        backend=backend,
        edges=True,
    )
    area = 2.0 * np.pi * pixels**2
    if opacity < 0.1:
        assert float(image.alpha.detach().sum()) == pytest.approx(area * (opacity - floor), rel=0.02)
    by_size, by_strength = torch.autograd.grad(image.alpha.sum(), (size, strength))
    if by == "opacity":
        assert float(by_strength) == pytest.approx(area, rel=0.03)
    else:
        assert float(by_size * size.detach()) == pytest.approx(2.0 * area * (opacity - floor), rel=0.1)
