"""Variants compared with the default, or with the variant whose steps they take: means over seeds, and differences with errors."""

from __future__ import annotations

import math
import statistics
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from research.studies.ablation.records import AblationResult
from research.studies.ablation.variants import DEFAULT, Variant

SURE = 2.0  # standard errors


@dataclass(frozen=True, eq=False)
class VariantRow:
    """The results of one variant.

    Attributes
    ----------
    results : the successful results, by seed.
    failures : the failed results.
    psnr : mean over the seeds, dB; None without any.
    spread : standard deviation of a seed's PSNR; None for fewer than two.
    reference : name of the variant that it is compared with: the default, or the variant whose steps it takes.
    difference : difference from the reference's mean, dB; None where one is missing. Where steps are taken from the
        reference, it is that of the seeds that both have.
    error : standard error of that difference; None where either has fewer than two seeds.
    """

    variant: Variant
    results: Sequence[AblationResult]
    failures: Sequence[AblationResult]
    psnr: float | None = None
    spread: float | None = None
    reference: str = DEFAULT
    difference: float | None = None
    error: float | None = None

    @property
    def is_sure(self) -> bool:
        """True if the difference exceeds two standard errors."""
        return self.difference is not None and self.error is not None and abs(self.difference) > SURE * self.error

    def mean(self, name: str) -> float:
        """Mean over the seeds of a number in `AblationResult`."""
        return statistics.fmean(getattr(result, name) for result in self.results)


def compared(results: Sequence[AblationResult], variants: Sequence[Variant]) -> list[VariantRow]:
    """A row for each of `variants` that has results, the best first and failures last."""
    by_variant = {variant: [one for one in results if one.variant == variant.name] for variant in variants}
    rows = rows_of({variant: successes for variant, successes in by_variant.items() if successes})
    return sorted(rows, key=lambda row: -math.inf if row.psnr is None else row.psnr, reverse=True)


def rows_of(by_variant: Mapping[Variant, Sequence[AblationResult]]) -> list[VariantRow]:
    """The rows in the order of `known`."""
    scores = {variant.name: {r.seed: r.psnr for r in results if not r.error} for variant, results in by_variant.items()}
    rows = []
    for variant, results in by_variant.items():
        reference = variant.steps_of or DEFAULT
        own, others = scores[variant.name], {} if variant.name == reference else scores.get(reference, {})
        difference, error = (_paired if variant.steps_of else _unpaired)(own, others)
        rows.append(
            VariantRow(
                variant,
                [r for r in results if not r.error],
                [r for r in results if r.error],
                psnr=statistics.fmean(own.values()) if own else None,
                spread=statistics.stdev(own.values()) if len(own) > 1 else None,
                reference=reference,
                difference=difference,
                error=error,
            )
        )
    return rows


def _unpaired(own: Mapping[int, float], others: Mapping[int, float]) -> tuple[float | None, float | None]:
    """Difference and standard error of two means over independent seeds."""
    if not own or not others:
        return None, None
    difference = statistics.fmean(own.values()) - statistics.fmean(others.values())
    return difference, standard_error(list(own.values()), list(others.values()))


def _paired(own: Mapping[int, float], others: Mapping[int, float]) -> tuple[float | None, float | None]:
    """Mean difference of the common seeds, and its standard error."""
    differences = [own[seed] - others[seed] for seed in own if seed in others]
    if not differences:
        return None, None
    error = statistics.stdev(differences) / math.sqrt(len(differences)) if len(differences) > 1 else None
    return statistics.fmean(differences), error


def standard_error(some: Sequence[float], others: Sequence[float]) -> float | None:
    """Standard error of the difference of two means with unequal variances (Welch 1947); None for fewer than two
    samples of either."""
    if min(len(some), len(others)) < 2:
        return None
    return math.sqrt(sum(statistics.variance(values) / len(values) for values in (some, others)))
