"""The report's pictures: comparisons at the best, median and worst test images, curves, and errors by parameter."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from itertools import groupby, pairwise
from pathlib import Path
from typing import Any

import numpy as np

from catalogs.catalog import Catalog
from catalogs.variations import KINDS
from surrogate.evaluation.cases import PARAMETERS, VIEWS
from surrogate.evaluation.evaluate import Evaluation
from surrogate.evaluation.scoring import Cells, Scored
from surrogate.model import Surrogate
from surrogate.report.sheets import chosen_rows, draw_sheet

RESOLUTION = 130

Plot = Callable[[Any], bool]


def draw(directory: Path, surrogate: Surrogate, catalog: Catalog, evaluation: Evaluation) -> dict[str, str]:
    """Write PNG files into `directory`; returns titles and file names in the report's order."""
    import matplotlib

    matplotlib.use("agg")
    sheet = partial(_sheet, surrogate=surrogate, catalog=catalog)
    candidates: dict[str, tuple[str, Plot]] = {
        "Truth, prediction and difference": (
            "comparison.png",
            partial(sheet, names=("worst", "median", "best"), cells=evaluation.cells, otherwise=evaluation.validation),
        )
    }
    for varied in evaluation.variations:
        title = f"Truth, prediction and difference under {varied.variation.plural}"
        drawn = partial(sheet, names=("median", "worst"), cells=varied.cells, otherwise=varied.validation)
        candidates[title] = f"{varied.variation.kind}.png", drawn
    candidates |= {
        "Training": ("curves.png", lambda f: _curves(f, surrogate)),
        "Error by parameter": ("parameters.png", lambda f: _parameters(f, evaluation)),
        "Spread over images": ("spread.png", lambda f: _spread(f, evaluation)),
    }
    return {title: name for title, (name, plot) in candidates.items() if _save(directory / name, plot)}


def _save(path: Path, plot: Plot) -> bool:
    from matplotlib.figure import Figure

    figure = Figure(figsize=(9.0, 4.2), layout="constrained")
    drawn = plot(figure)
    if drawn:
        figure.savefig(path, dpi=RESOLUTION)
    return drawn


def _hardest_cell(cells: Cells, otherwise: Sequence[Scored]) -> tuple[str, list[Scored]]:
    """The images that ask most of the surrogate: of the last row and column that have any, else those for validation."""
    for row in reversed(list(cells)):
        for column in reversed(list(cells[row])):
            scored = list(cells[row][column])
            if scored:
                return f"{row.replace('_', ' ')}, {column.replace('_', ' ')}", scored
    return "validation", list(otherwise)


def _sheet(
    figure: Any,
    names: Sequence[str],
    cells: Cells,
    surrogate: Surrogate,
    catalog: Catalog,
    otherwise: Sequence[Scored],
) -> bool:
    """The images of these names among the hardest ones."""
    label, scored = _hardest_cell(cells, otherwise)
    if not scored:
        return False
    rows = chosen_rows(scored, names, surrogate, catalog)
    return draw_sheet(figure, f"{label.capitalize()}: {len(scored)} images", rows)


def _curves(figure: Any, surrogate: Surrogate) -> bool:
    curve = surrogate.training["curve"]
    if len(curve) < 2:
        return False
    left, right = figure.subplots(1, 2)
    for _, points in groupby(curve, lambda point: point["stage"] if point["stage"] in KINDS else ""):
        part = list(points)  # variations have validation images of their own: nothing leads from one part to the next
        steps, style = [point["step"] for point in part], "-" if len(part) > 1 else "."
        left.semilogy(steps, [point["loss"] for point in part], style, color="tab:blue")
        right.plot(steps, [np.nan if p["psnr"] is None else p["psnr"] for p in part], style, color="tab:orange")
    left.set(xlabel="step", ylabel="training loss (L1 + SSIM)", title="Loss")
    right.set(xlabel="step", ylabel="PSNR of validation images (dB)", title="Validation")
    changes = [(before["step"], p["stage"]) for before, p in pairwise(curve) if before["stage"] != p["stage"]]
    for axis in (left, right):
        axis.grid(alpha=0.3)
        for step, stage in changes:
            axis.axvline(step, color="gray", linewidth=1, linestyle="--")
            label = f" {stage.replace('_', ' ')} →"
            axis.text(step, axis.get_ylim()[0], label, fontsize=8, color="gray", va="bottom", rotation=90)
    return True


def _parameters(figure: Any, evaluation: Evaluation) -> bool:
    groups = {
        f"{p.split('_')[0]} parameters": evaluation.cells["unseen_views"][p] or evaluation.cells["seen_views"][p]
        for p in PARAMETERS
    }
    if not any(groups.values()):
        return False
    names = list(next(s for group in groups.values() for s in group).target.member.parameters)
    figure.set_size_inches(max(6.0, 3.0 * len(names)), 3.6)
    axes = figure.subplots(1, len(names), squeeze=False, sharey=True)[0]
    for axis, name in zip(axes, names, strict=True):
        for (label, scored), color in zip(groups.items(), ("tab:blue", "tab:orange"), strict=True):
            by_value: dict[float, list[float]] = {}
            for s in scored:
                by_value.setdefault(s.target.member.parameters[name], []).append(s.score.psnr)
            values = sorted(by_value)
            axis.plot(
                values, [float(np.mean(by_value[v])) for v in values], "o", color=color, label=label, markersize=4
            )
        axis.set(xlabel=name)
        axis.grid(alpha=0.3)
    axes[0].set_ylabel("mean PSNR (dB)")
    axes[0].legend(fontsize=8)
    return True


def _spread(figure: Any, evaluation: Evaluation) -> bool:
    axis = figure.subplots()
    drawn = False
    for views in VIEWS:
        for parameters in PARAMETERS:
            values = [s.score.psnr for s in evaluation.cells[views][parameters]]
            if values:
                label = f"{views.split('_')[0]} views, {parameters.split('_')[0]} parameters"
                axis.hist(values, bins=30, histtype="step", density=True, label=label, linewidth=1.5)
                drawn = True
    axis.set(xlabel="PSNR of an image (dB)", ylabel="density of images")
    axis.legend(fontsize=8)
    axis.grid(alpha=0.3)
    return drawn
