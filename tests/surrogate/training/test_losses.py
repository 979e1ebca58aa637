"""The fused loss against its twin, and the twin against scikit-image."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from skimage.metrics import structural_similarity as skimage_ssim

from native import kernels
from surrogate.training.losses import image_loss, image_loss_reference, structural_similarity


def pair(height: int, width: int, channels: int = 3, seed: int = 0) -> tuple[torch.Tensor, torch.Tensor]:
    random = torch.Generator().manual_seed(seed)
    target = torch.rand(height, width, channels, generator=random, dtype=torch.float64)
    noise = torch.randn(height, width, channels, generator=random, dtype=torch.float64)
    return (target + 0.1 * noise).clamp(0, 1), target


@pytest.mark.parametrize("size", [(40, 64), (37, 41), (1, 1), (5, 90), (70, 3)], ids=str)
@pytest.mark.parametrize("channels", [1, 3, 4])
def test_value_and_gradient_equal_the_twin(size: tuple[int, int], channels: int) -> None:
    image, target = pair(*size, channels)
    slow = image.clone().requires_grad_()
    wanted = image_loss_reference(slow, target)
    wanted.backward()
    fast = image.float().requires_grad_()
    got = image_loss(fast, target.float())
    got.backward()
    assert abs(got.item() - wanted.item()) < 1e-6
    assert slow.grad is not None
    assert fast.grad is not None
    assert float((fast.grad - slow.grad).abs().max()) < 2e-5 * float(slow.grad.abs().max())


def test_the_twin_agrees_with_scikit_image_away_from_the_border() -> None:
    image, target = pair(50, 44)
    mine = structural_similarity(image, target)[5:-5, 5:-5].mean()
    _, theirs = skimage_ssim(
        target.numpy(),
        image.numpy(),
        data_range=1.0,
        channel_axis=2,
        gaussian_weights=True,
        sigma=1.5,
        use_sample_covariance=False,
        full=True,
    )
    assert float(mine) == pytest.approx(float(theirs[5:-5, 5:-5].mean()), abs=1e-9)


def test_equal_pictures_lose_nothing_and_flat_ones_stay_finite() -> None:
    _, target = pair(30, 30)
    image = target.float().requires_grad_()
    loss = image_loss(image, target.float())
    loss.backward()
    assert abs(loss.item()) < 1e-6
    flat = torch.ones(30, 30, 3, requires_grad=True)
    image_loss(flat, torch.ones(30, 30, 3)).backward()
    assert flat.grad is not None
    assert torch.isfinite(flat.grad).all()


def test_threads_and_instruction_sets_agree() -> None:
    image, target = (t.float().numpy() for t in pair(100, 75))
    first = kernels.image_loss(image, target, 0.2, 1)
    for threads in (2, 5):
        again = kernels.image_loss(image, target, 0.2, threads)
        assert again[:2] == first[:2]
        assert np.array_equal(again[2], first[2])
    for name in kernels.instruction_sets():
        other = kernels.image_loss(image, target, 0.2, 2, name)
        assert other[0] == pytest.approx(first[0], rel=1e-6)
        assert other[1] == pytest.approx(first[1], rel=1e-6)


def test_different_shapes_are_refused() -> None:
    with pytest.raises(ValueError, match="same shape"):
        image_loss(torch.zeros(4, 4, 3), torch.zeros(4, 5, 3))


def test_bytes_are_compared_as_the_fractions_that_they_stand_for() -> None:
    image = pair(30, 37)[0].float()
    target = torch.randint(0, 256, (30, 37, 3), generator=torch.Generator().manual_seed(1), dtype=torch.uint8)
    for name in kernels.instruction_sets():
        as_bytes = kernels.image_loss(image.numpy(), target.numpy(), 0.2, 1, name)
        as_floats = kernels.image_loss(image.numpy(), (target.float() * (1 / 255)).numpy(), 0.2, 1, name)
        assert as_bytes[:2] == as_floats[:2]
        assert np.array_equal(as_bytes[2], as_floats[2])
    assert image_loss(image, target).item() == pytest.approx(image_loss(image, target / 255).item(), rel=1e-6)


def test_channels_that_the_target_lacks_are_not_compared() -> None:
    image, target = (t.float() for t in pair(20, 33, channels=4))
    four = image.clone().requires_grad_()
    image_loss(four, target[..., :3].contiguous()).backward()
    three = image[..., :3].clone().requires_grad_()
    loss = image_loss(three, target[..., :3].contiguous())
    loss.backward()
    assert four.grad is not None
    assert three.grad is not None
    assert torch.equal(four.grad[..., :3], three.grad)
    assert not four.grad[..., 3].any()
