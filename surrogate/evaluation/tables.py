"""Tables of metrics, as JSON values and as lines of Markdown: what every section of a report shares."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from surrogate.evaluation.scoring import METRICS, PERCEPTUAL_METRICS, Cells, mean
from surrogate.evaluation.timing import Milliseconds

ALL_METRICS = (*METRICS, *PERCEPTUAL_METRICS)
HEADINGS = {
    "psnr": "PSNR (dB)",
    "psnr_of_mean_error": "PSNR of the mean error (dB)",
    "psnr_foreground": "PSNR of the foreground (dB)",
    "ssim": "SSIM",
    "ms_ssim": "MS-SSIM",
    "lpips": "LPIPS",
    "flip": "FLIP",
    "covered": "covered pixels",
}
DECIBELS = ("psnr", "psnr_of_mean_error", "psnr_foreground")
NOTHING = "–"


def cell_means(cells: Cells, metric: str) -> dict[str, dict[str, float | None]]:
    """The mean of a metric by row and column; None where there is no such image."""
    return {row: {column: mean(scored, metric) for column, scored in columns.items()} for row, columns in cells.items()}


def cell_tables(cells: Cells) -> dict[str, Any]:
    """The means of all metrics, and how many images they are of."""
    tables: dict[str, Any] = {metric: cell_means(cells, metric) for metric in ALL_METRICS}
    return tables | {
        "images": {row: {c: len(scored) for c, scored in columns.items()} for row, columns in cells.items()},
        "perceptual_images": {
            row: {c: sum(s.perceptual is not None for s in scored) for c, scored in columns.items()}
            for row, columns in cells.items()
        },
    }


def number(value: float | None, digits: int = 2) -> str:
    """A number as tables show it."""
    return NOTHING if value is None else f"{value:.{digits}f}"


def metric_number(metric: str, value: float | None) -> str:
    """A metric's mean as tables show it."""
    if metric == "covered":
        return NOTHING if value is None else f"{100.0 * value:.1f} %"
    return number(value, 2 if metric in DECIBELS else 4)


def spread_number(metric: str, spread: Mapping[str, float | None] | None) -> str:
    """The mean of a metric over seeds and its standard deviation, as tables show them."""
    if spread is None or spread["mean"] is None:
        return NOTHING
    mean, deviation = (metric_number(metric, value) for value in (spread["mean"], spread["deviation"]))
    return mean if spread["deviation"] is None else f"{mean} ± {deviation}"


def timings(milliseconds: Mapping[str, Milliseconds]) -> dict[str, Any]:
    """The median of everything that was measured, and its lowest and highest."""
    return {
        "milliseconds": {name: taken.median for name, taken in milliseconds.items()},
        "milliseconds_spread": {name: [taken.lowest, taken.highest] for name, taken in milliseconds.items()},
    }


def timing_row(record: Mapping[str, Any], name: str, label: str) -> tuple[str, str]:
    """A row about one of a record's `timings`."""
    lowest, highest = record["milliseconds_spread"][name]
    return label, f"{record['milliseconds'][name]:.2f} ms (median; {lowest:.2f} to {highest:.2f})"


def row(*cells: str) -> str:
    """A row of a table."""
    return f"| {' | '.join(cells)} |"


def table(header: Sequence[str], rows: Iterable[Sequence[str]]) -> list[str]:
    """A whole table."""
    return [row(*header), row(*["---"] * len(header)), *(row(*cells) for cells in rows)]


def cell_table(record: Mapping[str, Any], names: tuple[str, str], *, also: Sequence[str] = ()) -> list[str]:
    """`cell_tables` in Markdown, a row for each cell; `names` head what its rows and columns are."""
    metrics = (*ALL_METRICS, *also)
    return table(
        (*names, *(HEADINGS[m] for m in metrics), "images"),
        (
            (
                first.split("_")[0],
                second.split("_")[0],
                *(metric_number(m, record[m][first][second]) for m in metrics),
                str(count),
            )
            for first, columns in record["images"].items()
            for second, count in columns.items()
        ),
    )


def perceptual_remarks(record: Mapping[str, Any], unavailable: Mapping[str, str]) -> list[str]:
    """Lines below a `cell_table`: how many images the perceptual metrics looked at, and why a column is empty."""
    counts = [count for columns in record["perceptual_images"].values() for count in columns.values()]
    if not any(counts):
        return []
    empty = [
        m for m in PERCEPTUAL_METRICS if all(v is None for columns in record[m].values() for v in columns.values())
    ]
    shown = ", ".join(HEADINGS[m] for m in PERCEPTUAL_METRICS if m not in empty)
    sentences = [f"{shown}: at most {max(counts)} images of a cell, evenly spread."] if shown else []
    for metric in empty:
        reason = unavailable.get(metric, "these images are too small for it")
        sentences.append(f"{HEADINGS[metric]} is missing: {reason}.")
    return ["", "  \n".join(sentences)]
