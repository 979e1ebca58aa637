"""Small surrogates that follow isovalues and transfer functions."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import torch

from surrogate import Surrogate
from surrogate.deformation import BilinearDeformation, Deformation, ValuesDeformation
from surrogate.deformation.visualization import Visualization
from surrogate.gaussians import Gaussians, Normalization
from surrogate.rasterizer import Rasterizer
from surrogate.settings import TrainingSettings
from surrogate.training.state import FittedGaussians
from tests.support.field_blobs import BLOBS, FUNCTION, FUNCTIONS, ISOVALUE, STEPS

SMALL = TrainingSettings(latent_size=4, hidden_width=8)


def shaken(deformation: Deformation, seed: int = 5) -> Deformation:
    """All tensors random, so that everything moves that can."""
    random = torch.Generator().manual_seed(seed)
    tensors = {n: t + 0.4 * torch.randn(t.shape, generator=random) for n, t in deformation.stored().items()}
    return type(deformation).load(tensors, deformation.record())


def bilinear(gaussians: Gaussians, parameters: int, color_columns: int = 3) -> BilinearDeformation:
    """A deformation whose latents spread as widely as trained ones."""
    made = BilinearDeformation.create(gaussians, parameters, SMALL, color_columns=color_columns)
    return replace(made, latents=4.0 * made.latents)


def base(color_degree: int = 0) -> FittedGaussians:
    gaussians = BLOBS.gaussians(0.5).with_color_degree(color_degree)
    gaussians.colors[:, 3:] = 0.1
    return FittedGaussians(gaussians, shaken(bilinear(gaussians, 1)))


def of_functions(fitted: FittedGaussians, color_degree: int = 0) -> Visualization:
    values = ValuesDeformation.create(fitted.gaussians, FUNCTION, np.linspace(0, 3, 8), STEPS.tolist())
    return Visualization(FUNCTIONS, shaken(values), None, color_degree)


def of_isovalue(fitted: FittedGaussians, color_degree: int = 0) -> Visualization:
    wide = fitted.gaussians.with_color_degree(color_degree)
    of_vis = shaken(bilinear(wide, 2, wide.colors.shape[1]))
    return Visualization(ISOVALUE, of_vis, shaken(fitted.deformation, seed=6), color_degree)


def surrogate(fitted: FittedGaussians, *visualizations: Visualization) -> Surrogate:
    return Surrogate(
        *fitted, BLOBS.space, Normalization.of_box(BLOBS.bounds), Rasterizer(), visualizations=visualizations
    )
