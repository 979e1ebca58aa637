"""How good and how fast a surrogate is, on the images that it never learnt from, beside the trivial predictors."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from catalogs.catalog import Catalog, Member
from surrogate.evaluation.perceptual import PerceptualMetrics
from surrogate.evaluation.scoring import (
    METRICS,
    PARAMETERS,
    PERCEPTUAL_METRICS,
    VIEWS,
    Case,
    Report,
    Scored,
    Scorer,
    cases_of,
    compare,
    mean,
)
from surrogate.evaluation.timing import Milliseconds, measure
from surrogate.evaluation.trivial.interpolation import Predictor, fixed_predictors, tuned_predictors
from surrogate.evaluation.trivial.pictures import SAME_VIEW_DEGREES, predictions
from surrogate.evaluation.varied import VariedEvaluation, evaluate_variation
from surrogate.model import Surrogate
from surrogate.splatting.threads import one_torch_thread

__all__ = [
    "METRICS",
    "PARAMETERS",
    "PERCEPTUAL_METRICS",
    "VERSION",
    "VIEWS",
    "BaselineResult",
    "Evaluation",
    "evaluate",
    "images_of_cells",
    "mean",
    "targets_of",
]

VERSION = 3
MOST_IMAGES = 400  # per cell of seen parameters, drawn by seed; unseen parameters are evaluated whole
MOST_PERCEPTUAL = 40  # images of a cell: six cells at 110 ms an image (256 x 256) take 26 s
TUNING_IMAGES = 60  # validation images that choose a predictor's constants
TIMED = 30


@dataclass(frozen=True, eq=False)
class BaselineResult:
    """A trivial predictor's scores per row of views at unseen parameters, and on "validation" members."""

    name: str
    scores: Mapping[str, Sequence[Scored]]
    degrees: float  # between the wanted view and the borrowed one, at worst


@dataclass(frozen=True, eq=False)
class Evaluation:
    """Everything that a report says.

    Attributes
    ----------
    cells : scored images by row of views and column of parameters, as in `VIEWS` and `PARAMETERS`.
    validation : of validation members (else validation views): what choices are made on.
    baselines : trivial predictors at unseen parameters.
    milliseconds : of a "parameter_change" and a "view_change".
    variations : of the visualization parameters that the surrogate follows.
    unavailable : why a perceptual metric can't be had on this machine, by its name.
    """

    cells: Mapping[str, Mapping[str, Sequence[Scored]]]
    validation: Sequence[Scored]
    baselines: Sequence[BaselineResult]
    milliseconds: Mapping[str, Milliseconds]
    variations: Sequence[VariedEvaluation] = ()
    unavailable: Mapping[str, str] = field(default_factory=dict)


@one_torch_thread()
def evaluate(surrogate: Surrogate, catalog: Catalog, *, progress: Report = lambda *_: None) -> Evaluation:
    """Score `surrogate` on the images of `catalog` that it was made for."""
    appearance, perceptual = str(surrogate.training["appearance"]), PerceptualMetrics.load()
    chosen = images_of_cells(catalog, appearance)
    watched = targets_of(catalog, appearance, ("validation",), ("train", "validation"))
    watched = watched or targets_of(catalog, appearance, ("train",), ("validation",))
    judged = _some(watched, MOST_IMAGES)
    total = sum(len(chosen[v][p]) for v in VIEWS for p in PARAMETERS) + len(judged)
    scorer = Scorer(surrogate, catalog, lambda done: progress("surrogate", done, total))
    looked_at = {"seen_parameters": 0, "unseen_parameters": MOST_PERCEPTUAL}
    cells = {
        v: {p: scorer.score(chosen[v][p], perceptual, most_perceptual=looked_at[p]) for p in PARAMETERS} for v in VIEWS
    }
    validation = scorer.score(judged)
    rows = {v: chosen[v]["unseen_parameters"] for v in VIEWS}
    rows["validation"] = [target for target in judged if target.member.split == "validation"]
    return Evaluation(
        cells,
        validation,
        score_baselines(catalog, appearance, rows, watched, progress),
        measure_times(surrogate, catalog),
        [
            evaluate_variation(surrogate, v, catalog, perceptual, most_perceptual=MOST_PERCEPTUAL, progress=progress)
            for v in surrogate.visualizations
        ],
        perceptual.unavailable,
    )


