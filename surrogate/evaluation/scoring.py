"""Scores of predicted images, and means over many."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from itertools import repeat
from typing import Any

import numpy as np
from numpy.typing import NDArray

from surrogate.evaluation.cases import Case, CaseCells, each_cell
from surrogate.evaluation.metrics import MOST_DECIBELS, Score, TrueImage, decibels
from surrogate.evaluation.perceptual import Perceptual, PerceptualMetrics
from surrogate.evaluation.pictures import Images
from surrogate.evaluation.predictor import Draw, Predictor

MEAN_ERROR = "psnr_of_mean_error"
METRICS = ("psnr", MEAN_ERROR, "psnr_foreground", "ssim")  # of every image
PERCEPTUAL_METRICS = ("ms_ssim", "lpips", "flip")  # of some images, because they are slow

MOST_OF_MEAN = 120.0  # dB, at the rounding of float32

DEFINITIONS = {
    MEAN_ERROR: "10 log10(1 / E), E the mean over images of their mean squared errors: a few bad images weigh more than in a "
    f"mean of decibels; not cut at {MOST_DECIBELS:.0f} dB, which mixtures of stored pictures may reach"
}

Report = Callable[[str, int, int], None]  # stage, done, total
Progress = Callable[[int, int], None]  # done, total
Metrics = Callable[[TrueImage, NDArray[Any]], Score]


@dataclass(frozen=True, eq=False)
class Scored:
    """Scores of one predicted image; perceptual metrics only where requested."""

    target: Case
    score: Score
    perceptual: Perceptual | None = None

    def value(self, metric: str) -> float:
        """A metric of `score` or `perceptual`, by name; nan if missing."""
        value = getattr(self.perceptual if metric in PERCEPTUAL_METRICS else self.score, metric, None)
        return math.nan if value is None else float(value)


Cells = Mapping[str, Mapping[str, Sequence[Scored]]]  # by row and column of a table


def mean(scored: Iterable[Scored], metric: str) -> float | None:
    """Mean of a metric over images that have one; None without any."""
    if metric == MEAN_ERROR:
        errors = [s.score.squared_error for s in scored]
        return decibels(float(np.mean(errors)), MOST_OF_MEAN) if errors else None
    values = [value for value in (s.value(metric) for s in scored) if not math.isnan(value)]
    return float(np.mean(values)) if values else None


def one_in_ten(scored: Iterable[Scored], metric: str) -> float | None:
    """The metric that a tenth of the images which have one are below; None without any."""
    values = [value for s in scored if not math.isnan(value := s.value(metric))]
    return float(np.quantile(values, 0.1)) if values else None


def compare(
    case: Case,
    truth: TrueImage,
    picture: NDArray[Any],
    perceptual: PerceptualMetrics | None = None,
    metrics: Metrics = TrueImage.score,
) -> Scored:
    """Score a prediction of `case`, premultiplied RGBA (H, W, 4), uint8 or float32."""
    looked = None if perceptual is None else perceptual.score(truth.displayed, truth.composite(picture))
    return Scored(case, metrics(truth, picture), looked)


def score_cases(
    predictor: Predictor,
    images: Images,
    cases: Sequence[Case],
    *,
    perceptual: PerceptualMetrics | None = None,
    looked_at: Collection[Case] = (),
    progress: Progress = lambda *_: None,
    metrics: Metrics = TrueImage.score,
) -> list[dict[Case, Scored]]:
    """Score a predictor on images of a catalog: for each of its names the scores of all predictable cases, in order.

    Images in `looked_at` are also scored by `perceptual` metrics.
    """

    def scored(case: Case, draw: Draw) -> list[Scored]:
        truth = TrueImage(images.image(case.member, case.appearance, case.view), images.plan.background)
        looking = perceptual if case in looked_at else None
        return [compare(case, truth, picture, looking, metrics) for picture in draw(case)]

    by_case: dict[Case, list[Scored]] = {}
    waiting: Iterable[tuple[Case, list[Scored]]] = ()
    with ThreadPoolExecutor(2) as pool:
        for batch, draw in predictor.batches(cases):  # the next batch is prepared while this one is scored
            by_case |= waiting
            progress(len(by_case), len(cases))
            waiting = zip(batch, pool.map(scored, batch, repeat(draw)), strict=True)
        by_case |= waiting
    progress(len(by_case), len(cases))
    return [{case: by_case[case][k] for case in cases if case in by_case} for k, _ in enumerate(predictor.names)]


def by_cell(cells: CaseCells, scores: Mapping[Case, Scored]) -> Cells:
    """The scores by cell; `scores` has all their images."""
    return each_cell(cells, lambda group: [scores[case] for case in group])


def spread(count: int, most: int) -> list[int]:
    """At most `most` evenly spaced numbers below `count`."""
    if not count or not most:
        return []
    return sorted(set(np.linspace(0, count - 1, min(count, most)).round().astype(int).tolist()))
