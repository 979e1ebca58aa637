"""An ensemble with variations whose truth is known: blobs of one field value each, and surfaces that shrink with an isovalue."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray

from catalogs.store.catalog import Catalog
from catalogs.store.summary import FieldSummary
from catalogs.vocabulary.appearance import Appearance, Isosurface, TransferFunction, VolumeRendering
from catalogs.vocabulary.cameras import Camera
from catalogs.vocabulary.variations import Variation, VariationSetting
from surrogate.gaussians import Gaussians
from surrogate.rasterizer import Rasterizer
from tests.support import families
from tests.support.blobs import Blobs

FUNCTION = TransferFunction(
    ((0.0, 0.1, 0.2, 0.9), (1.5, 0.9, 0.9, 0.2), (3.0, 0.9, 0.1, 0.1)), ((0, 0), (1, 0.3), (2, 0.5), (3, 1)), 0.3
)
STEPS = np.array([0.4, 0.25, 0.4, 0.3])
ISOVALUE = families.isovalues({"train": (0.1, 0.3, 0.55, 0.8), "validation": (0.4,), "test": (0.2,)})
TRAINED = [[s if i == axis else 0.0 for i in range(4)] for axis in range(4) for s in (-1.0, 1.0)]
TRAINED += [[1.0, 1.0, 1.0, 1.0], [-1.0, -1.0, -1.0, -1.0], [1.0, -1.0, -1.0, 1.0], [-1.0, 1.0, 1.0, -1.0]]
PLACES = {
    "train": TRAINED,
    "validation": [[0.3, -0.5, 0.4, 0.2]],
    "test": [[0.4, 0.8, 0.0, -0.6], [0.5, -0.5, -0.5, 0.5]],
}
FUNCTIONS = families.transfer_functions(STEPS, PLACES)
UNRELATED = Isosurface("unrelated", 0.5)
MEMBERS = (("train", 0.0), ("train", 0.5), ("train", 1.0), ("validation", 0.3))
VIEW_SPLITS = ("train",) * 5 + ("validation",)


@dataclass(frozen=True)
class FieldBlobs(Blobs):
    """Every blob is homogeneous: it has one value, and a thickness in units of the transfer function's distance."""

    size: int = 24

    @property
    def values(self) -> NDArray[np.float64]:
        return np.random.default_rng(8).uniform(0.2, 2.8, self.count)  # [N]

    def shown(self, p: float, appearance: Appearance) -> Gaussians:
        """The truth at p, in coordinates where the box is [-1, 1]."""
        plain = self.gaussians(p)
        if isinstance(appearance, Isosurface):
            radius = np.sqrt(-2.0 * np.log(appearance.isovalue))  # of exp(-r² / 2) = isovalue
            return replace(plain, log_scales=plain.log_scales + float(np.log(radius / 1.5)))
        assert isinstance(appearance, VolumeRendering)
        function, values = appearance.transfer_function, self.values
        depths = -1.5 * np.log1p(-np.minimum(function.opacities(values), 0.999))  # [N], optical
        logits, colors = np.log(np.expm1(depths.clip(1e-6))), function.colors(values)
        return replace(plain, opacity_logits=torch.from_numpy(logits).float(), colors=torch.from_numpy(colors).float())

    def drawn(self, p: float, appearance: Appearance, camera: Camera) -> NDArray[np.float32]:
        """Premultiplied RGBA (H, W, 4) as `camera` sees it; the box must be [-1, 1]."""
        drawn = Rasterizer(backend="cpu").draw(self.shown(p, appearance), camera)
        return torch.cat([drawn.color, drawn.alpha[..., None]], dim=2).numpy().clip(0.0, 1.0)


BLOBS = FieldBlobs()


def appearance_of(setting: VariationSetting) -> Appearance:
    """The image of a setting of `ISOVALUE` or `FUNCTIONS`."""
    return families.appearance_of(setting, FUNCTION)


def field_catalog(
    path: Path,
    variations: Sequence[Variation] = (ISOVALUE, FUNCTIONS),
    *,
    blobs: FieldBlobs = BLOBS,
    members: Sequence[tuple[str, float]] = MEMBERS,
    view_splits: Sequence[str] = VIEW_SPLITS,
    shown_by: Sequence[str] = ("train", "validation", "test"),
    unrelated: bool = False,
    summaries: bool = False,
) -> Catalog:
    """The ensemble as a catalog; members whose split is not in `shown_by` show only the base."""
    varied = [setting.appearance for variation in variations for setting in variation.settings]
    others = [UNRELATED] * unrelated
    everything = [families.BASE, *varied, *(appearance.name for appearance in others)]
    return families.family_catalog(
        path,
        blobs,
        FUNCTION,
        variations,
        {
            f"member-{i}": (split, p, everything if split in shown_by else [families.BASE])
            for i, (split, p) in enumerate(members)
        },
        lambda p, appearance: partial(blobs.drawn, p, appearance),
        view_splits=view_splits,
        others=others,
        summary=summary(blobs) if summaries else None,
    )


def summary(blobs: FieldBlobs) -> FieldSummary:
    """As many samples of the field as there are blobs."""
    histogram, edges = np.histogram(blobs.values, bins=256, range=FUNCTION.bounds)
    none = np.zeros((0, 3), np.float32)
    values = blobs.values
    return FieldSummary(values.min(), values.max(), 0.0, histogram, edges, none, none[:, 0], none[:, 0])
