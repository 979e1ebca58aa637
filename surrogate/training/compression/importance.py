"""What each Gaussian contributes to pictures."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import replace

import torch
from torch import Tensor

from surrogate.gaussians import Gaussians
from surrogate.rasterizer import Rasterizer
from surrogate.training.data import Example


def importance(
    gaussians_at: Callable[[Tensor], Gaussians], examples: Iterable[Example], rasterizer: Rasterizer
) -> Tensor:
    """The sum of each Gaussian's weights T alpha over all pixels of the examples' views, (N,); their images are not read.

    A picture is linear in the colours with those weights, so they are the gradient of its sum by one channel.
    """
    total = torch.zeros(0)
    for example in examples:
        with torch.no_grad():
            deformed = gaussians_at(example.parameters)
        colors = deformed.means.new_zeros(len(deformed), 3, requires_grad=True)
        drawn = rasterizer.draw(replace(deformed, colors=colors), example.camera)
        (by_colors,) = torch.autograd.grad(drawn.color[..., 0].sum(), colors)
        total = by_colors[:, 0] if not len(total) else total + by_colors[:, 0]
    return total
