"""Small trained models whose needs are known."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import pytest
import torch

from catalogs.vocabulary.cameras import Camera
from surrogate.deformation import BilinearDeformation
from surrogate.settings import TrainingSettings
from surrogate.training.compression.evaluator import Evaluator
from surrogate.training.data import Example, TrainingData
from surrogate.training.state import FittedGaussians
from tests.support.blobs import Blobs
from tests.support.comparing import stored_picture

SETTINGS = TrainingSettings(canonical_steps=200, deformation_steps=800, latent_size=6, hidden_width=8)
TRUE_MODES = 2


@dataclass(frozen=True, eq=False)
class Known:
    """A model that fits its images exactly, and the evaluator to try it on."""

    fitted: FittedGaussians
    evaluator: Evaluator


MakeKnown = Callable[..., Known]


@pytest.fixture
def make_known() -> MakeKnown:
    """Blobs that only the named attributes of follow the parameter, by two modes of six; `useless` more change nothing."""

    def make(moving: tuple[str, ...] = ("means",), useless: int = 0, directional: float = 0.0) -> Known:
        blobs, random = Blobs(), torch.Generator().manual_seed(4)
        gaussians = blobs.gaussians(0.5)
        deformation = BilinearDeformation.create(gaussians, 1, SETTINGS)
        for name in ("means", "log_scales", "quats", "opacity_logits", "colors"):
            if name not in moving:
                deformation = deformation.without(name)
        torch.nn.init.normal_(deformation.weights_out, std=1.0, generator=random)
        rank = torch.randn(6, TRUE_MODES, generator=random) @ torch.randn(TRUE_MODES, 6, generator=random)
        exact = replace(deformation, latents=0.4 * deformation.latents @ rank)
        fitted = FittedGaussians(gaussians, exact)
        truth = gaussians.with_color_degree(1)
        truth.colors[:, 3:] = directional * torch.randn(len(truth), 9, generator=random)
        images = [
            example(FittedGaussians(truth, exact), camera, p)
            for camera in blobs.cameras()[:10]
            for p in (-1.0, -0.4, 0.2, 0.8)
        ]
        learnt, watched = [e for i, e in enumerate(images) if i % 4], images[::4]
        return Known(with_useless(fitted, useless), Evaluator(SETTINGS, TrainingData(learnt, watched, None)))

    return make


def example(fitted: FittedGaussians, camera: Camera, p: float) -> Example:
    """The picture of a model as a stored image."""
    parameters = torch.tensor([p])
    return stored_picture(fitted.at(parameters), camera, parameters)


def with_useless(fitted: FittedGaussians, count: int) -> FittedGaussians:
    """`count` copies of the first Gaussian, too faint to be drawn, among the others."""
    rows = torch.cat([torch.zeros(count, dtype=torch.int64), torch.arange(len(fitted.gaussians))])
    more = fitted.of(rows).copy()
    more.gaussians.opacity_logits[:count] = -9.0
    shuffled = torch.randperm(len(rows), generator=torch.Generator().manual_seed(1))
    return more.of(shuffled)
