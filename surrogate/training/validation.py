"""How well a model's pictures match validation images."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
import torch
from torch import Tensor

from surrogate.evaluation.metrics import psnr
from surrogate.gaussians import Gaussians
from surrogate.rasterizer import Rasterizer
from surrogate.training.data import Example


def mean_psnr(
    gaussians_at: Callable[[Tensor], Gaussians],
    examples: Sequence[Example],
    rasterizer: Rasterizer,
    background: Sequence[float],
) -> float:
    """Mean PSNR (dB) over images, full frame, over `background` (3,), pictures cut to [0, 1].

    `gaussians_at` gives the Gaussians at normalized parameters (P,).
    """
    scores = []
    with torch.no_grad():
        for example in examples:
            picture = rasterizer.draw_over(gaussians_at(example.parameters), example.camera, background)  # [H, W, 4]
            target = np.divide(example.compared()[..., :3], 255.0, dtype=np.float32)  # [H, W, 3]
            scores.append(psnr(target, picture[..., :3].clamp(0.0, 1.0).cpu().numpy()))
    return sum(scores) / len(scores)