def images_of_cells(catalog: Catalog, appearance: str) -> dict[str, dict[str, list[Case]]]:
    """The images that a surrogate is judged by, by row of `VIEWS` and column of `PARAMETERS`; no choice may be made on them."""
    most = {"seen_parameters": MOST_IMAGES}
    found = {
        views: {
            parameters: targets_of(catalog, appearance, PARAMETERS[parameters], VIEWS[views])
            for parameters in PARAMETERS
        }
        for views in VIEWS
    }
    return {v: {p: _some(cases, most.get(p, len(cases))) for p, cases in row.items()} for v, row in found.items()}


def targets_of(
    catalog: Catalog, appearance: str, member_splits: Sequence[str], view_splits: Sequence[str]
) -> list[Case]:
    """Images of one appearance whose member and view belong to the given splits."""
    return cases_of(catalog.members, {appearance: {}}, member_splits, view_splits)


def score_baselines(
    catalog: Catalog,
    appearance: str,
    rows: Mapping[str, Sequence[Case]],
    watched: Sequence[Case],
    progress: Report,
) -> list[BaselineResult]:
    """The trivial predictors on named `rows` of targets; their constants are chosen on `watched` validation images."""
    members = [m for m in catalog.members if m.split == "train" and appearance in m.appearances]
    targets = [target for group in rows.values() for target in group]
    if not members or not targets:
        return []
    predictors = [*fixed_predictors(len(catalog.plan.space)), *_tuned(catalog, appearance, members, watched)]
    results = _score_predictors(catalog, appearance, members, targets, predictors, progress)
    row_of = {id(target): row for row, group in rows.items() for target in group}
    return [
        BaselineResult(
            predictor.name, {row: [s for s in scored if row_of[id(s.target)] == row] for row in rows}, degrees
        )
        for predictor, (scored, degrees) in zip(predictors, results, strict=True)
    ]


def _tuned(catalog: Catalog, appearance: str, members: Sequence[Member], watched: Sequence[Case]) -> list[Predictor]:
    """The best of each tuned family on validation members; none where the catalog has no such member."""
    targets = _some([target for target in watched if target.member.split == "validation"], TUNING_IMAGES)
    if not targets:
        return []
    chosen = []
    for family in tuned_predictors().values():
        results = _score_predictors(catalog, appearance, members, targets, family, lambda *_: None)
        means = [mean(scored, "psnr") or -math.inf for scored, _ in results]
        chosen.append(family[int(np.argmax(means))])
    return chosen


def _score_predictors(
    catalog: Catalog,
    appearance: str,
    members: Sequence[Member],
    targets: Sequence[Case],
    predictors: Sequence[Predictor],
    progress: Report,
) -> list[tuple[list[Scored], float]]:
    known, wanted = (_normalized(catalog, group) for group in (members, [t.member for t in targets]))
    weights = [predictor.weights(known, wanted) for predictor in predictors]
    found: list[list[Scored]] = [[] for _ in predictors]
    worst, background, cases = 0.0, catalog.plan.background, {id(target): target for target in targets}
    for done, prediction in enumerate(predictions(catalog, appearance, members, targets, weights), start=1):
        truth = catalog.image(prediction.target.member, appearance, prediction.target.view)
        worst = max(worst, prediction.degrees)
        for scores, picture in zip(found, prediction.pictures, strict=True):
            scores.append(compare(cases[id(prediction.target)], truth, picture, background))
        progress("trivial predictors", done, len(targets))
    degrees = worst if worst > SAME_VIEW_DEGREES else 0.0
    return [(scores, degrees) for scores in found]


def measure_times(surrogate: Surrogate, catalog: Catalog) -> dict[str, Milliseconds]:
    """Of deforming at new parameters and of drawing a new view."""
    members = catalog.members
    cameras = [m.cameras[i * len(m.cameras) // TIMED] for i in range(TIMED) for m in [members[i % len(members)]]]
    change, draw = measure(surrogate, [members[i % len(members)].parameters for i in range(TIMED)], cameras)
    return {"parameter_change": change, "view_change": draw}


def _normalized(catalog: Catalog, members: Sequence[Member]) -> NDArray[np.float64]:
    space = catalog.plan.space
    return np.array([space.normalize([m.parameters[n] for n in space.names]) for m in members])  # [N, P]


def _some(targets: Sequence[Case], most: int) -> list[Case]:
    """At most `most` of the targets, drawn without replacement by a fixed seed, in order."""
    if len(targets) <= most:
        return list(targets)
    drawn = np.random.default_rng(0).choice(len(targets), size=most, replace=False)
    return [targets[i] for i in sorted(drawn)]
