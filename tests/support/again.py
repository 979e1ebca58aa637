"""A scene of a bundled simulation, so small that its fields are made again in a moment, and a surrogate of it made by hand."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import torch

from catalogs.store.catalog import Catalog
from catalogs.vocabulary.appearance import VolumeRendering
from catalogs.vocabulary.scene import Scene
from catalogs.vocabulary.variations import transfer_function_family
from insitu.ensembles.dataset import make_dataset
from surrogate import Surrogate
from surrogate.deformation import BilinearDeformation, ValuesDeformation
from surrogate.deformation.visualization import Visualization
from surrogate.gaussians import Gaussians, Normalization
from surrogate.rasterizer import Rasterizer
from surrogate.settings import TrainingSettings

SETTINGS = TrainingSettings(gaussians=40, latent_size=4, hidden_width=8)
SCENE = """
name = "again"
[source]
kind = "simulation"
simulation = "taylor_green"
resolution = 12
time = 0.1
[[parameters]]
name = "Re"
low = 100.0
high = 200.0
[members]
train = [100.0, 200.0]
test = [130.0, 150.0, 170.0]
[[appearance]]
kind = "volume"
name = "dvr"
[appearance.transfer_function]
color_points = [[-2.0, 0.1, 0.2, 0.9], [0.0, 0.9, 0.9, 0.8], [2.0, 0.9, 0.2, 0.1]]
opacity_points = [[-2.0, 0.0], [-0.3, 0.3], [0.3, 0.2], [2.0, 1.0]]
opacity_unit_distance = 1.0
[views]
frequency = 1
width = 40
height = 32
[render]
target_decibels = 45.0
"""


def scene_file(folder: Path) -> Path:
    """The scene's file, written into a folder."""
    path = folder / "again.toml"
    path.write_text(SCENE)
    return path


def rendered(path: Path, runs: Path) -> Catalog:
    """The data set of the scene in `path`."""
    return Catalog.open(make_dataset(Scene.load(path), runs, workers=1).catalog)


def made(catalog: Catalog, *, seed: int = 0, values: bool = True) -> Surrogate:
    """A surrogate that learnt nothing, of Gaussians that know field values unless those are left out."""
    random = torch.Generator().manual_seed(seed)
    shapes = ((40, 3), (40, 3), (40, 4), (40,), (40, 3))
    means, scales, quats, logits, colors = (torch.randn(shape, generator=random) for shape in shapes)
    gaussians = Gaussians(0.4 * means, 0.2 * scales - 1.6, quats, logits, colors.sigmoid())
    base = catalog.plan.appearances[0]
    assert isinstance(base, VolumeRendering)
    variation = transfer_function_family(base, first_step=(0.2, 0.1), second_step=(0.2, 0.1)).variation
    steps = [parameter.high for parameter in variation.space.parameters]
    known = ValuesDeformation.create(gaussians, base.transfer_function, np.linspace(-2.0, 2.0, 8), steps)
    settings = SETTINGS.changed(seed=seed).to_json()
    return Surrogate(
        gaussians,
        BilinearDeformation.create(gaussians, 1, SETTINGS),
        catalog.plan.space,
        Normalization.of_box(catalog.plan.bounds),
        Rasterizer(),
        training={"appearance": "dvr", "fingerprint": f"by hand {seed}", "seconds": 1.0, "settings": settings},
        visualizations=(Visualization(variation, known),) if values else (),
    )
