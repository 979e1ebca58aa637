"""The tables of a comparison in Markdown, one for each time."""

from __future__ import annotations

import statistics
from collections.abc import Mapping, Sequence
from typing import Any

from research.studies.comparison.methods import CONTESTANTS, OURS, ordered, title
from research.studies.comparison.result import TRIVIAL, ComparisonResult, MethodRow, Terms, terms
from research.studies.comparison.trivial import best_of
from surrogate.evaluation.tables import HEADINGS, NOTHING, document, metric_number, table

DETAILS = ("ssim", "ms_ssim", "flip")  # of the last cell, where images are large enough
OUR_ROW, MIXED = MethodRow(OURS), MethodRow(TRIVIAL)


def tables(results: Sequence[ComparisonResult]) -> str:
    """A table for each of the terms, with the mixtures of stored images in each."""
    return document(*(_table(results, each) for each in terms(results))).strip()


def cell_names(results: Sequence[ComparisonResult]) -> list[str]:
    """Names of the test cells."""
    named = [list(r.cells) for r in results if r.method != TRIVIAL and r.cells]
    return named[0] if named else []


def leaders(results: Sequence[ComparisonResult], on: Terms) -> dict[str, MethodRow]:
    """The row with the highest mean PSNR in each cell on these terms, mixtures included."""
    best = {}
    for cell in cell_names(results):
        scores = _means(results, on, cell)
        trivial = _trivial(results, cell)
        if trivial is not None:
            scores[MIXED] = trivial[1]
        if scores:
            best[cell] = max(scores, key=lambda row: scores[row])
    return best


SHORT_HEADER = ("scene", "time", "images", "this surrogate", "best published method", "stored pictures, mixed")


def in_short(scene: str, results: Sequence[ComparisonResult]) -> list[list[str]]:
    """A row of `SHORT_HEADER` for each of the terms and each cell: PSNR (dB) of ours, the best published method and mixtures.

    Cells without a result of ours or of a published method are left out.
    """
    rows = []
    for on in terms(results):
        for cell in cell_names(results):
            scores = _means(results, on, cell)
            published = {row: psnr for row, psnr in scores.items() if CONTESTANTS[row.method].official_steps}
            if OUR_ROW not in scores or not published:
                continue
            best, mixed = max(published, key=lambda row: published[row]), _trivial(results, cell)
            texts = {
                OUR_ROW: f"{scores[OUR_ROW]:.2f}",
                best: f"{published[best]:.2f} ({title(best)})",
                MIXED: NOTHING if mixed is None else f"{mixed[1]:.2f}",
            }
            candidates = {OUR_ROW: scores[OUR_ROW], best: published[best]} | (
                {} if mixed is None else {MIXED: mixed[1]}
            )
            leader = max(candidates, key=lambda row: candidates[row])
            rows.append([f"`{scene}`", str(on), cell, *(_bold(text, row == leader) for row, text in texts.items())])
    return rows


def _table(results: Sequence[ComparisonResult], on: Terms) -> str:
    cells, first = cell_names(results), leaders(results, on)
    whole = [r for r in results if r.terms == on and not r.error]
    details = [metric for metric in DETAILS if any(r.cells[cells[-1]][metric] is not None for r in whole)]
    header = (
        str(on),
        *(f"{cell}, PSNR (dB)" for cell in cells),
        *(f"{cells[-1]}, {HEADINGS[metric]}" for metric in details),
        "steps",
        "of the published",
        "size (MB)",
        "seconds" if on.device != "cpu" else "processor seconds",
        "a picture (ms)",
        "at other parameters (ms)",
        "seeds",
    )
    trained = [r for r in results if r.terms == on and r.method != TRIVIAL]
    rows = [
        _row(row, [r for r in trained if r.row == row], cells, details, first)
        for row in ordered(r.row for r in trained)
    ]
    return table(header, [*rows, _trivial_row(results, cells, first, len(header))])


def _row(
    row: MethodRow,
    of: Sequence[ComparisonResult],
    cells: Sequence[str],
    details: Sequence[str],
    first: Mapping[str, MethodRow],
) -> list[str]:
    """The row of one contestant's trainings for one time."""
    whole, official = [r for r in of if not r.error], CONTESTANTS[row.method].official_steps
    if not whole:
        return [title(row), of[0].error.replace("|", "/"), *[NOTHING] * (len(cells) + len(details) + 6)]
    return [
        title(row),
        *(_bold(_spread("psnr", [r.cells[cell]["psnr"] for r in whole]), first.get(cell) == row) for cell in cells),
        *(_spread(metric, [r.cells[cells[-1]][metric] for r in whole]) for metric in details),
        f"{statistics.fmean(r.steps for r in whole):,.0f}",
        f"{100.0 * statistics.fmean(r.steps for r in whole) / official:.2g} %" if official else NOTHING,
        f"{statistics.fmean(r.megabytes for r in whole):.2f}",
        f"{statistics.fmean(r.seconds for r in whole):,.0f}",
        _median([r.picture_milliseconds for r in whole]),
        _median([r.change_milliseconds for r in whole]),
        str(len(whole)),
    ]


def _trivial_row(
    results: Sequence[ComparisonResult], cells: Sequence[str], first: Mapping[str, MethodRow], width: int
) -> list[str]:
    trivials = [_trivial(results, cell) for cell in cells]
    texts = [
        NOTHING if best is None else _bold(f"{best[1]:.2f} ({best[0]})", first.get(cell) == MIXED)
        for cell, best in zip(cells, trivials, strict=True)
    ]
    return ["stored pictures, mixed", *texts, *[NOTHING] * (width - 1 - len(texts))]


def _trivial(results: Sequence[ComparisonResult], cell: str) -> tuple[str, float] | None:
    mixtures = [r.cells for r in results if r.method == TRIVIAL]
    return best_of(mixtures[0], cell) if mixtures else None


def _means(results: Sequence[ComparisonResult], on: Terms, cell: str) -> dict[MethodRow, float]:
    scores = dict[MethodRow, list[float]]()
    for r in results:
        if r.terms == on and not r.error and cell in r.cells and r.method != TRIVIAL:
            scores.setdefault(r.row, []).append(r.cells[cell]["psnr"])
    return {row: statistics.fmean(values) for row, values in scores.items()}


def _spread(metric: str, values: Sequence[Any]) -> str:
    numbers = [float(value) for value in values if value is not None]
    if not numbers:
        return NOTHING
    mean = metric_number(metric, statistics.fmean(numbers))
    return mean if len(numbers) < 2 else f"{mean} ± {metric_number(metric, statistics.stdev(numbers))}"


def _median(values: Sequence[float | None]) -> str:
    numbers = [value for value in values if value is not None]
    return f"{statistics.median(numbers):,.3g}" if numbers else NOTHING


def _bold(text: str, bold: bool) -> str:
    return f"**{text}**" if bold else text
