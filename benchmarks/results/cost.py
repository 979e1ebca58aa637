"""The table of how large and how fast."""

from __future__ import annotations

from collections.abc import Sequence

from benchmarks.results.scenes import SceneResults
from surrogate.evaluation.tables import NOTHING, number, plain_spread, table_of

COLUMNS = (
    ("scene", lambda scene: f"`{scene.name}`"),
    ("Gaussians", lambda scene: _size(scene, "gaussians", scene.report["gaussians"], 0)),
    ("model (MB)", lambda scene: _size(scene, "megabytes", scene.report["model_megabytes"], 2)),
    ("making the data set (s)", lambda scene: number(scene.report["seconds"]["dataset"], 0)),
    ("training (s)", lambda scene: _size(scene, "seconds", scene.report["seconds"]["train"], 0)),
    ("a picture (ms)", lambda scene: number(scene.report["milliseconds"]["view_change"])),
    ("a parameter change (ms)", lambda scene: number(scene.report["milliseconds"]["parameter_change"])),
    (
        "a change of the isovalue, transfer function or field (ms)",
        lambda scene: (
            ", ".join(number(v["milliseconds"]["visualization_change"]) for v in scene.report["variations"]) or NOTHING
        ),
    ),
    ("seeds", lambda scene: str(len(scene.repeats["seeds"])) if scene.repeats else "1"),
)


def cost_table(scenes: Sequence[SceneResults]) -> str:
    """A row for each scene with a report; times are medians of single pictures, of the scene's own seed."""
    known = [scene for scene in scenes if scene.report is not None]
    return table_of(known, *COLUMNS) if known else "No scene has a report yet."


def _size(scene: SceneResults, name: str, alone: float, digits: int) -> str:
    """Over seeds where there are several, else that of the report."""
    return plain_spread(scene.repeats[name], digits) if scene.repeats else f"{alone:,.{digits}f}"
