"""Tables of metrics, as JSON values and in Markdown, for reports, studies and the page of results."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import reduce
from operator import getitem
from typing import Any, TypeVar

from surrogate.evaluation.cases import each_cell
from surrogate.evaluation.scoring import METRICS, PERCEPTUAL_METRICS, Cells, Scored, mean

ALL_METRICS = (*METRICS, *PERCEPTUAL_METRICS)
HEADINGS = {
    "psnr": "PSNR (dB)",
    "psnr_of_mean_error": "PSNR of the mean error (dB)",
    "psnr_foreground": "PSNR of the foreground (dB)",
    "one_in_ten": "one in ten is below (dB)",
    "ssim": "SSIM",
    "ms_ssim": "MS-SSIM",
    "lpips": "LPIPS",
    "flip": "FLIP",
    "covered": "covered pixels",
}
DECIBELS = ("psnr", "psnr_of_mean_error", "psnr_foreground", "one_in_ten")
NOTHING = "–"

Entry = TypeVar("Entry")


def means(scored: Iterable[Scored], metrics: Sequence[str] = METRICS) -> dict[str, float | None]:
    """The mean of each metric; None where there is no such image."""
    images = list(scored)
    return {metric: mean(images, metric) for metric in metrics}


def cell_means(cells: Cells, metric: str) -> dict[str, dict[str, float | None]]:
    """The mean of a metric by row and column; None where there is no such image."""
    return each_cell(cells, lambda scored: mean(scored, metric))


def cell_tables(cells: Cells, metrics: Sequence[str] = ALL_METRICS) -> dict[str, Any]:
    """The means of metrics by row and column, and their numbers of images."""
    return {metric: cell_means(cells, metric) for metric in metrics} | {"images": each_cell(cells, len)}


def number(value: float | None, digits: int = 2) -> str:
    """A number formatted for tables."""
    return NOTHING if value is None else f"{value:.{digits}f}"


def metric_number(metric: str, value: float | None) -> str:
    """A metric's mean formatted for tables."""
    if metric == "covered":
        return NOTHING if value is None else f"{100.0 * value:.1f} %"
    return number(value, 2 if metric in DECIBELS else 4)


def signed_number(value: float | None) -> str:
    """A difference in dB formatted for tables; empty for None."""
    return "" if value is None else f"{value:+.2f}"


def spread_number(metric: str, spread: Mapping[str, float | None] | None) -> str:
    """The mean of a metric over seeds and its standard deviation, formatted for tables."""
    if spread is None or spread["mean"] is None:
        return NOTHING
    mean, deviation = (metric_number(metric, value) for value in (spread["mean"], spread["deviation"]))
    return mean if spread["deviation"] is None else f"{mean} ± {deviation}"


def plain_spread(spread: Mapping[str, float], digits: int) -> str:
    """The mean of a size or time over seeds and its standard deviation, formatted for tables."""
    return f"{spread['mean']:,.{digits}f} ± {spread['deviation']:,.{digits}f}"


def terminal_line(label: str, foreground: float | None, psnr: float, ssim: float) -> str:
    """PSNR of the foreground and of whole images, and SSIM, of a group of images, for a terminal."""
    return f"{label:<38} foreground {number(foreground):>5} dB, whole {psnr:5.2f} dB, SSIM {ssim:.4f}"


def document(*blocks: str) -> str:
    """Join headings, paragraphs and tables to a Markdown page; empty ones are left out."""
    return "\n\n".join(filter(None, blocks)) + "\n"


def table(header: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """A table in Markdown."""
    return "\n".join(f"| {' | '.join(cells)} |" for cells in (header, ["---"] * len(header), *rows))


def table_of(entries: Iterable[Entry], *columns: tuple[str, Callable[[Entry], str]]) -> str:
    """A table with a row for each entry; a column is a heading and a function from an entry to its text."""
    return table([heading for heading, _ in columns], [[cell(entry) for _, cell in columns] for entry in entries])


def metric_column(heading: str, *path: str) -> tuple[str, Callable[[Any], str]]:
    """A column for `table_of`: the mean at `path` in an entry, of the metric that the path names."""
    [metric] = set(path) & set(HEADINGS)
    return heading, lambda entry: metric_number(metric, reduce(getitem, path, entry))


def cell_table(
    record: Mapping[str, Any],
    names: tuple[str, str],
    metrics: Sequence[str] = ALL_METRICS,
    form: Callable[[str, Any], str] = metric_number,
) -> str:
    """The `cell_tables` of a record, with a row for each cell; `names` are the headings of rows and columns."""
    return table(
        (*names, *(HEADINGS[m] for m in metrics), "images"),
        (
            (_short(row), _short(column), *(form(m, record[m][row][column]) for m in metrics), str(count))
            for row, columns in record["images"].items()
            for column, count in columns.items()
        ),
    )


def validation_line(record: Mapping[str, Any], what: str) -> str:
    """Scores of a record's validation images, and whether choices were made on some; `what` describes them."""
    parts = record["validation"]
    foreground, psnr, ssim = (metric_number(name, parts[name]) for name in ("psnr_foreground", "psnr", "ssim"))
    by_some = ", some of which decided about the model" if any((record.get("decided_on") or {}).values()) else ""
    return f"Validation ({parts['images']} images{what}{by_some}): foreground {foreground} dB, whole {psnr} dB, SSIM {ssim}."


def timing_row(record: Mapping[str, Any], name: str, label: str) -> tuple[str, str]:
    """A table row for one of the times in a record."""
    lowest, highest = record["milliseconds_spread"][name]
    return label, f"{record['milliseconds'][name]:.2f} ms (median; {lowest:.2f} to {highest:.2f})"


def lead(own: float | None, other: float | None) -> float | None:
    """The difference of two values; None where one is missing."""
    return None if own is None or other is None else own - other


def _short(name: str) -> str:
    return name.split("_")[0]
