"""The report's pictures: comparisons at the best, median and worst test images, curves, and errors by parameter."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from itertools import groupby, pairwise
from pathlib import Path
from typing import Any

import numpy as np

from catalogs.store.catalog import Catalog
from catalogs.vocabulary.parameters import ParameterSpace
from catalogs.vocabulary.variations import KINDS
from surrogate.evaluation.cases import PARAMETERS
from surrogate.evaluation.evaluate import Evaluation, VariedEvaluation
from surrogate.evaluation.scoring import Cells, Scored
from surrogate.model import Surrogate
from surrogate.model.representation import DRAWN, VIEW
from surrogate.report.sheets import chosen, draw_sheet

RESOLUTION = 130

Plot = Callable[[Any], bool]


def draw(directory: Path, surrogate: Surrogate, catalog: Catalog, evaluation: Evaluation) -> dict[str, str]:
    """Write PNG files into `directory`; returns titles and file names in the report's order."""
    from matplotlib.figure import Figure

    title, sheet = "Truth, prediction and difference", partial(_sheet, surrogate=surrogate, catalog=catalog)
    plots: dict[str, tuple[str, Plot]] = {
        title: ("comparison.png", partial(sheet, ("worst", "median", "best"), evaluation))
    }
    for varied in evaluation.variations:
        under = partial(sheet, ("median", "worst"), varied)
        plots[f"{title} under {varied.variation.plural}"] = f"{varied.variation.kind}.png", under
    plots |= {
        "Training": ("curves.png", partial(_curves, surrogate)),
        "Error by parameter": ("parameters.png", partial(_parameters, evaluation, surrogate.space)),
        "Spread over images": ("spread.png", partial(_spread, evaluation)),
    }
    files = {}
    for title, (name, plot) in plots.items():
        figure = Figure(figsize=(9.0, 4.2), layout="constrained")
        if plot(figure):
            figure.savefig(directory / name, dpi=RESOLUTION)
            files[title] = name
    return files


def _sheet(
    names: Sequence[str], part: Evaluation | VariedEvaluation, figure: Any, *, surrogate: Surrogate, catalog: Catalog
) -> bool:
    """Draw the "worst", "median" or "best" of the last cell that has images, where most is unseen, else of validation images."""
    label, scored = list({"validation": part.validation, **_groups(part.cells)}.items())[-1]
    if scored:
        kind = part.variation.kind if isinstance(part, VariedEvaluation) else VIEW
        words = "" if surrogate.field is None else f", drawn {DRAWN[surrogate.representation(kind)]}"
        title = f"{label.capitalize()}: {len(scored)} images{words}"
        draw_sheet(figure, title, chosen(scored, names), surrogate, catalog)
    return bool(scored)


def _curves(surrogate: Surrogate, figure: Any) -> bool:
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


def _parameters(evaluation: Evaluation, space: ParameterSpace, figure: Any) -> bool:
    groups = {
        f"{p.split('_')[0]} parameters": evaluation.cells["unseen_views"][p] or evaluation.cells["seen_views"][p]
        for p in PARAMETERS
    }
    if not any(groups.values()) or not len(space):
        return False
    figure.set_size_inches(max(6.0, 3.0 * len(space)), 3.6)
    axes = figure.subplots(1, len(space), squeeze=False, sharey=True)[0]
    for axis, parameter in zip(axes, space.parameters, strict=True):
        for (label, scored), color in zip(groups.items(), ("tab:blue", "tab:orange"), strict=True):
            by_value: dict[float, list[float]] = {}
            for s in scored:
                by_value.setdefault(s.target.member.parameters[parameter.name], []).append(s.score.psnr)
            axis.plot(
                list(by_value), list(map(np.mean, by_value.values())), "o", color=color, label=label, markersize=4
            )
        axis.set(xlabel=parameter.label, xscale=parameter.scale)
        axis.grid(alpha=0.3)
    axes[0].set_ylabel("mean PSNR (dB)")
    axes[0].legend(fontsize=8)
    return True


def _spread(evaluation: Evaluation, figure: Any) -> bool:
    axis, groups = figure.subplots(), _groups(evaluation.cells)
    for label, scored in groups.items():
        psnr = [s.score.psnr for s in scored]
        axis.hist(psnr, bins=30, histtype="step", density=True, label=label, linewidth=1.5)
    axis.set(xlabel="PSNR of an image (dB)", ylabel="density of images")
    axis.legend(fontsize=8)
    axis.grid(alpha=0.3)
    return bool(groups)


def _groups(cells: Cells) -> dict[str, Sequence[Scored]]:
    """The images of each cell that has any, by its row and column in words."""
    groups = {f"{row}, {column}": scored for row, columns in cells.items() for column, scored in columns.items()}
    return {name.replace("_", " "): scored for name, scored in groups.items() if scored}
