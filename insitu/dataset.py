"""A scene's data set: `runs/<scene>/catalog.cdb`, made or completed by whatever the scene's source needs."""

from __future__ import annotations

import json
import time as clock
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from catalogs import durable
from catalogs.catalog import Catalog
from catalogs.exchange import import_nerf
from catalogs.scene import Scene
from insitu.ensemble import run_ensemble
from insitu.planning import Wishes
from insitu.sources import ensemble_of

CATALOG, RECORD, KEPT = "catalog.cdb", "dataset.json", "pilots"


@dataclass(frozen=True)
class DatasetResult:
    """What became of a scene's data set; `seconds` are those of all runs that it took, this one included."""

    catalog: Path
    members: int
    made: int
    seconds: float
    failures: dict[str, str]


def make_dataset(
    scene: Scene,
    runs: Path,
    *,
    workers: int | None = None,
    shard: tuple[int, int] | None = None,
    progress: Callable[[object], None] = lambda state: None,
) -> DatasetResult:
    """Make what is missing of the scene's catalog; goes on where it was interrupted.

    Raises ValueError or CatalogError, before anything is written, where the catalog was made from another scene file or the
    scene can't be had; FileNotFoundError where its data are absent.
    """
    folder = scene.run_directory(runs)
    with _timed(folder) as seconds:
        if scene.source["kind"] == "nerf":
            made, failures = _import(scene, folder, progress)
        else:
            made, failures = _render(scene, folder, workers, shard, progress)
    members = len(Catalog.open(folder / CATALOG).members)
    return DatasetResult(folder / CATALOG, members, made, seconds(), failures)


def _render(
    scene: Scene,
    folder: Path,
    workers: int | None,
    shard: tuple[int, int] | None,
    progress: Callable[[object], None],
) -> tuple[int, dict[str, str]]:
    ensemble = ensemble_of(scene)
    distance = scene.render.sample_distance
    wishes = Wishes(
        space=ensemble.space,
        appearances=scene.appearances,
        views=scene.views,
        target_decibels=None if distance is not None else scene.render.target_decibels,
        sample_distance=distance,
        provenance={"scene": scene.name, "source": dict(ensemble.source.identity)},
    )
    result = run_ensemble(
        folder / CATALOG,
        ensemble.members,
        ensemble.source,
        wishes,
        workers=workers,
        shard=shard,
        kept=folder / KEPT,
        progress=progress,
    )
    return len(result.rendered), dict(result.failures)


def _import(scene: Scene, folder: Path, progress: Callable[[object], None]) -> tuple[int, dict[str, str]]:
    table = dict(scene.source)
    unknown = sorted(set(table) - {"kind", "path", "bounds", "background"})
    if unknown or "bounds" not in table:
        raise ValueError(
            f"scene {scene.path}: source of kind nerf needs path, bounds and maybe background, got {sorted(table)}"
        )
    before = len(Catalog.open(folder / CATALOG).members) if (folder / CATALOG).is_dir() else 0
    started = clock.perf_counter()

    def show(done: int, total: int) -> None:
        rate = done / (clock.perf_counter() - started)
        progress(f"importing  {done}/{total} images  {rate:.0f}/s")

    catalog = import_nerf(
        scene.data_path(),
        folder / CATALOG,
        bounds=table["bounds"],
        background=table.get("background", (1.0, 1.0, 1.0)),
        space=scene.space if len(scene.space) else None,
        validation_members=scene.validation_members,
        seed=scene.seed,
        provenance={"scene": scene.name},
        progress=show,
    )
    return len(catalog.members) - before, {}


@contextmanager
def _timed(folder: Path) -> Iterator[Callable[[], float]]:
    """Add the block's seconds to those recorded in `dataset.json`, also when it is interrupted."""
    path, started = folder / RECORD, clock.perf_counter()
    before = _recorded_seconds(path)

    def seconds() -> float:
        return before + clock.perf_counter() - started

    existed = (folder / CATALOG).is_dir()
    complete = _members(folder)
    try:
        yield seconds
    finally:
        if (folder / CATALOG).is_dir() and (not existed or _members(folder) != complete):
            durable.replace(path, json.dumps({"seconds": seconds()}).encode())


def _members(folder: Path) -> int:
    members = folder / CATALOG / "members"
    return sum(not p.name.startswith(".") for p in members.iterdir()) if members.is_dir() else 0


def _recorded_seconds(path: Path) -> float:
    try:
        return float(json.loads(path.read_text(encoding="utf-8"))["seconds"])
    except (OSError, ValueError, KeyError, TypeError):
        return 0.0
