"""Plots of accuracy over processor time, and sheets of the same test images by every method."""

from __future__ import annotations

from collections.abc import Sequence
from io import BytesIO
from itertools import cycle
from pathlib import Path
from textwrap import fill
from typing import Any

import numpy as np
from numpy.typing import NDArray

from research.studies.comparison.methods import CONTESTANTS, OURS, ordered, title
from research.studies.comparison.pictures import TRUTH, are_kept, stored_images
from research.studies.comparison.result import TRIVIAL, ComparisonResult, MethodRow, Terms, in_float32

LINES, MARKED = ("solid", "dashed", "dotted"), 20  # by time; a line with more points has no markers
RESOLUTION, PANEL_INCHES, TITLE = 110, 1.75, 26  # TITLE: letters in a line
ZOOM, FACTOR = 48, 4.0  # pixels per side of the enlarged detail, and the factor on differences


def curves(results: Sequence[ComparisonResult]) -> bytes | None:
    """PSNR of validation images over processor seconds as PNG, a line for each training on a processor; None without any.

    Methods that were trained in both precisions are shown in float32.
    """
    from matplotlib import colormaps
    from matplotlib.figure import Figure

    tones = colormaps["tab20"].colors  # type: ignore[attr-defined]  # [20, 3]: a light one after each dark one
    colors = dict(zip(CONTESTANTS, (*tones[::2], *tones[1::2]), strict=False))
    shown = [r for r in in_float32(results) if r.curve and not r.error and r.device == "cpu"]
    if not shown:
        return None
    figure = Figure(figsize=(8.0, 5.6), layout="constrained")
    axes, named = figure.add_subplot(), set[str]()
    lines = dict(zip(sorted({result.minutes for result in shown}), cycle(LINES)))  # by time
    for result in shown:
        name = title(result.row).strip("*")
        axes.plot(
            *zip(*result.curve, strict=True),
            color=colors[result.method],
            label=name if name not in named else None,
            linestyle=lines[result.minutes],
            linewidth=2.2 if result.method == OURS else 1.0,
            marker="o" if len(result.curve) <= MARKED else None,
            markersize=2.5,
        )
        named.add(name)
    if len(lines) > 1:
        axes.set_title(", ".join(f"{line}: {minutes:g} min" for minutes, line in lines.items()), fontsize=8)
    axes.set_xscale("log")
    axes.set_xlabel("seconds of processor time")
    axes.set_ylabel("PSNR of validation images, dB")
    axes.grid(linewidth=0.4, alpha=0.5)
    figure.legend(fontsize=8, loc="outside lower center", ncols=2)
    return _png(figure)


def sheet(records: Path, results: Sequence[ComparisonResult], on: Terms) -> bytes | None:
    """Some test images as PNG: the truth first, then every method on these terms; None without images.

    Images come from a scene's `records`; methods without any there are left out. Methods that were trained in both
    precisions are shown in float32. Below each image are the enlarged square around the worst place of the first
    method, and the difference from the truth.
    """
    from matplotlib.figure import Figure

    stored = {row: stored_images(records, name) for row, name in _names(results, on).items()}
    names, truths = ordered(row for row, pictures in stored.items() if pictures), stored_images(records, TRUTH)
    if not names or not truths:
        return None
    rows = list(zip(truths, *(stored[name] for name in names), strict=True))
    columns = len(names) + 1
    figure = Figure(figsize=(PANEL_INCHES * columns, 3.0 * PANEL_INCHES * len(rows) + 0.5), layout="constrained")
    grid = figure.subplots(3 * len(rows), columns, squeeze=False)
    titles = ["truth", *(title(name).strip("*") for name in names)]
    for number, pictures in enumerate(rows):
        truth, part = pictures[0], _worst(pictures)
        for column, picture in enumerate(pictures):
            difference = np.abs(picture - truth) * FACTOR
            for kind, image in enumerate((picture, picture[part], difference)):
                axes = grid[3 * number + kind, column]
                axes.set_axis_off()
                if not (kind == 2 and column == 0):
                    axes.imshow(image.clip(0.0, 1.0), interpolation="nearest")
            if number == 0:
                grid[0, column].set_title(fill(titles[column], TITLE), fontsize=8)
        grid[3 * number + 2, 0].text(0.5, 0.5, f"difference × {FACTOR:g}", ha="center", fontsize=8)
    return _png(figure)


def without_pictures(records: Path, results: Sequence[ComparisonResult], on: Terms) -> list[MethodRow]:
    """The methods trained on these terms that have no stored images."""
    return ordered(row for row, name in _names(results, on).items() if not are_kept(records, name))


def _names(results: Sequence[ComparisonResult], on: Terms) -> dict[MethodRow, str]:
    """Names of the results that a sheet can show, by row."""
    on_these = [r for r in in_float32(results) if (r.terms, r.seed) == (on, 0)]
    return {r.row: r.name for r in on_these if not r.error and r.method != TRIVIAL}


def _worst(pictures: Sequence[NDArray[np.float32]]) -> tuple[slice, slice]:
    """The square where the first method differs most from the truth."""
    error = ((pictures[1] - pictures[0]) ** 2).sum(axis=2)  # [H, W]
    side = min(ZOOM, *error.shape)
    sums = np.zeros((error.shape[0] + 1, error.shape[1] + 1))
    sums[1:, 1:] = error.cumsum(axis=0).cumsum(axis=1)
    boxes = sums[side:, side:] - sums[:-side, side:] - sums[side:, :-side] + sums[:-side, :-side]
    row, column = np.unravel_index(int(boxes.argmax()), boxes.shape)
    return slice(int(row), int(row) + side), slice(int(column), int(column) + side)


def _png(figure: Any) -> bytes:
    content = BytesIO()
    figure.savefig(content, format="png", dpi=RESOLUTION, facecolor="white")
    return content.getvalue()
