"""How good and how fast a surrogate is, on the images that it never learnt from, beside the trivial predictors."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from catalogs.catalog import Catalog, Member
from surrogate.baselines.interpolation import Predictor, fixed_predictors, tuned_predictors
from surrogate.baselines.pictures import SAME_VIEW_DEGREES, Target, predictions
from surrogate.metrics import Score, score
from surrogate.model import DeformedGaussians, Surrogate
from surrogate.threads import one_torch_thread

VERSION = 2
METRICS = ("psnr", "ssim", "psnr_foreground")
VIEWS = {"seen_views": ("train",), "unseen_views": ("test",)}
PARAMETERS = {"seen_parameters": ("train",), "unseen_parameters": ("test",)}
MOST_IMAGES = 400  # per cell of seen parameters, drawn by seed; unseen parameters are evaluated whole
TUNING_IMAGES = 60  # validation images that choose a predictor's constants
TIMED = 30

Report = Callable[[str, int, int], None]


@dataclass(frozen=True, eq=False)
class Scored:
    """One image of the data set and how well something predicted it."""

    target: Target
    score: Score


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
    milliseconds : median per "parameter_change" and "view_change".
    spread : lowest and highest of the same.
    """

    cells: Mapping[str, Mapping[str, Sequence[Scored]]]
    validation: Sequence[Scored]
    baselines: Sequence[BaselineResult]
    milliseconds: Mapping[str, float]
    spread: Mapping[str, tuple[float, float]]


@one_torch_thread()
def evaluate(surrogate: Surrogate, catalog: Catalog, *, progress: Report = lambda *_: None) -> Evaluation:
    """Score `surrogate` on the images of `catalog` that it was made for."""
    appearance = str(surrogate.training["appearance"])
    chosen = {
        views: {parameters: targets_of(catalog, PARAMETERS[parameters], VIEWS[views]) for parameters in PARAMETERS}
        for views in VIEWS
    }
    for views in VIEWS:
        chosen[views]["seen_parameters"] = _some(chosen[views]["seen_parameters"], MOST_IMAGES)
    watched = targets_of(catalog, ("validation",), ("train", "validation")) or targets_of(
        catalog, ("train",), ("validation",)
    )
    groups = [chosen[v][p] for v in VIEWS for p in PARAMETERS] + [_some(watched, MOST_IMAGES)]
    scorer = _Scorer(surrogate, catalog, appearance, sum(map(len, groups)), progress)
    scored = [scorer.score(group) for group in groups]
    cells = {v: dict(zip(PARAMETERS, scored[2 * i : 2 * i + 2], strict=True)) for i, v in enumerate(VIEWS)}
    rows = {v: chosen[v]["unseen_parameters"] for v in VIEWS}
    rows["validation"] = [target for target in groups[-1] if target.member.split == "validation"]
    baselines = score_baselines(catalog, appearance, rows, watched, progress)
    milliseconds, spread = measure_times(surrogate, catalog)
    return Evaluation(cells, scored[-1], baselines, milliseconds, spread)


def targets_of(catalog: Catalog, member_splits: Sequence[str], view_splits: Sequence[str]) -> list[Target]:
    """Images whose member and view belong to the given splits."""
    return [
        Target(member, view)
        for member in catalog.members
        if member.split in member_splits
        for view, split in enumerate(member.view_splits)
        if split in view_splits
    ]


def mean(scored: Iterable[Scored], metric: str) -> float | None:
    """Mean of a metric over images that have one; None without any."""
    values = [getattr(s.score, metric) for s in scored]
    values = [value for value in values if not math.isnan(value)]
    return float(np.mean(values)) if values else None


