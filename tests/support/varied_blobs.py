"""An ensemble with variations that a surrogate built by hand draws itself: what it predicts of it is perfect."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import torch

from catalogs.store.catalog import Catalog
from catalogs.vocabulary.appearance import TransferFunction
from surrogate.deformation import BilinearDeformation, ValuesDeformation
from surrogate.deformation.visualization import Visualization
from surrogate.gaussians import Gaussians, Normalization
from surrogate.model import Surrogate
from surrogate.rasterizer import Rasterizer
from surrogate.settings import TrainingSettings
from tests.support import families
from tests.support.blobs import Blobs

BLOBS = Blobs(size=24)
VIEW_SPLITS = ("train", "train", "validation", "test", "test")
FUNCTION = TransferFunction(((0.0, 0.0, 0.0, 1.0), (3.0, 1.0, 0.0, 0.0)), ((0, 0), (1, 0.3), (2, 0.6), (3, 1)), 0.3)
# Places are multiples of the largest displacements, so of the distances that a network sees.
STEPS = np.array([0.4, 0.2, 0.4, 0.2])
PLACES = {
    "train": ((1, 0, 0, 0), (0, 1, 0, 0), (0, 0, 1, 0), (0, 0, 0, 1), (-1, -1, 0, 0)),
    "validation": ((0.1, 0.2, 0.3, -0.4),),
    "test": ((0.75, 0.25, 0, 0), (-0.5, -0.25, 0.25, 0)),
}
ISOVALUE = families.isovalues({"train": (1.0, 2.0, 4.0, 16.0), "validation": (3.0,), "test": (2.5, 8.0)})
FUNCTIONS = families.transfer_functions(STEPS, PLACES)
EVERYTHING = ("dvr", *(s.appearance for v in (ISOVALUE, FUNCTIONS) for s in v.settings))
UNSEEN = tuple(name for v in (ISOVALUE, FUNCTIONS) for name in v.named("test"))
# One training member shows no variation; the test member shows two trained isovalues and two trained transfer functions.
MEMBERS: Mapping[str, tuple[float, Sequence[str]]] = {
    "train-0": (0.0, EVERYTHING),
    "train-1": (1.0, ("dvr",)),
    "validation-0": (0.25, ("dvr", *ISOVALUE.named("validation"), *FUNCTIONS.named("validation"))),
    "test-0": (0.5, ("dvr", "iso=1", "iso=16", "tf-train-0", "tf-train-1", *UNSEEN)),
}


def varied_surrogate() -> Surrogate:
    """Blobs that follow one simulation parameter, an isovalue and a transfer function."""
    gaussians = BLOBS.gaussians(0.5)
    simulation = moving(1, seed=1)
    visualizations = (
        Visualization(ISOVALUE, moving(2, seed=2), moving(1, seed=3)),
        Visualization(FUNCTIONS, applied(gaussians)),
    )
    return Surrogate(
        gaussians,
        simulation,
        BLOBS.space,
        Normalization.of_box(BLOBS.bounds),
        Rasterizer(backend="reference"),
        training={
            "appearance": "dvr",
            "fingerprint": "by hand",
            "seconds": 1.0,
            "steps": 10,
            "settings": TrainingSettings().to_json(),
            "curve": [],
        },
        visualizations=visualizations,
    )


def moving(parameters: int, *, seed: int) -> BilinearDeformation:
    """A deformation that moves everything visibly."""
    settings = TrainingSettings(seed=seed, latent_size=4, hidden_width=8)
    still = BilinearDeformation.create(BLOBS.gaussians(0.5), parameters, settings)
    random = torch.Generator().manual_seed(seed)
    return replace(
        still, latents=4.0 * still.latents, weights_out=0.7 * torch.randn(still.weights_out.shape, generator=random)
    )


def applied(gaussians: Gaussians) -> ValuesDeformation:
    """Weights of field values with which transfer functions change every Gaussian visibly."""
    made = ValuesDeformation.create(gaussians, FUNCTION, np.linspace(0.0, 3.0, 8), STEPS.tolist())
    random = torch.Generator().manual_seed(4)
    return replace(made, weights=made.weights + 0.4 * torch.randn(made.weights.shape, generator=random))


def varied_catalog(
    path: Path,
    surrogate: Surrogate,
    members: Mapping[str, tuple[float, Sequence[str]]] = MEMBERS,
    background: tuple[float, float, float] | None = None,
) -> Catalog:
    """The images that `surrogate` draws: members by name, which begins with their split, with p and what they show."""
    return families.family_catalog(
        path,
        BLOBS,
        FUNCTION,
        (ISOVALUE, FUNCTIONS),
        {name: (name.split("-")[0], p, shown) for name, (p, shown) in members.items()},
        lambda p, shown: partial(surrogate.at(p=p, **varied(shown.name)).render, background=background),
        view_splits=VIEW_SPLITS,
        background=background,
    )


def varied(appearance: str) -> dict[str, float]:
    """The visualization parameters of an appearance."""
    for variation in (ISOVALUE, FUNCTIONS):
        setting = variation.setting(appearance)
        if setting is not None:
            return dict(zip(variation.space.names, setting.values, strict=True))
    return {}
