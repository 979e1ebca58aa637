"""An ensemble that shows a second field beside its base: the same blobs under other looks."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from catalogs.store.catalog import Catalog, CatalogPlan
from catalogs.vocabulary.appearance import Appearance, Isosurface, TransferFunction, VolumeRendering
from catalogs.vocabulary.variations import field_variation
from tests.support.field_blobs import BLOBS, FUNCTION, FieldBlobs, summary

OTHER = TransferFunction(
    ((0.0, 0.2, 0.8, 0.1), (3.0, 0.9, 0.2, 0.9)), ((0.0, 0.5), (1.0, 0.1), (2.0, 0.6), (3.0, 0.0)), 0.3
)
BASE = VolumeRendering("dvr", FUNCTION, field="q")
SPEED, SURFACE = VolumeRendering("speed-dvr", OTHER, field="speed"), Isosurface("surface", 0.4, field="speed")
FIELDS = field_variation("dvr", appearances=["speed-dvr", "surface"])
MEMBERS = (("train", 0.0), ("train", 0.5), ("train", 1.0), ("validation", 0.4), ("test", 0.7))
VIEWS = ("train",) * 5 + ("validation", "test")


def fields_catalog(
    path: Path,
    members: Sequence[tuple[str, float]] = MEMBERS,
    *,
    looks: Sequence[Appearance] = (BASE, SPEED, SURFACE),
    shown: Sequence[str] | None = None,
    **changes: object,
) -> Catalog:
    """Members of two fields, whose truth is the same blobs under other looks."""
    cameras = BLOBS.cameras()[: len(VIEWS)]
    variations = {"variations": (FIELDS,), **changes}
    plan = CatalogPlan(BLOBS.space, tuple(looks), cameras, VIEWS, BLOBS.bounds, **variations)  # type: ignore[arg-type]
    catalog = Catalog.create(path, plan)
    kept = {"q": summary(BLOBS), "speed": replace(summary(FieldBlobs(count=5)), **points(7))}
    for i, (split, p) in enumerate(members):
        with catalog.begin_member(f"member-{i}", {"p": p}, split=split, appearances=shown) as writer:
            for look in (a for a in looks if a.name in writer.member.appearances):
                for view, camera in enumerate(cameras):
                    writer.write_image(look.name, view, BLOBS.drawn(p, look, camera))
            writer.write_summaries(kept)
    return Catalog.open(path)


def points(count: int) -> dict[str, np.ndarray]:
    random = np.random.default_rng(1)
    places = random.uniform(-0.5, 0.5, (count, 3)).astype(np.float32)
    return {"points": places, "point_values": places[:, 0] + 1, "point_opacities": places[:, 1] ** 2}
