"""Missing results of a scene, and the commands that make them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple

from research.benchmarks.results.parts import BASE, ReportPart, parts_of
from research.benchmarks.results.scenes import SceneResults
from research.benchmarks.results.studies import kinds_of
from surrogate.evaluation.cases import PARAMETERS
from surrogate.evaluation.tables import table


class Gap(NamedTuple):
    """A missing result of a scene, and the command that makes it."""

    scene: str
    what: str
    command: str


def gaps_of(scene: SceneResults) -> list[Gap]:
    """All missing results of a scene."""
    return [Gap(scene.name, what, command) for what, command in _missing(scene)]


def section_of(gaps: Sequence[Gap], *introduction: str) -> list[str]:
    """Blocks of a page about missing results, empty without any; `introduction` precedes the table."""
    rows = [(f"`{gap.scene}`", gap.what, f"`{gap.command}`") for gap in gaps]
    return ["## What is missing", *introduction, table(("scene", "what", "made by"), rows)] if gaps else []


def _missing(scene: SceneResults) -> Iterator[tuple[str, str]]:
    if scene.report is None and scene.repeats is None and not scene.studies:
        yield "everything", f"make results SCENES={scene.name}"
        return
    if scene.outdated:
        yield "everything of its present settings", f"make results SCENES={scene.name}"
    if scene.report is None:
        yield "the report", f"make results SCENES={scene.name}"
    without = [part.what for part in parts_of([scene]) if part.upper_bound is None and _can_have_upper_bound(part)]
    if without:
        yield (
            f"the upper bound of {', '.join(without)}",
            f"python -m research.studies ceiling scenes/{scene.name}.toml --records research/records",
        )
    if scene.repeats is None:
        yield "other seeds", f"python -m research.studies repeat scenes/{scene.name}.toml"
    there = {study.kind for study in scene.studies}
    for kind in kinds_of(scene.variations):
        if kind not in there:
            yield f"the ablation of {kind.title}", kind.command(scene.name)


def _can_have_upper_bound(part: ReportPart) -> bool:
    """True if a member has both training and test views, under a test setting where the part is about one."""
    if part.kind == BASE:
        return any(part.images("unseen_views", column) for column in PARAMETERS)
    return part.images("unseen_settings", "unseen_parameters") > 0
