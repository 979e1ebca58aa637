"""Scenes whose pictures are blobs, with their data sets."""

from __future__ import annotations

from pathlib import Path

from catalogs.store.catalog import Catalog, CatalogPlan
from catalogs.vocabulary.appearance import ImportedImages
from surrogate.settings import TrainingSettings
from tests.support.blobs import Blobs

MACHINE = {"processor": "abacus", "cores": 2, "system": "wood"}
SCENE = """
name = "{name}"
title = "Some blobs"
[source]
kind = "nerf"
path = "none"
[training]
gaussians = {gaussians}
canonical_steps = 6
deformation_steps = 6
"""
SETTINGS_OF_SCENE = TrainingSettings(gaussians=20, canonical_steps=6, deformation_steps=6)
BLOBS = Blobs(count=4, size=16)
MEMBERS = {"train-0": 0.0, "train-1": 1.0, "validation-0": 0.5, "test-0": 0.7}
VIEW_SPLITS = ("train", "train", "train", "test")


def make_scene(root: Path, name: str, gaussians: int = 20) -> Path:
    """Write a scene file; returns its path."""
    path = root / "scenes" / f"{name}.toml"
    path.parent.mkdir(exist_ok=True)
    path.write_text(SCENE.format(name=name, gaussians=gaussians))
    return path


def make_catalog(root: Path, name: str) -> Catalog:
    """The data set of a scene."""
    cameras = BLOBS.cameras()[: len(VIEW_SPLITS)]
    plan = CatalogPlan(BLOBS.space, (ImportedImages("drawn"),), cameras, VIEW_SPLITS, BLOBS.bounds)
    catalog = Catalog.create(root / "runs" / name / "catalog.cdb", plan)
    for member, p in MEMBERS.items():
        with catalog.begin_member(member, {"p": p}, split=member.split("-")[0]) as writer:
            for view, camera in enumerate(cameras):
                writer.write_image("drawn", view, BLOBS.picture(p, camera))
    return Catalog.open(catalog.path)
