"""An ensemble with variations that a surrogate built by hand draws itself: what it predicts of it is perfect."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import torch

from catalogs.appearance import Appearance, Isosurface, TransferFunction, VolumeRendering
from catalogs.catalog import Catalog, CatalogPlan
from catalogs.parameters import Parameter, ParameterSpace
from catalogs.variations import POINT_PARAMETERS, Setting, Variation, displaced
from surrogate.deformation import BilinearDeformation
from surrogate.gaussians import Normalization
from surrogate.model import Surrogate
from surrogate.rasterizer import Rasterizer
from surrogate.settings import TrainingSettings
from surrogate.visualization import Visualization
from tests.surrogate.blobs import Blobs

BLOBS = Blobs(size=24)
VIEW_SPLITS = ("train", "train", "validation", "test", "test")
FUNCTION = TransferFunction(((0.0, 0.0, 0.0, 1.0), (3.0, 1.0, 0.0, 0.0)), ((0, 0), (1, 0.3), (2, 0.6), (3, 1)), 0.3)
ISOVALUES = {"train": (1.0, 2.0, 4.0, 16.0), "validation": (3.0,), "test": (2.5, 8.0)}
# Places are multiples of the largest displacements, so of the distances that a network sees.
STEPS = np.array([0.4, 0.2, 0.4, 0.2])
PLACES = {
    "train": ((1, 0, 0, 0), (0, 1, 0, 0), (0, 0, 1, 0), (0, 0, 0, 1), (-1, -1, 0, 0)),
    "validation": ((0.1, 0.2, 0.3, -0.4),),
    "test": ((0.75, 0.25, 0, 0), (-0.5, -0.25, 0.25, 0)),
}
ISOVALUE = Variation(
    "isovalue",
    "dvr",
    ParameterSpace((Parameter("isovalue", 1.0, 16.0),)),
    tuple(Setting(f"iso={v:g}", (v,), split) for split, values in ISOVALUES.items() for v in values),
)
FUNCTIONS = Variation(
    "transfer_function",
    "dvr",
    ParameterSpace(tuple(Parameter(n, -s, s) for n, s in zip(POINT_PARAMETERS, STEPS.tolist(), strict=True))),
    tuple(
        Setting(f"tf-{split}-{i}", tuple(np.multiply(place, STEPS).tolist()), split)
        for split, places in PLACES.items()
        for i, place in enumerate(places)
    ),
)
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
        Visualization(FUNCTIONS, moving(5, seed=4, anchored=4)),
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
            "settings": TrainingSettings().to_json(),
            "curve": [],
        },
        visualizations=visualizations,
    )


def moving(parameters: int, *, seed: int, anchored: int = 0) -> BilinearDeformation:
    """A deformation that moves everything visibly."""
    settings = TrainingSettings(seed=seed, latent_size=4, hidden_width=8, latent_spread=1.0)
    still = BilinearDeformation.create(BLOBS.gaussians(0.5), parameters, settings, anchored=anchored)
    random = torch.Generator().manual_seed(seed)
    return replace(still, weights_out=0.7 * torch.randn(still.weights_out.shape, generator=random))


def varied_catalog(
    path: Path,
    surrogate: Surrogate,
    members: Mapping[str, tuple[float, Sequence[str]]] = MEMBERS,
    background: tuple[float, float, float] | None = None,
) -> Catalog:
    """The images that `surrogate` draws: members by name, which begins with their split, with p and what they show."""
    base = VolumeRendering("dvr", FUNCTION)
    surfaces = [Isosurface(s.appearance, s.values[0]) for s in ISOVALUE.settings]
    volumes = [VolumeRendering(s.appearance, displaced(FUNCTION, s.values)) for s in FUNCTIONS.settings]
    appearances: tuple[Appearance, ...] = (base, *surfaces, *volumes)
    cameras = BLOBS.cameras()[: len(VIEW_SPLITS)]
    variations = (ISOVALUE, FUNCTIONS)
    plan = CatalogPlan(
        BLOBS.space, appearances, cameras, VIEW_SPLITS, BLOBS.bounds, background=background, variations=variations
    )
    catalog = Catalog.create(path, plan)
    for name, (p, shown) in members.items():
        with catalog.begin_member(name, {"p": p}, split=name.split("-")[0], appearances=shown) as writer:
            for appearance in shown:
                deformed = surrogate.at(p=p, **varied(appearance))
                for view, camera in enumerate(cameras):
                    writer.write_image(appearance, view, deformed.render(camera, background=background))
    return catalog


def varied(appearance: str) -> dict[str, float]:
    """The visualization parameters of an appearance."""
    for variation in (ISOVALUE, FUNCTIONS):
        setting = variation.setting(appearance)
        if setting is not None:
            return dict(zip(variation.space.names, setting.values, strict=True))
    return {}
