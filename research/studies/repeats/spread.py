"""Means and standard deviations over seeds."""

from __future__ import annotations

import statistics
from collections.abc import Mapping, Sequence
from typing import Any

from research.studies.repeats.records import Scores
from surrogate.evaluation.scoring import METRICS

SIZES = ("gaussians", "megabytes", "seconds", "processor_seconds")


def spread(values: Sequence[Any]) -> dict[str, Any] | None:
    """Mean and sample standard deviation (n - 1 in the denominator) of the numbers that are not None; None without any.

    The deviation of a single number is None.  Of mappings, nested or not, it is the spread under every name.
    """
    if isinstance(values[0], Mapping):
        return {name: spread([value[name] for value in values]) for name in values[0]}
    known = [value for value in values if value is not None]
    deviation = statistics.stdev(known) if len(known) > 1 else None
    return {"mean": statistics.fmean(known), "deviation": deviation} if known else None


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
        **{name: spread([getattr(one, name) for one in scores]) for name in SIZES},
        **_cells([one.cells for one in scores]),
        "variations": [
            {"kind": same[0]["kind"], "base": same[0]["base"], **_cells(same)}
            for same in zip(*(one.variations for one in scores), strict=True)
        ],
    }


def _cells(found: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """The spread of every metric in every cell, and the number of images, which is the same for all seeds."""
    return {metric: spread([one[metric] for one in found]) for metric in METRICS} | {"images": found[0]["images"]}


def _distinct(values: Sequence[Any]) -> list[Any]:
    return [value for i, value in enumerate(values) if value not in values[:i]]
