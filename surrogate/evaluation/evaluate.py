"""How good and how fast a surrogate is, on the images that it never learnt from, beside the trivial predictors."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import Any

import numpy as np

from catalogs.catalog import Catalog
from catalogs.variations import Variation
from surrogate.deformation.visualization import Visualization
from surrogate.evaluation.cases import (
    VALIDATION,
    VIEWS,
    Case,
    CaseCells,
    all_cases,
    base_cells,
    base_validation,
    drawn,
    variation_cells,
    variation_validation,
)
from surrogate.evaluation.perceptual import PerceptualMetrics
from surrogate.evaluation.predictor import Predictor, SurrogatePredictor
from surrogate.evaluation.scoring import Cells, Progress, Report, Scored, by_cell, mean, score_cases, spread
from surrogate.evaluation.timing import Milliseconds, measure
from surrogate.evaluation.trivial.interpolation import fixed_rules, setting_rules, tuned_rules
from surrogate.evaluation.trivial.mixtures import MemberPictures, Mixtures
from surrogate.evaluation.trivial.settings import SettingPictures
from surrogate.model import Surrogate
from surrogate.splatting.threads import one_torch_thread

VERSION = 3
MOST_PERCEPTUAL = 40  # images of a cell: six cells at 110 ms an image (256 x 256) take 26 s
TUNING_IMAGES = 60  # validation images that choose a rule's constants
AT_NEAREST = "the surrogate at the nearest trained setting"

DEFINITIONS = {"covered": "share of an image's pixels that are foreground in the truth, as above; mean over images"}


@dataclass(frozen=True, eq=False)
class Baseline:
    """What the surrogate is compared with.

    Attributes
    ----------
    scores : of the images that it can predict: at unseen parameters by row of `VIEWS`, or under unseen settings by column of
        `PARAMETERS`; and "validation".
    degrees : between a wanted view and the stored one that stands in for it, at worst.
    shown : per column, the fewest and the most trained settings that a predicted member shows.
    """

    name: str
    scores: Mapping[str, Sequence[Scored]] = field(repr=False)
    degrees: float = 0.0
    shown: Mapping[str, tuple[int, int]] = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class VariedEvaluation:
    """How well a surrogate follows one variation.

    Attributes
    ----------
    deformation : the kind of F_vis.
    cells : scored images, of unseen views, by row of `SETTINGS` and column of `PARAMETERS`.
    validation : of validation members under validation settings, at any view but those that test.
    milliseconds : of a "visualization_change" and of a "view_change" after it.
    """

    variation: Variation
    deformation: str
    cells: Cells = field(repr=False)
    validation: Sequence[Scored] = field(repr=False)
    baselines: Sequence[Baseline] = field(repr=False)
    milliseconds: Mapping[str, Milliseconds]

    @property
    def scored(self) -> list[Scored]:
        """All images, of all cells and for validation."""
        return [*(s for row in self.cells.values() for group in row.values() for s in group), *self.validation]


@dataclass(frozen=True, eq=False)
class Evaluation:
    """Everything that a report says.

    Attributes
    ----------
    cells : scored images of the base appearance, by row of `VIEWS` and column of `PARAMETERS`.
    validation : of validation members (else validation views): what choices are made on.
    baselines : trivial predictors at unseen parameters.
    milliseconds : of a "parameter_change" and a "view_change".
    variations : of the visualization parameters that the surrogate follows.
    unavailable : why a perceptual metric can't be had on this machine, by its name.
    """

    cells: Cells = field(repr=False)
    validation: Sequence[Scored] = field(repr=False)
    baselines: Sequence[Baseline] = field(repr=False)
    milliseconds: Mapping[str, Milliseconds]
    variations: Sequence[VariedEvaluation] = ()
    unavailable: Mapping[str, str] = field(default_factory=dict)


@one_torch_thread()
def evaluate(surrogate: Surrogate, catalog: Catalog, *, progress: Report = lambda *_: None) -> Evaluation:
    """Score `surrogate` on the images of `catalog` that it was made for."""
    appearance, perceptual = str(surrogate.training["appearance"]), PerceptualMetrics.load()
    cells, watched = base_cells(catalog, appearance), base_validation(catalog, appearance)
    judged, few = drawn(watched), [row["unseen_parameters"] for row in cells.values()]
    told = partial(progress, "surrogate")
    scored = _score_cells(surrogate, catalog, cells, judged, perceptual, few, told)
    groups = {row: cells[row]["unseen_parameters"] for row in VIEWS}
    groups[VALIDATION] = [case for case in judged if case.member.split == VALIDATION]
    change, view = measure(surrogate, catalog.members)
    return Evaluation(
        *scored,
        _member_baselines(catalog, appearance, groups, watched, partial(progress, "trivial predictors")),
        {"parameter_change": change, "view_change": view},
        [_evaluate_variation(surrogate, v, catalog, perceptual, progress) for v in surrogate.visualizations],
        perceptual.unavailable,
    )


def _evaluate_variation(
    surrogate: Surrogate,
    visualization: Visualization,
    catalog: Catalog,
    perceptual: PerceptualMetrics,
    progress: Report,
) -> VariedEvaluation:
    variation = visualization.variation
    cells, judged = variation_cells(catalog, variation), variation_validation(catalog, variation)
    few, told = [group for row in cells.values() for group in row.values()], f"surrogate, {variation.name}"
    scored = _score_cells(surrogate, catalog, cells, judged, perceptual, few, partial(progress, told))
    groups = {**cells["unseen_settings"], VALIDATION: judged}
    told = "trivial predictors of settings"
    baselines = _setting_baselines(surrogate, catalog, variation, groups, partial(progress, told))
    change, view = measure(surrogate, catalog.members, [variation.asked(setting) for setting in variation.settings])
    milliseconds = {"visualization_change": change, "view_change": view}
    return VariedEvaluation(variation, visualization.deformation.kind, *scored, baselines, milliseconds)


def _score_cells(
    surrogate: Surrogate,
    catalog: Catalog,
    cells: CaseCells,
    validation: Sequence[Case],
    perceptual: PerceptualMetrics,
    looked_into: Sequence[Sequence[Case]],
    progress: Progress,
) -> tuple[Cells, list[Scored]]:
    """Test images by cell, and validation images; a few of each group that is `looked_into` by perceptual metrics too."""
    predictor, cases = SurrogatePredictor(surrogate.at, catalog.plan.background), [*all_cases(cells), *validation]
    few = {group[i] for group in looked_into for i in spread(len(group), MOST_PERCEPTUAL)}
    [found] = score_cases(predictor, catalog, cases, perceptual=perceptual, looked_at=few, progress=progress)
    return by_cell(cells, found), [found[case] for case in validation]


def _baselines(
    predictor: Predictor, catalog: Catalog, groups: Mapping[str, Sequence[Case]], progress: Progress, **known: Any
) -> list[Baseline]:
    """What a predictor makes of named groups of images, where it can; `known` is said of all its names."""
    cases = [case for group in groups.values() for case in group]
    return [
        Baseline(name, {g: [found[case] for case in group if case in found] for g, group in groups.items()}, **known)
        for name, found in zip(predictor.names, score_cases(predictor, catalog, cases, progress=progress), strict=True)
    ]


def _member_baselines(
    catalog: Catalog,
    appearance: str,
    groups: Mapping[str, Sequence[Case]],
    watched: Sequence[Case],
    progress: Progress,
) -> list[Baseline]:
    """Mixtures of training members; their constants are chosen on `watched` validation images."""
    members = [m for m in catalog.members if m.split == "train" and appearance in m.appearances]
    cases = [case for group in groups.values() for case in group]
    if not members or not cases:
        return []
    space = catalog.plan.space
    pictures = MemberPictures(space, appearance, members)
    tuning = drawn([case for case in watched if case.member.split == VALIDATION], TUNING_IMAGES)
    rules = fixed_rules(len(space))
    for family in tuned_rules() if tuning else ():
        means = [
            mean(found.values(), "psnr") for found in score_cases(Mixtures(catalog, pictures, family), catalog, tuning)
        ]
        rules.append(family[int(np.argmax([-math.inf if value is None else value for value in means]))])
    degrees = pictures.borrowed_degrees(cases)
    return _baselines(Mixtures(catalog, pictures, rules), catalog, groups, progress, degrees=degrees)


def _setting_baselines(
    surrogate: Surrogate,
    catalog: Catalog,
    variation: Variation,
    groups: Mapping[str, Sequence[Case]],
    progress: Progress,
) -> list[Baseline]:
    """What stored pictures of trained settings, and the surrogate's own, make of unseen ones; none of fields, all trained."""
    if not variation.continuous:
        return []
    pictures = SettingPictures(variation)
    counts = {name: [len(pictures.shown(case.member)) for case in group] for name, group in groups.items()}
    shown = {name: (min(found), max(found)) for name, of in counts.items() if (found := list(filter(None, of)))}
    mixtures = Mixtures(catalog, pictures, setting_rules(len(variation.space), variation.plural))

    def at_nearest(case: Case) -> dict[str, float | str]:
        nearest = variation.setting(pictures.trained.nearest(pictures.place(case)))
        return {**case.member.parameters, **({} if nearest is None else variation.asked(nearest))}

    unmoved = SurrogatePredictor(surrogate.at, catalog.plan.background, at_nearest, (AT_NEAREST,))
    unseen = {name: groups[name] for name in ["unseen_parameters"]}
    return [
        *_baselines(mixtures, catalog, groups, progress, shown=shown),
        *_baselines(unmoved, catalog, unseen, progress),
    ]
