"""The parts of a scene's report with rows in tables: the base appearance, and each variation."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from catalogs.vocabulary.variations import KINDS
from research.benchmarks.results.scenes import SceneResults
from surrogate.evaluation.cases import PARAMETERS
from surrogate.evaluation.metrics import MOST_DECIBELS
from surrogate.evaluation.tables import NOTHING, metric_number, number, spread_number

BASE = "base"
NEARLY_CUT = MOST_DECIBELS - 5.0  # dB; some of the images of such a mean are cut


@dataclass(frozen=True, eq=False)
class ReportPart:
    """The results of one part.

    Attributes
    ----------
    kind : "base", or that of the variation.
    what : description of its appearance.
    record : record of the report, with means by metric, row and column.
    spreads : the same over seeds; None for fewer than two.
    upper_bound : the entry of its per-member upper bound; None without one.
    """

    scene: str
    kind: str
    what: str
    record: Mapping[str, Any]
    spreads: Mapping[str, Any] | None
    upper_bound: Mapping[str, Any] | None

    def images(self, row: str, column: str) -> int:
        """Number of such images in the data set."""
        return int(self.record["images"][row][column] or 0)

    def figure(self, metric: str, row: str, column: str) -> str:
        """A mean, with the standard deviation over seeds where that is known."""
        if self.spreads is not None and metric in self.spreads:
            return spread_number(metric, self.spreads[metric][row][column])
        return metric_number(metric, self.record[metric][row][column])

    def seeds(self) -> str:
        """Number of seeds behind a figure."""
        return "1" if self.spreads is None else str(len(self.spreads["seeds"]))

    def best_trivial(self, row: str, column: str) -> str:
        """The best trivial predictor on the same images: its PSNR in dB, and its name."""
        if self.kind != BASE and row != "unseen_settings":
            return NOTHING
        entries = [e for e in self.record["trivial_predictors"] if not e.get("representation")]
        means = [entry["psnr"].get(row, {}) if self.kind == BASE else entry["psnr"] for entry in entries]
        candidates = [(of[column], i) for i, of in enumerate(means) if of.get(column) is not None]
        if not candidates:
            return NOTHING
        value, best = max(candidates)
        entry = entries[best]
        remarks = [
            entry["name"].split(" (")[0],
            *self._uncut(entry, value, row, column),
            *self._uncapped(entry, column),
        ]
        return f"{number(value)} ({'; '.join(remarks)})"

    def at_center(self, row: str, column: str) -> str:
        """PSNR in dB of the same model with the simulation's parameters at their centre, on the same images."""
        record = self.record.get("at_center")
        return NOTHING if record is None else number(record["psnr"][row][column])

    def _uncut(self, entry: Mapping[str, Any], value: float, row: str, column: str) -> list[str]:
        """For a predictor near the limit of an image's PSNR, the PSNR of its mean error, which has no limit."""
        means = entry.get("psnr_of_mean_error", {})
        uncut = (means.get(row, {}) if self.kind == BASE else means).get(column)
        return [f"of the mean error {uncut:.2f}"] if value > NEARLY_CUT and uncut is not None and uncut > value else []

    def _uncapped(self, entry: Mapping[str, Any], column: str) -> list[str]:
        """For a predictor from fewer settings than training showed: their number, and its score where it has more."""
        shown, trained = entry.get("settings_shown", {}), self.record.get("settings_trained")
        if not trained or column not in shown or shown[column][0] >= trained:
            return []
        fewest, most = shown[column]
        remarks = [f"from {fewest if fewest == most else f'{fewest} to {most}'} of {trained} trained {self.what}"]
        fuller = [other for other, (least, _) in shown.items() if other in PARAMETERS and least > most]
        return remarks + [
            f"with {shown[other][0]}, at {other.replace('_', ' ')}, {number(entry['psnr'][other])}"
            for other in fuller
            if entry["psnr"].get(other) is not None
        ]

    def beside_upper_bound(self) -> str:
        """PSNR in dB of the same Gaussians fitted alone, and of the surrogate on the same images."""
        if self.upper_bound is None:
            return NOTHING
        return f"{number(self.upper_bound['psnr'])} ({number(self.upper_bound['surrogate']['psnr'])})"


def parts_of(scenes: Iterable[SceneResults]) -> list[ReportPart]:
    """All parts of all reports, scene by scene, the base first."""
    return [part for scene in scenes for part in _parts(scene)]


def _parts(scene: SceneResults) -> list[ReportPart]:
    report, repeats = scene.report, scene.repeats
    if report is None:
        return []
    varied: Sequence[Mapping[str, Any]] = report["variations"]
    names = {name for one in varied for name in _upper_bound_names(one)}
    base = next((entry for entry in scene.upper_bounds if not names & set(entry["parameters"])), None)
    parts = [ReportPart(scene.name, BASE, scene.base, report, repeats, base)]
    for number_of, one in enumerate(varied):
        own = _upper_bound_names(one)
        upper_bound = next((entry for entry in scene.upper_bounds if own & set(entry["parameters"])), None)
        spreads = None if repeats is None else {"seeds": repeats["seeds"], **repeats["variations"][number_of]}
        parts.append(ReportPart(scene.name, one["kind"], KINDS[one["kind"]].plural, one, spreads, upper_bound))
    return parts


def _upper_bound_names(varied: Mapping[str, Any]) -> set[str]:
    """The visualization parameters at which the upper bound of a variation is measured; empty for a field."""
    return {parameter["name"] for parameter in varied["parameters"]} if KINDS[varied["kind"]].continuous else set()
