"""Changes that help on a single member, tested on a whole ensemble with its deformation."""

from __future__ import annotations

import json
import tempfile
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from catalogs.vocabulary.scene import Scene
from research.benchmarks.page import PROJECT, table
from research.benchmarks.training.fidelity.fitting import catalog_of, is_fitted, provenance
from surrogate.settings import TrainingSettings
from surrogate.storage.records import write_json
from surrogate.training.run import train

SCENES = ("tgv-dvr", "cloverleaf", "nyx")
SHORTER = 3  # times than the scene's own training
JUDGES = 64
CHANGES: Mapping[str, Mapping[str, Any]] = {
    "as it is": {},
    "seed 1": {"seed": 1},
    "no relocation": {"relocation_interval": 0},
}


def measure(runs: Path, folder: Path, scale: float, say: Callable[[str], None]) -> None:
    """Train every available scene with every change that has no result yet."""
    for scene in SCENES:
        catalog = catalog_of(runs, scene)
        for name, change in CHANGES.items() if catalog else ():
            assert catalog is not None
            settings = _settings(scene, scale).changed(**change)
            path = folder / "ensembles" / f"{scene}-{''.join(c if c.isalnum() else '_' for c in name)}.json"
            if is_fitted(path, settings):
                continue
            with tempfile.TemporaryDirectory() as place:
                surrogate = train(settings, catalog, Path(place) / "surrogate")
            psnr = surrogate.training["curve"][-1]["psnr"]
            say(f"ensemble {scene}, {name}: {psnr:.2f} dB")
            record = {"scene": scene, "change": name, "settings": settings.to_json(), "psnr": psnr}
            write_json(path, record | provenance())


def stored(folder: Path) -> list[dict[str, Any]]:
    """The stored results."""
    return [json.loads(path.read_text()) for path in sorted((folder / "ensembles").glob("*.json"))]


def ensembles_table(results: list[dict[str, Any]]) -> str:
    """Validation PSNR by change and scene."""
    scenes = [scene for scene in SCENES if any(r["scene"] == scene for r in results)]
    scores = {(r["change"], r["scene"]): r["psnr"] for r in results}
    rows = [
        [change, *(f"{scores[change, scene]:.2f}" if (change, scene) in scores else "–" for scene in scenes)]
        for change in CHANGES
    ]
    return table(["", *(f"{scene}: validation, dB" for scene in scenes)], rows)


def _settings(scene: str, scale: float) -> TrainingSettings:
    own = TrainingSettings.from_table(Scene.load(PROJECT / "scenes" / f"{scene}.toml").training)
    steps = max(2, round(scale * own.deformation_steps / SHORTER))
    return own.changed(
        color_degree=0,
        canonical_steps=max(2, round(scale * own.canonical_steps / 2)),
        deformation_steps=steps,
        fit_to_need=False,
        validation_images=JUDGES,
        validation_interval=steps,
    )
