"""The table of how large and how fast."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from benchmarks.results.scenes import SceneResults
from surrogate.evaluation.tables import NOTHING, number, table

HEADER = (
    "scene",
    "Gaussians",
    "model (MB)",
    "making the data set (s)",
    "training (s)",
    "a picture (ms)",
    "a parameter change (ms)",
    "a change of the isovalue, transfer function or field (ms)",
    "seeds",
)


def cost_table(scenes: Sequence[SceneResults]) -> list[str]:
    """A row for each scene with a report; times are medians of single pictures, of the scene's own seed."""
    rows = [_row(scene.name, scene.report, scene.repeats) for scene in scenes if scene.report is not None]
    return [table(HEADER, rows)] if rows else ["No scene has a report yet."]


def _row(name: str, report: Mapping[str, Any], repeats: Mapping[str, Any] | None) -> tuple[str, ...]:
    changes = [f"{number(one['milliseconds']['visualization_change'])}" for one in report["variations"]]
    over = repeats or {}
    return (
        f"`{name}`",
        _spread(over.get("gaussians"), 0, report["gaussians"]),
        _spread(over.get("megabytes"), 2, report["model_megabytes"]),
        number(report["seconds"]["dataset"], 0),
        _spread(over.get("seconds"), 0, report["seconds"]["train"]),
        number(report["milliseconds"]["view_change"]),
        number(report["milliseconds"]["parameter_change"]),
        ", ".join(changes) or NOTHING,
        str(len(over["seeds"])) if over else "1",
    )


def _spread(spread: Mapping[str, float] | None, digits: int, alone: float) -> str:
    if spread is None:
        return f"{alone:,.{digits}f}"
    return f"{spread['mean']:,.{digits}f} ± {spread['deviation']:,.{digits}f}"
