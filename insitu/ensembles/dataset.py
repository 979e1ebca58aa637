"""A scene's data set: `runs/<scene>/catalog.cdb`, made or completed by whatever the scene's source needs."""

from __future__ import annotations

import json
import os
import time as clock
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from catalogs.engines.engine import Engine
from catalogs.exchange import import_nerf
from catalogs.files import durable
from catalogs.progress import Count, Rate
from catalogs.store.catalog import Catalog
from catalogs.vocabulary.scene import PlannedMember, Scene
from catalogs.vocabulary.words import joined_names
from insitu.ensembles.coarse import add_coarse_fields
from insitu.ensembles.ensemble import run_ensemble
from insitu.ensembles.function_source import HookedSource, Simulate
from insitu.ensembles.sources import ensemble_of
from insitu.fields.member_fields import check_names
from insitu.members.agreement import disagreements, misplaced
from insitu.members.failures import warn_caller
from insitu.members.notes import Once, notes_on_ensemble
from insitu.members.planning import PlanOptions, is_catalog

CATALOG, RECORD, PILOTS = "catalog.cdb", "dataset.json", "pilots"
RECORD_SECONDS = 10.0


@dataclass(frozen=True)
class DatasetResult:
    """The outcome of making a scene's data set; `seconds` are those of all runs that it took, this one included."""

    catalog: Path
    members: int
    made: int
    seconds: float
    failures: dict[str, str]


def make_dataset(
    scene: Scene | str | os.PathLike[str],
    runs: str | os.PathLike[str] = "runs",
    *,
    simulate: Simulate | None = None,
    workers: int | None = None,
    shard: tuple[int, int] | None = None,
    engine: Engine | None = None,
    only_coarse_fields: bool = False,
    progress: Callable[[object], None] = lambda state: None,
    warn: Callable[[Warning], None] | None = None,
) -> DatasetResult:
    """Make what is missing of the scene's catalog, `runs/<scene>/catalog.cdb`; goes on where it was interrupted.

    Parameters
    ----------
    scene : the scene, or its TOML file.
    runs : folder of all results.
    simulate : for a scene of kind "hooked", the function that makes its fields (see
    `insitu.ensembles.function_source.HookedSource`), instead of that
        of the scene's script.  Worker processes import it, so it is one of a module, or of a script that calls `make_dataset`
        under `if __name__ == "__main__":`.

    only_coarse_fields : render nothing, but give stored members the coarse fields that they lack
        (`insitu.ensembles.coarse.add_coarse_fields`).

    The others are arguments of `run_ensemble`.

    Raises, before anything is written, ValueError or CatalogError where the catalog was made from another scene file or the
    scene can't be read.  Raises FileNotFoundError where its data are absent, and RuntimeError where the script of a hooked scene
    needs a package that this environment lacks.

    Examples
    --------
    >>> import insitu
    >>> result = insitu.make_dataset("vortex.toml", runs="runs", workers=1)
    >>> insitu.Catalog.open("runs/vortex/catalog.cdb")
    <Catalog runs/vortex/catalog.cdb: 4 members (4 train, 0 validation, 0 test); Re in [100, 200]; 12 views of cores>
    """
    scene, runs = scene if isinstance(scene, Scene) else Scene.load(scene), Path(runs)
    scene.check_tables()
    if simulate is not None and scene.source["kind"] != "hooked":
        raise ValueError(
            f'scene {scene.path}: simulate= is for a source of kind "hooked", not {scene.source["kind"]!r}'
        )
    if only_coarse_fields and scene.source["kind"] in ("nerf", "catalog"):
        raise ValueError(f"scene {scene.path}: its images were made elsewhere, and their fields are not at hand")
    if scene.source["kind"] == "catalog":
        return _checked(scene)
    folder = scene.run_directory(runs)
    stopwatch = _Stopwatch(folder)

    def show(state: object) -> None:
        stopwatch.progressed()
        progress(state)

    try:
        if scene.source["kind"] == "nerf":
            count, failures = _import(scene, folder, show)
        else:
            how: dict[str, Any] = {"workers": workers, "shard": shard, "engine": engine, "progress": show, "warn": warn}
            count, failures = _render(scene, folder, simulate, only_coarse_fields, **how)
    finally:
        stopwatch.record()
    members = len(Catalog.open(folder / CATALOG).members)
    return DatasetResult(folder / CATALOG, members, count, stopwatch.seconds, failures)


def _checked(scene: Scene) -> DatasetResult:
    """The contents of a scene's catalog, which is used in place; raises CatalogError where it can't be read."""
    catalog = Catalog.open(scene.catalog_path)
    return DatasetResult(catalog.path, len(catalog.members), 0, 0.0, {})


