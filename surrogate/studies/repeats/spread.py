"""Means and standard deviations over seeds."""

from __future__ import annotations

import statistics
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

from surrogate.evaluation.scoring import METRICS
from surrogate.studies.repeats.records import Scores


class Spread(NamedTuple):
    """Of some numbers: their mean, and their sample standard deviation (n - 1 in the denominator), None for fewer than two."""

    mean: float
    deviation: float | None

    @classmethod
    def of(cls, values: Sequence[float]) -> Spread:
        """The spread of at least one number."""
        return cls(statistics.fmean(values), statistics.stdev(values) if len(values) > 1 else None)


def summarize_repeats(scores: Sequence[Scores]) -> dict[str, Any] | None:
    """What `report.json` says about seeds; None for fewer than two.

    Where a report has a number, this has its "mean" and "deviation"; None where the data set has no such images.
    """
    if len(scores) < 2:
        return None
    return {
        "seeds": [one.seed for one in scores],
        "machines": _distinct([dict(one.provenance.machine) for one in scores]),
        "commits": _distinct([one.provenance.commit for one in scores]),
        "gaussians": _spread([one.gaussians for one in scores]),
        "megabytes": _spread([one.megabytes for one in scores]),
        "seconds": _spread([one.seconds for one in scores]),
        **_cells([one.cells for one in scores]),
        "variations": [
            {"kind": same[0]["kind"], "base": same[0]["base"], **_cells(same)}
            for same in zip(*(one.variations for one in scores), strict=True)
        ],
    }


def _cells(found: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """The spread of every metric in every cell, and the number of images, which is the same for all seeds."""
    metrics = {
        metric: {
            row: {column: _spread([one[metric][row][column] for one in found]) for column in columns}
            for row, columns in found[0][metric].items()
        }
        for metric in METRICS
    }
    return {**metrics, "images": found[0]["images"]}


def _spread(values: Sequence[float | None]) -> dict[str, float | None] | None:
    known = [value for value in values if value is not None]
    return Spread.of(known)._asdict() if known else None


def _distinct(values: Sequence[Any]) -> list[Any]:
    return [value for i, value in enumerate(values) if value not in values[:i]]
