"""Sources of the numbers: command, commit, machine and seed, scene by scene."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict
from typing import Any

from research.benchmarks.results.scenes import SceneResults
from research.benchmarks.results.studies import StudyResults
from surrogate.evaluation.tables import table
from surrogate.provenance import in_words


def report_sources(scenes: Iterable[SceneResults]) -> str:
    """Sources of reports, upper bounds and seeds: a table with a row for each command; "" without any."""
    rows = [(f"`{scene.name}`", f"`{command}`", made) for scene in scenes for command, made in _of_scene(scene)]
    return table(("scene", "command", "made at"), rows) if rows else ""


def study_sources(scene: str, study: StudyResults) -> str:
    """Sources of the table of an ablation."""
    if study.published:
        return str(study.published["sources"])
    results = study.results
    seeds = sorted({int(result.settings["seed"]) for result in results})
    command = f"{study.kind.command(scene)} --seconds {study.budget:g} --seeds {len(seeds)}"
    made = made_from([asdict(result.provenance) for result in results], seeds)
    return f"<sub>`{command}`: {made}.</sub>"


def _of_scene(scene: SceneResults) -> list[tuple[str, str]]:
    """The commands that made a scene's numbers, each with its `made_from`."""
    if scene.report is None:
        return []
    sources = [(f"surrogate evaluate scenes/{scene.name}.toml", made_from([scene.report], [scene.report["seed"]]))]
    if scene.repeats is not None:
        seeds, machines, commits = (scene.repeats[name] for name in ("seeds", "machines", "commits"))
        made = made_from([{"machine": machine, "commit": commit} for machine in machines for commit in commits], seeds)
        sources.append((f"python -m research.studies repeat scenes/{scene.name}.toml --seeds {len(seeds)}", made))
    if scene.upper_bounds:
        seeds = sorted({int(entry["seed"]) for entry in scene.upper_bounds})
        sources.append(
            (f"python -m research.studies ceiling scenes/{scene.name}.toml", made_from(scene.upper_bounds, seeds))
        )
    return sources


def made_from(records: Sequence[Mapping[str, Any]], seeds: Sequence[int]) -> str:
    """Commits, machines and seeds of records, each of which has a "commit" and a "machine"."""
    commits = ", ".join(dict.fromkeys(f"`{record['commit']}`" for record in records))
    machines = "; ".join(dict.fromkeys(in_words(record["machine"] or {}) for record in records))
    return f"commit {commits}, {machines}, seed{'s' if len(seeds) > 1 else ''} {', '.join(map(str, seeds))}"
