"""Rendering patch by patch, with the Gaussians that reach each patch, equals the whole reference image."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch

from research.benchmarks.splatting.reference_patches import (
    Errors,
    InteractionCounts,
    ReferenceDrawing,
    decibels,
    draw_patches,
    gradient_error,
    image_errors,
    picture_at,
)
from research.benchmarks.splatting.workloads import FIXED, OTHERS, View, Workload
from surrogate.splatting import Constants, Primitives, draw, reference

SMALL = replace(FIXED, size=24, count=60)
HARD = replace(OTHERS[-1], size=24, count=60, sigmas=(0.1, 9.0))


@pytest.mark.parametrize("workload", [SMALL, HARD], ids=lambda w: w.name)
@pytest.mark.parametrize("floor", [1 / 255, 1e-9])
def test_patches_against_the_whole_twin(workload: Workload, floor: float) -> None:
    camera, constants = workload.camera(), Constants(alpha_floor=floor)
    exact = draw_patches(View(workload.scene(), camera, constants))
    leaves = Primitives(*(tensor.double().requires_grad_() for tensor in workload.scene()))
    rendering = draw(leaves, camera, constants, backend="reference")
    picture = picture_at(rendering, exact.pixels)
    torch.testing.assert_close(exact.picture, picture.detach(), rtol=0, atol=1e-14)
    wanted = torch.autograd.grad((picture * exact.weights).sum(), leaves)
    for got, want in zip(exact.gradients, wanted, strict=True):
        torch.testing.assert_close(got, want, rtol=1e-10, atol=1e-12)


def test_counts_against_the_whole_twin() -> None:
    camera, constants = SMALL.camera(), Constants()
    counted = draw_patches(SMALL.view(), gradients=False).counted
    scene = Primitives(*(tensor.double() for tensor in SMALL.scene()))
    splats = reference.project(scene, camera, constants)
    drawn = (reference.alphas_at(reference.pixel_centers(camera).double(), splats, constants) > 0).numpy()  # [P, M]
    blocks = drawn.reshape(6, 4, 6, 4, -1).any(axis=(1, 3))  # 24 = 6 x 4
    assert counted == (24 * 24, drawn.any(1).sum(), drawn.sum(), blocks.sum())
    assert counted.depth == pytest.approx(drawn.sum() / drawn.any(1).sum())
    assert 0 < counted.lanes_used <= 1


def test_a_pixel_at_the_floor_is_undecided() -> None:
    """One Gaussian whose alpha at one pixel is the floor itself, but for rounding."""
    workload = replace(FIXED, size=8, count=1)
    camera, scene = workload.camera(), workload.scene()
    everywhere = draw_patches(View(scene, camera, Constants(alpha_floor=1e-9)), gradients=False)
    floor = float(everywhere.picture[27, 3]) * (1 + 1e-7)
    exact = draw_patches(View(scene, camera, Constants(alpha_floor=floor)), gradients=False)
    assert exact.undecided[27]
    assert exact.undecided.sum() == 1
    assert not everywhere.undecided.any()
    assert exact.weights[27].abs().max() == 0
    spoilt = exact.picture.clone()
    spoilt[27] += 1.0
    assert image_errors(spoilt, exact) == Errors(float("inf"), 0.0)


def test_errors_of_known_differences() -> None:
    pixels = torch.arange(4)
    truth, none = torch.zeros(4, 4, dtype=torch.float64), torch.zeros(4, dtype=torch.bool)
    exact = ReferenceDrawing(pixels, truth, none, truth, (torch.tensor([2.0, -4.0]),), InteractionCounts(4, 4, 4, 4))
    picture = truth.clone()
    picture[1, 2] = -0.4
    errors = image_errors(picture, exact)
    assert errors.largest == pytest.approx(0.4)
    assert errors.decibels == pytest.approx(-10 * np.log10(0.16 / 16))
    assert gradient_error([torch.tensor([2.0, -3.0])], exact) == pytest.approx(0.25)
    assert decibels(0.0) == float("inf")
