"""Mixtures of stored images, scored on the test images of a comparison: a baseline without learning."""

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
    """Means by "rule: cell" and metric, for the cells that stored images can predict.

    At unseen parameters, rules mix all images of training members, including views that no method learns from. At seen
    parameters and unseen settings, they mix the same member under trained settings. Novel views can't be mixed.
    """
    cells = {}
    for cell, predictor in _predictors(task).items():
        cases = list(task.cells[cell])
        scores = score_cases(predictor, task.catalog, cases)
        for rule, of in zip(predictor.names, scores, strict=True):
            if len(of) == len(cases):
                cells[f"{rule}: {cell}"] = {**means(of.values(), metrics), "images": len(of)}
    return cells


def best_of(cells: Mapping[str, Mapping[str, Any]], cell: str) -> tuple[str, float] | None:
    """The best rule in a cell of `trivial_cells`, and its PSNR in dB; None without any."""
    named = {name.partition(": ")[0]: values["psnr"] for name, values in cells.items() if name.endswith(f": {cell}")}
    return max(named.items(), key=lambda pair: pair[1]) if named else None


def _predictors(task: ComparisonTask) -> dict[str, Predictor]:
    """The predictor of each cell that can be mixed."""
    if task.variation is None:
        return dict.fromkeys([cell for cell in task.cells if cell != "novel views"], _of_members(task))
    space, variation = task.source.space, task.variation
    seen, *both = task.cells
    of_member = Mixtures(
        task.catalog, SettingPictures(variation), setting_rules(len(variation.space), variation.plural)
    )
    predictors: dict[str, Predictor] = {seen: of_member}
    pictures = TrainedPictures.of(variation, space, task.catalog.members)
    if pictures is not None and len(space):
        joint = Mixtures(task.catalog, pictures, joint_rules(len(space), len(variation.space)))
        predictors |= dict.fromkeys(both, joint)
    return predictors


def _of_members(task: ComparisonTask) -> Predictor:
    appearance = task.source.appearance
    watched: list[Case] = base_validation(task.catalog, appearance)
    return member_mixtures(task.catalog, task.catalog.members, task.source.space, appearance, watched)[1]