def _render(
    scene: Scene, folder: Path, simulate: Simulate | None, only_coarse_fields: bool, **how: Any
) -> tuple[int, dict[str, str]]:
    """The number of rendered members, and the reasons for others' failures; `how` goes to `run_ensemble`."""
    ensemble = ensemble_of(scene, simulate)
    try:  # before any simulation runs
        if ensemble.fields != ("",):  # files of one field each, which has no name
            check_names(ensemble.fields, scene.appearances, scene.appearances)
    except ValueError as error:
        raise ValueError(f"scene {scene.path}: {error}") from None
    members = scene.assigned(ensemble.members)
    provenance = {"scene": scene.name, "source": dict(ensemble.source.identity)}
    options = PlanOptions.of_scene(scene, ensemble.space, provenance)
    _check_unchanged(scene, folder / CATALOG, options, members)
    if isinstance(ensemble.source, HookedSource) and not _complete(folder / CATALOG, members):
        ensemble.source.check()
    Once(how["warn"] or warn_caller).say("", notes_on_ensemble(members, ensemble.space))
    path, how = folder / CATALOG, {**how, "nan": scene.render.nan}
    if only_coarse_fields:
        result = add_coarse_fields(path, members, ensemble.source, options, **how)
    else:
        result = run_ensemble(path, members, ensemble.source, options, cache=folder / PILOTS, **how)
    return len(result.rendered), dict(result.failures)


def _complete(path: Path, members: Sequence[PlannedMember]) -> bool:
    """True if the catalog has all the members."""
    return is_catalog(path) and {m.name for m in members} <= {m.name for m in Catalog.open(path).members}


def _check_unchanged(scene: Scene, path: Path, options: PlanOptions, members: Sequence[PlannedMember]) -> None:
    """Raise ValueError naming where the scene differs from the one that made the catalog; new members are welcome."""
    if not is_catalog(path):
        return
    catalog = Catalog.open(path)
    strangers = sorted({m.name for m in catalog.members} - {m.name for m in members})
    changes = disagreements(catalog.plan, options) + misplaced(catalog, members)
    changes += [f"member {name}: not in the scene" for name in strangers]
    if changes:
        more = f"; and {len(changes) - 6} more" if len(changes) > 6 else ""
        raise ValueError(
            f"scene {scene.path} is not the one that {path} was made from: {'; '.join(changes[:6])}{more}. "
            f"Undo the change, give the changed scene another name, or remove {path.parent} to make it anew"
        )


def _import(scene: Scene, folder: Path, progress: Callable[[object], None]) -> tuple[int, dict[str, str]]:
    table = dict(scene.source)
    unknown = sorted(set(table) - {"kind", "path", "bounds", "background"})
    if unknown or "bounds" not in table:
        raise ValueError(
            f"scene {scene.path}: source of kind nerf needs path, bounds and maybe background, got {joined_names(sorted(table))}"
        )
    before = Catalog.open(folder / CATALOG).members if is_catalog(folder / CATALOG) else ()
    there = sum(len(member.cameras) for member in before)  # images imported earlier
    rate = Rate()

    def show(done: int, total: int) -> None:
        if done > there:
            progress(Count("importing", done, total, rate(done)))

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
    return len(catalog.members) - len(before), {}


class _Stopwatch:
    """Adds this run's seconds to those in `dataset.json`, every 10 s, so that a killed run counts too."""

    def __init__(self, folder: Path) -> None:
        self._folder, self._working = folder, False
        self._started = self._recorded = clock.perf_counter()
        try:
            self._before = float(json.loads((folder / RECORD).read_text(encoding="utf-8"))["seconds"])
        except (OSError, ValueError, KeyError, TypeError):
            self._before = 0.0

    @property
    def seconds(self) -> float:
        """Seconds of all runs so far; those recorded where this run had nothing to do."""
        return self._before + (clock.perf_counter() - self._started if self._working else 0.0)

    def progressed(self) -> None:
        """Say that work is going on."""
        self._working = True
        if clock.perf_counter() - self._recorded >= RECORD_SECONDS:
            self.record()

    def record(self) -> None:
        """Write the seconds down if work was done and left something."""
        if self._working and ((self._folder / CATALOG).is_dir() or (self._folder / PILOTS).is_dir()):
            durable.replace(self._folder / RECORD, json.dumps({"seconds": round(self.seconds, 3)}).encode())
            self._recorded = clock.perf_counter()
