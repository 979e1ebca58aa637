"""The training loss: mean absolute difference plus structural dissimilarity, by a fused kernel or its reference."""

from __future__ import annotations

from typing import Any

import torch
from torch import Tensor

from native import kernels
from native.threads import cores

WINDOW = 11
SIGMA = 1.5
SSIM_WEIGHT = 0.2
C1, C2 = 0.01**2, 0.03**2


def image_loss(
    image: Tensor, target: Tensor, *, ssim_weight: float = SSIM_WEIGHT, threads: int | None = None
) -> Tensor:
    """mean |image - target| + ssim_weight (1 - SSIM) of pictures (H, W, C); differentiable in `image` only.

    `target` holds floats in [0, 1] or bytes in 0..255.  Channels that only `image` has are not compared.  SSIM is Wang et al. 2004
    with an 11x11 Gaussian window of sigma 1.5 and zeros beyond the border, averaged over pixels and channels.  In
    main memory the C++ kernel computes value and gradient at once, in float32; on a GPU torch does.
    """
    if not image.is_cpu:
        return image_loss_reference(image, target, ssim_weight=ssim_weight)
    return _ImageLoss.apply(image, target, ssim_weight, threads or cores())


def image_loss_reference(image: Tensor, target: Tensor, *, ssim_weight: float = SSIM_WEIGHT) -> Tensor:
    """The same in plain torch, in the dtype of `image`: the definition that the kernel is tested against."""
    target = target.to(image.dtype) / 255.0 if target.dtype == torch.uint8 else target
    image = image[..., : target.shape[2]]
    return (image - target).abs().mean() + ssim_weight * (1.0 - structural_similarity(image, target).mean())


def structural_similarity(image: Tensor, target: Tensor) -> Tensor:
    """SSIM map (H, W, C) of pictures (H, W, C), zeros beyond the border."""
    x, y = image.permute(2, 0, 1)[:, None], target.permute(2, 0, 1)[:, None]  # [C, 1, H, W]
    offsets = torch.arange(WINDOW, dtype=image.dtype, device=image.device) - WINDOW // 2  # [11]
    window = torch.exp(-0.5 * (offsets / SIGMA) ** 2)
    window = window / window.sum()
    kernel = torch.outer(window, window)[None, None]  # [1, 1, 11, 11]

    def local_mean(values: Tensor) -> Tensor:
        return torch.nn.functional.conv2d(values, kernel, padding=WINDOW // 2)

    mean_x, mean_y = local_mean(x), local_mean(y)
    variance_x, variance_y = local_mean(x * x) - mean_x**2, local_mean(y * y) - mean_y**2
    covariance = local_mean(x * y) - mean_x * mean_y
    similarity = ((2 * mean_x * mean_y + C1) * (2 * covariance + C2)) / (
        (mean_x**2 + mean_y**2 + C1) * (variance_x + variance_y + C2)
    )
    return similarity[:, 0].permute(1, 2, 0)  # [H, W, C]


class _ImageLoss(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, *inputs: Any) -> Tensor:
        image, target, ssim_weight, threads = inputs
        kinds = (torch.float32, torch.uint8 if target.dtype == torch.uint8 else torch.float32)
        predicted, wanted = (
            t.detach().to(kind).contiguous().numpy() for t, kind in zip((image, target), kinds, strict=True)
        )
        difference, similarity, gradient = kernels.image_loss(predicted, wanted, ssim_weight, threads)
        ctx.gradient = torch.from_numpy(gradient)
        return image.new_tensor(difference + ssim_weight * (1.0 - similarity))

    @staticmethod
    def backward(ctx: Any, *gradients: Tensor) -> tuple[Tensor | None, ...]:
        return ctx.gradient * gradients[0], None, None, None
