"""Measurements of a scene: report, upper bounds and seeds of the same settings, and ablations, preferably of the present ones."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from catalogs.vocabulary.appearance import ImportedImages, appearance_to_json
from catalogs.vocabulary.scene import Scene
from research.benchmarks.results.studies import StudyResults, published_study, read_studies
from research.benchmarks.splatting.instruction_sets import load as load_instruction_sets
from research.benchmarks.training.curves.measured import Point
from research.benchmarks.training.curves.measured import load as load_curve
from research.benchmarks.training.functions.measured import FunctionScores, load
from research.studies.repeats.seeds import Scores, load_scores, summarize_repeats
from research.studies.upper_bound_records import load_upper_bounds
from surrogate.provenance import code
from surrogate.report.records import load_report
from surrogate.settings import TrainingSettings
from surrogate.storage.records import Record

APPEARANCES = {"volume": "volume rendering", "isosurface": "isosurface", "imported": "pictures made elsewhere"}
PUBLISHED, PUBLISHED_KIND, PUBLISHED_VERSION = "published.json", "published", 1


@dataclass(frozen=True, eq=False)
class SceneResults:
    """One scene.

    Attributes
    ----------
    run : its folder of results, with the images of its report.
    base : description of its base appearance.
    variations : number of variations that its surrogate follows.
    report : figures of its report; None without one.
    upper_bounds : entries about the same model, as `load_upper_bounds` has them.
    seeds, repeats : the scores of the seeds of the same settings, and `summarize_repeats` of them; None for fewer than two.
    studies : its ablations.
    functions : results under transfer functions that were never trained, a record and its rows for each seed.
    curve : accuracy after some minutes of training.
    instruction_sets : the scores of the same settings with the instructions of older processors, by name.
    outdated : True if all results come from earlier settings of the scene.
    earlier : True if any result is outdated, was measured by other code, or is known from an earlier page alone.
    """

    name: str
    title: str
    run: Path
    base: str = ""
    variations: int = 0
    report: Mapping[str, Any] | None = None
    upper_bounds: Sequence[Mapping[str, Any]] = ()
    repeats: Mapping[str, Any] | None = None
    studies: Sequence[StudyResults] = ()
    functions: Sequence[tuple[Record, Sequence[FunctionScores]]] = ()
    curve: Sequence[Point] = ()
    instruction_sets: Mapping[str, Sequence[Scores]] = field(default_factory=dict)
    seeds: Sequence[Scores] = ()
    outdated: bool = False
    earlier: bool = False


def read_scenes(scenes: Path, records: Path, runs: Path) -> list[SceneResults]:
    """All scenes of a folder of TOML files, by name; nothing is written.

    Raises ValueError naming a scene that can't be read.
    """
    return [read_scene(path, records, runs) for path in sorted(scenes.glob("*.toml"))]


def read_scene(path: Path, records: Path, runs: Path) -> SceneResults:
    """All results of one scene; raises ValueError for an unreadable one."""
    scene = Scene.load(path)
    settings, folder, run = TrainingSettings.from_table(scene.training), records / scene.name, scene.run_directory(runs)
    base = next((a for a in scene.appearances if settings.appearance in ("", a.name)), ImportedImages(""))
    learnt = [v for v in scene.variations if v.base in ("", base.name) and settings.visualization_steps]
    of_scene = scene.name, scene.title, run, APPEARANCES[appearance_to_json(base)["kind"]], len(learnt)
    shown = _shown(folder, settings)
    scores, report = load_scores(folder, settings=shown), load_report(folder, settings.seed)
    report = report if report is not None and report.agrees({"settings": shown}) else None
    studies = read_studies(folder, settings.to_json()) or read_studies(folder, shown)
    functions, curve = load(folder, shown), load_curve(folder)
    published = Record.load(folder / PUBLISHED, PUBLISHED_KIND, PUBLISHED_VERSION, {"scene": scene.name})
    if published is not None:
        measured = {study.kind for study in studies}
        old = [published_study(name, of) for name, of in published.values["studies"].items()]
        studies = [*studies, *(study for study in old if study.kind not in measured)]
    [(base_of_most, _)] = Counter(one.base for one in scores).most_common(1) or [("", 0)]
    mark = base_of_most if report is None else report.key["mark"]
    seeds = [one for one in scores if one.base == mark]
    upper_bounds = [
        entry for entry in load_upper_bounds(folder) if (entry["surrogate"] or {}).get("fingerprint") == mark
    ]
    outdated = shown != settings.to_json()
    made_by = {one.provenance.code for one in (*seeds, *curve)} | ({report.provenance.code} if report else set())
    return SceneResults(
        *of_scene,
        None if report is None else report.values,
        upper_bounds,
        summarize_repeats(seeds),
        studies,
        functions,
        curve,
        load_instruction_sets(folder, shown),
        seeds,
        outdated=outdated,
        earlier=outdated or not made_by <= {code()} or any(study.earlier for study in studies),
    )


def _shown(records: Path, settings: TrainingSettings) -> Mapping[str, Any]:
    """The settings whose figures are shown: the present ones, or those of the report if nothing is newer."""
    present, report = settings.to_json(), load_report(records, settings.seed)
    if report is None or report.agrees({"settings": present}) or load_scores(records, settings=present):
        return present
    earlier: Mapping[str, Any] = report.key["settings"]
    return earlier
