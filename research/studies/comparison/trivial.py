"""Mixtures of stored pictures on the images that methods are compared by: what needs no learning at all."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from research.studies.comparison.task import ComparisonTask
from surrogate.evaluation.cases import Case, base_validation
from surrogate.evaluation.predictor import Predictor
from surrogate.evaluation.scoring import score_cases
from surrogate.evaluation.tables import means
from surrogate.evaluation.trivial.interpolation import joint_rules, setting_rules
from surrogate.evaluation.trivial.members import member_mixtures
from surrogate.evaluation.trivial.mixtures import Mixtures
from surrogate.evaluation.trivial.settings import SettingPictures, TrainedPictures


def trivial_cells(task: ComparisonTask, metrics: Sequence[str]) -> dict[str, dict[str, Any]]:
    """Means by "rule: cell" and metric, of the cells that stored pictures can predict.

    Cells at unseen parameters know all pictures of training members, also views that nobody learns from; the cell of seen
    parameters under unseen settings knows the very members under trained settings.  Novel views can't be mixed from anything.
    """
    found = {}
    for cell, predictor in _predictors(task).items():
        cases = list(task.cells[cell])
        scores = score_cases(predictor, task.catalog, cases)
        for rule, of in zip(predictor.names, scores, strict=True):
            if len(of) == len(cases):
                found[f"{rule}: {cell}"] = {**means(of.values(), metrics), "images": len(of)}
    return found


def best_of(cells: Mapping[str, Mapping[str, Any]], cell: str) -> tuple[str, float] | None:
    """The best rule in a cell of `trivial_cells`, and its PSNR in dB; None without any."""
    named = {name.partition(": ")[0]: found["psnr"] for name, found in cells.items() if name.endswith(f": {cell}")}
    return max(named.items(), key=lambda pair: pair[1]) if named else None


def _predictors(task: ComparisonTask) -> dict[str, Predictor]:
    """What predicts each cell that can be mixed."""
    if task.variation is None:
        return dict.fromkeys([cell for cell in task.cells if cell != "novel views"], _of_members(task))
    space, variation = task.source.space, task.variation
    seen, *both = task.cells
    of_member = Mixtures(
        task.catalog, SettingPictures(variation), setting_rules(len(variation.space), variation.plural)
    )
    found: dict[str, Predictor] = {seen: of_member}
    pictures = TrainedPictures.of(variation, space, task.catalog.members)
    if pictures is not None and len(space):
        joint = Mixtures(task.catalog, pictures, joint_rules(len(space), len(variation.space)))
        found |= dict.fromkeys(both, joint)
    return found


def _of_members(task: ComparisonTask) -> Predictor:
    appearance = task.source.appearance
    watched: list[Case] = base_validation(task.catalog, appearance)
    return member_mixtures(task.catalog, task.source.space, appearance, watched)[1]