class _Scorer:
    """Renders and scores targets, member by member, so that the deformation runs once for each."""

    def __init__(self, surrogate: Surrogate, catalog: Catalog, appearance: str, total: int, progress: Report) -> None:
        self._surrogate, self._catalog, self._appearance = surrogate, catalog, appearance
        self._total, self._done, self._progress = total, 0, progress

    def score(self, targets: Sequence[Target]) -> list[Scored]:
        found: list[Scored] = []
        by_member: dict[str, list[Target]] = {}
        for target in targets:
            by_member.setdefault(target.member.name, []).append(target)
        for group in by_member.values():
            deformed = self._surrogate.at(**group[0].member.parameters)
            with ThreadPoolExecutor(2) as pool:
                found += pool.map(lambda target, d=deformed: self._score_one(d, target), group)
            self._done += len(group)
            self._progress("surrogate", self._done, self._total)
        return found

    def _score_one(self, deformed: DeformedGaussians, target: Target) -> Scored:
        truth = self._catalog.image(target.member, self._appearance, target.view)
        background = self._catalog.plan.background
        return Scored(target, score(truth, deformed.render(target.camera, background=background), background))


def score_baselines(
    catalog: Catalog,
    appearance: str,
    rows: Mapping[str, Sequence[Target]],
    watched: Sequence[Target],
    progress: Report,
) -> list[BaselineResult]:
    """The trivial predictors on named `rows` of targets; their constants are chosen on `watched` validation images."""
    members = [m for m in catalog.members if m.split == "train"]
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


def _tuned(catalog: Catalog, appearance: str, members: Sequence[Member], watched: Sequence[Target]) -> list[Predictor]:
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
    targets: Sequence[Target],
    predictors: Sequence[Predictor],
    progress: Report,
) -> list[tuple[list[Scored], float]]:
    known, wanted = (_normalized(catalog, group) for group in (members, [t.member for t in targets]))
    weights = [predictor.weights(known, wanted) for predictor in predictors]
    found: list[list[Scored]] = [[] for _ in predictors]
    worst, background = 0.0, catalog.plan.background
    for done, prediction in enumerate(predictions(catalog, appearance, members, targets, weights), start=1):
        truth = catalog.image(prediction.target.member, appearance, prediction.target.view)
        worst = max(worst, prediction.degrees)
        for scores, picture in zip(found, prediction.pictures, strict=True):
            scores.append(Scored(prediction.target, score(truth, picture, background)))
        progress("trivial predictors", done, len(targets))
    degrees = worst if worst > SAME_VIEW_DEGREES else 0.0
    return [(scores, degrees) for scores in found]


def measure_times(surrogate: Surrogate, catalog: Catalog) -> tuple[dict[str, float], dict[str, tuple[float, float]]]:
    """Median milliseconds, and lowest and highest, of deforming at new parameters and of drawing a new view."""
    members = catalog.members
    cameras = [m.cameras[i * len(m.cameras) // TIMED] for i in range(TIMED) for m in [members[i % len(members)]]]
    rows = [dict(members[i % len(members)].parameters) for i in range(TIMED)]
    changes, views = [], []
    for parameters, camera in zip(rows, cameras, strict=True):
        started = time.perf_counter()
        deformed = surrogate.at(**parameters)
        between = time.perf_counter()
        deformed.render(camera)
        views.append(1e3 * (time.perf_counter() - between))
        changes.append(1e3 * (between - started))
    measured: dict[str, Any] = {"parameter_change": changes, "view_change": views}
    return (
        {name: float(np.median(values)) for name, values in measured.items()},
        {name: (float(min(values)), float(max(values))) for name, values in measured.items()},
    )


def _normalized(catalog: Catalog, members: Sequence[Member]) -> NDArray[np.float64]:
    space = catalog.plan.space
    return np.array([space.normalize([m.parameters[n] for n in space.names]) for m in members])  # [N, P]


def _some(targets: Sequence[Target], most: int) -> list[Target]:
    """At most `most` of the targets, drawn without replacement by a fixed seed, in order."""
    if len(targets) <= most:
        return list(targets)
    drawn = np.random.default_rng(0).choice(len(targets), size=most, replace=False)
    return [targets[i] for i in sorted(drawn)]
