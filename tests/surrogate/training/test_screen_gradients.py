from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch

from catalogs.cameras import Camera
from surrogate.gaussians import Gaussians
from surrogate.settings import TrainingSettings
from surrogate.training.loop import LoopMemory, StageRun
from surrogate.training.screen_gradients import ScreenGradients
from surrogate.training.source import Source
from surrogate.training.stages import canonical_stage, simulation_stage
from tests.support.visualizations import base

CAMERA = Camera.look_at([0.4, -3.0, 2.0], [0.1, 0.0, -0.2], vertical_fov_degrees=30, width=64, height=48)


def seen(camera: Camera, places: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Pixels (N, 2) and depths (N,) of places (N, 3)."""
    pixels, depths = camera.project(places)
    return pixels, depths


def test_a_pull_is_the_gradient_per_device_coordinate() -> None:
    """A loss that is linear in where Gaussians are seen; its gradient in space by finite differences in float64."""
    axis = CAMERA.rotation[2]  # what lies on the camera's axis is seen without a change of scale
    means = CAMERA.position + np.array([[2.0], [3.5], [5.0]]) * axis
    by_pixel = np.array([[0.3, -0.4], [2.0, 0.0], [0.0, 0.01]])  # the loss's, per pixel
    gradients, step = np.zeros((3, 3)), 1e-5
    for c in range(3):
        moved = np.eye(3)[c] * step
        difference = (seen(CAMERA, means + moved)[0] - seen(CAMERA, means - moved)[0]) / (2.0 * step)
        gradients[:, c] = (by_pixel * difference).sum(axis=1)
    pulls = ScreenGradients.none(3, torch.zeros(1))
    pulls.add(torch.from_numpy(means).float(), torch.from_numpy(gradients).float(), CAMERA)
    expected = np.linalg.norm(by_pixel, axis=1) * CAMERA.width / 2.0  # device coordinates are width / 2 pixels
    np.testing.assert_allclose(pulls.totals.numpy(), expected, rtol=1e-4)
    assert pulls.pictures.tolist() == [1.0, 1.0, 1.0]


def test_means_are_over_pictures_that_showed_the_gaussian() -> None:
    pulls, means = ScreenGradients.none(3, torch.zeros(1)), torch.zeros(3, 3)
    for first, second in ((1.0, 0.0), (3.0, 4.0)):
        pulls.add(means, torch.tensor([[first, 0, 0], [0, second, 0], [0, 0, 0]]), CAMERA)
    once = ScreenGradients.none(1, torch.zeros(1))
    once.add(means[:1], torch.tensor([[1.0, 0, 0]]), CAMERA)
    unit = float(once.totals)
    expected = torch.tensor([2.0, 4.0, 0.0]) * unit
    torch.testing.assert_close(pulls.above(0.0), expected)
    torch.testing.assert_close(pulls.above(3.0 * unit), torch.tensor([0.0, 4.0, 0.0]) * unit)


def test_no_gradient_counts_nothing_and_what_is_forgotten_is_gone() -> None:
    pulls = ScreenGradients.none(2, torch.zeros(1))
    pulls.add(torch.zeros(2, 3), None, CAMERA)
    assert not pulls.pictures.any()
    pulls.add(torch.zeros(2, 3), torch.ones(2, 3), CAMERA)
    assert pulls.above(0.0).all()
    pulls.forget()
    assert not pulls.totals.any()
    assert not pulls.pictures.any()


def test_the_state_can_be_taken_up_again() -> None:
    first, second = ScreenGradients.none(4, torch.zeros(1)), ScreenGradients.none(4, torch.zeros(1))
    first.add(torch.rand(4, 3), torch.rand(4, 3), CAMERA)
    second.restore({name: tensor.clone() for name, tensor in first.tensors().items()})
    assert torch.equal(second.above(0.0), first.above(0.0))
    assert len(second) == 4


@pytest.mark.parametrize("stage", ["canonical", "deformation"])
def test_dead_gaussians_move_to_where_pictures_pull(make_catalog, stage: str) -> None:
    """Of the blobs all but one are as they should be: those that lie dead move onto that one."""
    settings = TrainingSettings(
        relocation_interval=12,
        relocation_target="gradient",
        relocation_stop=1.0,
        canonical_steps=12,
        deformation_steps=12,
    )
    catalog = make_catalog(members=(("train", 0.5),), view_splits=("train",) * 12)
    fitted = base()
    gaussians = fitted.gaussians.of(torch.tensor([*range(12), 11, 11, 11]))
    gaussians.means[2] += 0.15
    gaussians.opacity_logits[12:] = -9.0
    still = replace(fitted.deformation, weights_out=torch.zeros_like(fitted.deformation.weights_out))
    still = replace(still, biases_out=torch.zeros_like(still.biases_out)).of(torch.tensor([*range(12), 11, 11, 11]))
    made = (
        canonical_stage(gaussians, settings) if stage == "canonical" else simulation_stage(gaussians, still, settings)
    )
    rates = dict.fromkeys(made.rates, 0.0)
    run = StageRun(replace(made, rates=rates), settings, Source(settings, catalog).data())
    before = gaussians.means.detach().clone()
    strongest = []
    for step in range(12):
        if step == 11:
            strongest = run._screen_gradients.above(0.0).topk(1).indices.tolist()
        run.advance()
    assert strongest == [2]
    moved = (gaussians.means.detach() - before).abs().sum(dim=1).nonzero().flatten().tolist()
    assert set(moved) <= {12, 13, 14}
    assert not run._screen_gradients.totals.any()  # begun anew


def test_a_run_by_gradient_and_hard_examples_goes_on_bit_for_bit(make_catalog) -> None:
    settings = TrainingSettings(
        gaussians=40, relocation_interval=7, relocation_target="gradient", hard_example_power=1.0, canonical_steps=230
    )
    source = Source(settings, make_catalog(view_splits=("train",) * 4))
    data = source.data()

    def fresh(gaussians: Gaussians, memory: LoopMemory | None = None) -> StageRun:
        return StageRun(canonical_stage(gaussians, settings), settings, data, memory)

    first = source.initial_gaussians(data)
    first.opacity_logits[::3] = -7.0  # so that something is relocated
    whole, parts = fresh(first.copy()), fresh(first.copy())
    for _ in range(115):
        whole.advance()
    for end in (20, 99, 100, 101, 115):
        while parts.step < end:
            parts.advance()
        memory = parts.memory()
        kept = {name: tensor.detach().clone() for name, tensor in memory.tensors.items()}
        parts = fresh(Gaussians(**parts.stage.tensors).copy(), LoopMemory(memory.step, kept))
    found, expected = ({**run.stage.tensors, **run.memory().tensors} for run in (parts, whole))
    assert found.keys() == expected.keys()
    for name, tensor in expected.items():
        assert found[name].detach().numpy().tobytes() == tensor.detach().numpy().tobytes(), name
