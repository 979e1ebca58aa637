"""A small surrogate without a training."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import torch

from catalogs.vocabulary.parameters import Parameter, ParameterSpace
from surrogate import Surrogate
from surrogate.deformation import BilinearDeformation
from surrogate.gaussians import Gaussians, Normalization
from surrogate.rasterizer import Rasterizer
from surrogate.settings import TrainingSettings

CENTER, EXTENT = np.array([1e6, -2e6, 5.0]), 40.0


def large_surrogate() -> Surrogate:
    """A surrogate with enough Gaussians for several threads of torch, drawn by the kernels."""
    return replace(some_surrogate(count=20_000), rasterizer=Rasterizer())


def some_surrogate(color_columns: int = 3, count: int = 30) -> Surrogate:
    torch.manual_seed(3)
    shapes = ((count, 3), (count, 3), (count, 4), (count,), (count, color_columns))
    means, log_scales, quats, logits, colors = (torch.randn(shape) for shape in shapes)
    gaussians = Gaussians(0.4 * means, 0.2 * log_scales - 1.6, quats, logits, colors.sigmoid())
    deformation = BilinearDeformation.create(gaussians, 2, TrainingSettings(latent_size=4, hidden_width=8))
    torch.nn.init.normal_(deformation.weights_out, std=0.3)
    space = ParameterSpace((Parameter("Re", 1500.0, 2500.0), Parameter("time", 0.0, 2.0, "s")))
    return Surrogate(
        gaussians, deformation, space, Normalization(CENTER, EXTENT), Rasterizer(backend="reference"), (1.0, 0.5, 0.0)
    )
