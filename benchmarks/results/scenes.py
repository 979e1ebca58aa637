"""What runs/ holds of a scene: its report, ceilings, seeds and ablations, each only where it is of the scene as it now is."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from benchmarks.results.studies import StudyKind, StudyResults, kinds_of, read_study
from catalogs.appearance import appearance_to_json
from catalogs.catalog import Catalog
from catalogs.scene import Scene
from surrogate.evaluation.evaluate import VERSION
from surrogate.report.report import RECORD
from surrogate.settings import TrainingSettings
from surrogate.storage.checkpoints import fingerprint
from surrogate.studies.ceiling import load_ceilings, subjects
from surrogate.studies.repeats.records import load_scores
from surrogate.studies.repeats.spread import summarize_repeats
from surrogate.training.source import Source

APPEARANCES = {"volume": "volume rendering", "isosurface": "isosurface", "imported": "pictures made elsewhere"}


@dataclass(frozen=True)
class Gap:
    """What is missing of a scene, and the command that makes it."""

    scene: str
    what: str
    command: str


@dataclass(frozen=True, eq=False)
class SceneResults:
    """One scene.

    Attributes
    ----------
    run : its folder of results.
    base : what its base appearance is, in words.
    report : contents of `report.json`; None without one of the present settings, data and evaluation.
    ceilings : entries of `ceiling.json` beside the same model.
    repeats : `summarize_repeats` of the seeds of the same settings; None for fewer than two.
    studies : its ablations.
    gaps : all that is missing.
    """

    name: str
    title: str
    run: Path
    base: str = ""
    report: Mapping[str, Any] | None = None
    ceilings: Sequence[Mapping[str, Any]] = ()
    repeats: Mapping[str, Any] | None = None
    studies: Sequence[StudyResults] = ()
    gaps: Sequence[Gap] = ()


def read_scenes(scenes: Path, runs: Path) -> list[SceneResults]:
    """All scenes of a folder of TOML files, by name; nothing is written.

    Raises ValueError naming a scene that can't be read.
    """
    return [read_scene(path, runs) for path in sorted(scenes.glob("*.toml"))]


def read_scene(path: Path, runs: Path) -> SceneResults:
    """What there is of one scene.  Raises ValueError for one that can't be read."""
    scene = Scene.load(path)
    settings, run = TrainingSettings(**scene.training), scene.run_directory(runs)
    source = _source(settings, run / "catalog.cdb")
    if source is None:
        gap = Gap(scene.name, "everything", f"make results SCENES={scene.name}")
        return SceneResults(scene.name, scene.title, run, gaps=[gap])
    mark = fingerprint(settings, source.catalog)
    studies = {kind: read_study(kind, run, settings, source.catalog) for kind in kinds_of(len(source.variations))}
    found = SceneResults(
        scene.name,
        scene.title,
        run,
        _base(source),
        _read_report(run / "report" / RECORD, mark),
        [entry for entry in load_ceilings(run) if (entry["surrogate"] or {}).get("fingerprint") == mark],
        summarize_repeats(load_scores(run, base=mark)),
        [study for study in studies.values() if study is not None],
    )
    without = [kind for kind, study in studies.items() if study is None]
    return replace(
        found, gaps=[*_gaps(found, _without_ceiling(source, found.ceilings)), *_study_gaps(scene.name, without)]
    )


def _source(settings: TrainingSettings, path: Path) -> Source | None:
    """The data set with what is learnt from it; None where it is not there, or not whole."""
    if not path.is_dir():
        return None
    try:
        return Source(settings, Catalog.open(path))
    except ValueError:
        return None


def _base(source: Source) -> str:
    appearance = next(a for a in source.catalog.plan.appearances if a.name == source.appearance)
    return APPEARANCES[appearance_to_json(appearance)["kind"]]


def _gaps(found: SceneResults, without_ceiling: Sequence[str]) -> list[Gap]:
    """What is missing of one scene's numbers, but for ablations."""
    name, gaps = found.name, []
    if found.report is None:
        gaps.append(Gap(name, "the report", f"make results SCENES={name}"))
    if without_ceiling:
        gaps.append(Gap(name, f"the ceiling of {', '.join(without_ceiling)}", f"surrogate ceiling scenes/{name}.toml"))
    if found.repeats is None:
        gaps.append(Gap(name, "other seeds", f"surrogate repeat scenes/{name}.toml"))
    return gaps


def _study_gaps(name: str, kinds: Sequence[StudyKind]) -> list[Gap]:
    return [Gap(name, f"the ablation of {kind.title}", kind.command(name)) for kind in kinds]


def _read_report(path: Path, mark: str) -> dict[str, Any] | None:
    """A report's contents; None for nothing, or for one of another model or by another evaluation."""
    try:
        record = json.loads(path.read_text(encoding="utf-8"))
        return record if record["fingerprint"].split(":")[:2] == [str(VERSION), mark] else None
    except (OSError, ValueError, KeyError, TypeError, AttributeError):
        return None


def _without_ceiling(source: Source, ceilings: Sequence[Mapping[str, Any]]) -> list[str]:
    """Names of the appearances that should have a ceiling and have none; none where there can't be any."""
    try:
        wanted = [subject.appearance for subject in subjects(source)]
    except ValueError:
        return []
    return [name for name in wanted if name not in {entry["appearance"] for entry in ceilings}]
