"""A run beside its catalog, as training leaves it."""

from __future__ import annotations

from pathlib import Path

from catalogs.store.catalog import Catalog
from surrogate.settings import TrainingSettings
from surrogate.storage.checkpoints import fingerprint
from surrogate.storage.runs import RunRecord
from surrogate.training.run import train

SETTINGS = TrainingSettings(
    gaussians=60, canonical_steps=2, deformation_steps=4, visualization_steps=4, fit_to_need=False
)


def finish(folder: Path, *, only_field: bool) -> Path:
    """Train a surrogate of few Gaussians, or an emulated field alone, of `catalog.cdb` in a folder; returns the folder."""
    catalog = Catalog.open(folder / "catalog.cdb")
    train(SETTINGS, catalog, folder / "surrogate", only_field=only_field)
    RunRecord("catalog.cdb", SETTINGS.to_json(), catalog.splits, fingerprint(SETTINGS, catalog)).save(folder)
    return folder
