"""A compared method as a predictor of test images."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from research.studies.baselines.method import Fit
from research.studies.comparison.task import ComparisonTask
from surrogate.evaluation.cases import Case
from surrogate.evaluation.predictor import Draw
from surrogate.evaluation.timing import Milliseconds

LONGEST, FEWEST, MOST = 10.0, 2, 30  # seconds and repetitions of a measurement


@dataclass(frozen=True, eq=False)
class FitPredictor:
    """A trained method as a `surrogate.evaluation.predictor.Predictor`; one thread renders."""

    fit: Fit
    task: ComparisonTask
    names: Sequence[str] = ("the method",)

    def batches(self, cases: Sequence[Case]) -> Iterator[tuple[Sequence[Case], Draw]]:
        """See `Predictor`; the cases of a batch have the same parameters."""
        batches: dict[tuple[str, str], list[Case]] = {}
        for case in cases:
            batches.setdefault((case.member.name, case.appearance), []).append(case)
        for batch in batches.values():
            render = self.at(batch[0])
            drawn = {case: [render(case)] for case in batch}
            yield batch, drawn.__getitem__

    def at(self, case: Case) -> Callable[[Case], NDArray[np.float32]]:
        """A function that renders the views of cases at the parameters of `case`."""
        render = self.fit.at(self.task.parameters(case))
        return lambda other: render(self.task.camera(other))


def measure(at: Callable[[Case], Callable[[Case], object]], cases: Sequence[Case]) -> tuple[Milliseconds, Milliseconds]:
    """Times of an image at new parameters, and of another view at the same ones, over members and settings in turn.

    `at` moves to a case's parameters and returns a function that renders the views of cases.
    """
    each = list({(case.member.name, case.appearance): case for case in cases}.values())
    changes, views, begun = list[float](), list[float](), time.perf_counter()
    while len(changes) < MOST and (len(changes) < FEWEST or time.perf_counter() - begun < LONGEST):
        case, other = each[len(changes) % len(each)], cases[len(changes) % len(cases)]
        started = time.perf_counter()
        render = at(case)
        render(case)
        between = time.perf_counter()
        render(other)
        views.append(time.perf_counter() - between)
        changes.append(between - started)
    return Milliseconds.of(changes), Milliseconds.of(views)
