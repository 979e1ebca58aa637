"""Images to be predicted, how well each was, and the means over many: what evaluations are made of."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from catalogs.catalog import Catalog, Member
from surrogate.evaluation.metrics import MOST_DECIBELS, WHITE, Score, composite, decibels, foreground, score
from surrogate.evaluation.perceptual import Perceptual, PerceptualMetrics
from surrogate.evaluation.trivial.pictures import Target
from surrogate.model import DeformedGaussians, Surrogate

MEAN_ERROR = "psnr_of_mean_error"
METRICS = ("psnr", MEAN_ERROR, "psnr_foreground", "ssim")  # of every image
PERCEPTUAL_METRICS = ("ms_ssim", "lpips", "flip")  # of some, because they take long
VIEWS = {"seen_views": ("train",), "unseen_views": ("test",)}
PARAMETERS = {"seen_parameters": ("train",), "unseen_parameters": ("test",)}

DEFINITIONS = {
    MEAN_ERROR: "10 log10(1 / E), E the mean over images of their mean squared errors: a few bad images weigh more than in a "
    "mean of decibels"
}

Report = Callable[[str, int, int], None]


@dataclass(frozen=True, eq=False)
class Case(Target):
    """An image of the data set that is to be predicted.

    Attributes
    ----------
    appearance : which one of the member's.
    varied : what a surrogate is asked for by name beside the simulation's parameters; empty for the base appearance.
    """

    appearance: str
    varied: Mapping[str, float | str] = field(default_factory=dict)

    @property
    def parameters(self) -> dict[str, float | str]:
        """All that `Surrogate.at` must be told."""
        return {**self.member.parameters, **self.varied}


@dataclass(frozen=True, eq=False)
class Scored:
    """One image of the data set and how well something predicted it.

    Attributes
    ----------
    squared_error : mean over pixels and channels, as in `score.psnr` but not cut.
    covered : share of the truth's pixels that are foreground.
    perceptual : None where they were not asked for.
    """

    target: Case
    score: Score
    squared_error: float
    covered: float
    perceptual: Perceptual | None = None

    def value(self, metric: str) -> float:
        """One of `METRICS` (but `MEAN_ERROR`) or `PERCEPTUAL_METRICS`, or "covered"; nan without."""
        if metric == "covered":
            return self.covered
        found = getattr(self.perceptual if metric in PERCEPTUAL_METRICS else self.score, metric, None)
        return math.nan if found is None else float(found)


def mean(scored: Iterable[Scored], metric: str) -> float | None:
    """Mean of a metric over images that have one; None without any."""
    if metric == MEAN_ERROR:
        errors = [s.squared_error for s in scored]
        return decibels(float(np.mean(errors))) if errors else None
    values = [value for value in (s.value(metric) for s in scored) if not math.isnan(value)]
    return float(np.mean(values)) if values else None


def cases_of(
    members: Sequence[Member],
    appearances: Mapping[str, Mapping[str, float | str]],
    member_splits: Sequence[str],
    view_splits: Sequence[str],
) -> list[Case]:
    """Images of some appearances, given with their visualization parameters, whose member and view belong to the given splits."""
    return [
        Case(member, view, appearance, varied)
        for member in members
        if member.split in member_splits
        for appearance, varied in appearances.items()
        if appearance in member.appearances
        for view, split in enumerate(member.view_splits)
        if split in view_splits
    ]


def compare(
    case: Case,
    truth: NDArray[Any],
    picture: NDArray[Any],
    background: Sequence[float] | None,
    perceptual: PerceptualMetrics | None = None,
) -> Scored:
    """Score a prediction of `case`; both pictures are premultiplied RGBA (H, W, 4), uint8 or float32."""
    found = score(truth, picture, background)
    exact = found.psnr < MOST_DECIBELS  # then it says what the error was, and nothing is computed twice
    pair = [] if exact and perceptual is None else [composite(p, background or WHITE) for p in (truth, picture)]
    return Scored(
        target=case,
        score=found,
        squared_error=10.0 ** (-found.psnr / 10.0) if exact else _squared_error(*pair),
        covered=float(foreground(truth, background).mean()),
        perceptual=None if perceptual is None else perceptual.score(*pair),
    )


def _squared_error(first: NDArray[np.float32], second: NDArray[np.float32]) -> float:
    difference = first.astype(np.float64) - second
    return float(np.mean(difference * difference))


class Scorer:
    """Draws and scores images, deforming once for all views of the same parameters."""

    def __init__(
        self, surrogate: Surrogate, catalog: Catalog, progress: Callable[[int], None] = lambda _: None
    ) -> None:
        self._surrogate, self._catalog = surrogate, catalog
        self._progress, self._done = progress, 0

    def score(
        self,
        cases: Sequence[Case],
        perceptual: PerceptualMetrics | None = None,
        *,
        most_perceptual: int = 0,
        shown_at: Callable[[Case], dict[str, float | str]] = lambda case: case.parameters,
    ) -> list[Scored]:
        """Scores of `cases` in order, at most `most_perceptual` of them, evenly spread, by perceptual metrics too.

        `shown_at` says at which parameters the surrogate is to predict an image: at its own.
        """
        looked_at = set(spread(len(cases), most_perceptual)) if perceptual is not None else set()
        groups: dict[tuple[tuple[str, float | str], ...], list[int]] = {}
        for i, case in enumerate(cases):
            groups.setdefault(tuple(shown_at(case).items()), []).append(i)
        found: dict[int, Scored] = {}
        for parameters, group in groups.items():
            deformed = self._surrogate.at(**dict(parameters))
            with ThreadPoolExecutor(2) as pool:
                scored = pool.map(
                    lambda i, d=deformed: self._score_one(d, cases[i], perceptual if i in looked_at else None), group
                )
                found |= zip(group, scored, strict=True)
            self._done += len(group)
            self._progress(self._done)
        return [found[i] for i in range(len(cases))]

    def _score_one(self, deformed: DeformedGaussians, case: Case, perceptual: PerceptualMetrics | None) -> Scored:
        background = self._catalog.plan.background
        truth = self._catalog.image(case.member, case.appearance, case.view)
        return compare(case, truth, deformed.render(case.camera, background=background), background, perceptual)


def spread(count: int, most: int) -> list[int]:
    """At most `most` of the numbers below `count`, at even distances."""
    if not count or not most:
        return []
    return sorted(set(np.linspace(0, count - 1, min(count, most)).round().astype(int).tolist()))
