"""The report's pictures: strips of pictures, errors over the two most important parameters, and curves."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from itertools import groupby, pairwise
from pathlib import Path
from typing import Any

import numpy as np

from catalogs.store.catalog import Catalog
from catalogs.vocabulary.parameters import ParameterSpace
from catalogs.vocabulary.variations import KINDS
from surrogate.evaluation.evaluate import Baseline, Evaluation, VariedEvaluation
from surrogate.evaluation.scoring import Cells, Scored, mean
from surrogate.model import Surrogate
from surrogate.model.representation import DRAWN, VIEW
from surrogate.report.sheets import chosen, draw_sheet

RESOLUTION = 130
STRIP, WHERE, MORE = "Truth, surrogate and the best simple prediction", "Where it errs", "Longer training, more members"
LEAST_SPAN = 2.0  # dB, of half an axis
MARKERS = {"test": "o", "validation": "s", "train": "."}

Plot = Callable[[Any], bool]


def draw(
    directory: Path, surrogate: Surrogate, catalog: Catalog, evaluation: Evaluation, record: Mapping[str, Any]
) -> dict[str, str]:
    """Write PNG files into `directory`; returns titles and file names in the report's order."""
    from matplotlib.figure import Figure

    sheet = partial(_sheet, surrogate=surrogate, catalog=catalog)
    plots: dict[str, tuple[str, Plot]] = {
        STRIP: ("comparison.png", partial(sheet, ("worst", "median", "best"), evaluation))
    }
    for varied in evaluation.variations:
        under = partial(sheet, ("median", "worst"), varied)
        plots[f"{STRIP} under {varied.variation.plural}"] = f"{varied.variation.kind}.png", under
    plots[WHERE] = "members.png", partial(_members, record, surrogate.space)
    plots[MORE] = "curves.png", partial(_curves, record)
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
        draw_sheet(figure, title, chosen(scored, names), surrogate, catalog, _rival(part.baselines, scored))
    return bool(scored)


def _rival(baselines: Sequence[Baseline], scored: Sequence[Scored]) -> Baseline | None:
    """The simple predictor with the best foreground in some images; None without any that predicts them."""
    cases, means = {s.target for s in scored}, list[tuple[float, int]]()
    for number, baseline in enumerate(baselines):
        same = [s for of in baseline.scores.values() for s in of if s.target in cases]
        score = None if baseline.representation or len(same) < len(cases) else mean(same, "psnr_foreground")
        means += [] if score is None else [(score, number)]
    return baselines[max(means)[1]] if means else None


def _members(record: Mapping[str, Any], space: ParameterSpace, figure: Any) -> bool:
    """Members over the two most important parameters, coloured by the PSNR of their foreground, beside what each changes."""
    members = [m for m in record["members"] if m["psnr_foreground"] is not None]
    importance = record["outlook"]["importance"]
    if not members or not len(space):
        return False
    left, right = figure.subplots(1, 2, width_ratios=(3, 2))
    order = sorted(space.parameters, key=lambda p: -importance.get(p.name, 0.0))
    first, second = (order * 2)[:2]
    unseen = [m["psnr_foreground"] for m in members if m["split"] != "train"]
    low, high = min(unseen or [m["psnr_foreground"] for m in members]), max(m["psnr_foreground"] for m in members)
    for split, marker in MARKERS.items():
        of_split = sorted((m for m in members if m["split"] == split), key=lambda m: -m["psnr_foreground"])
        psnr = [m["psnr_foreground"] for m in of_split]
        x = [m["parameters"][first.name] for m in of_split]
        y = [m["parameters"][second.name] for m in of_split] if len(space) > 1 else psnr
        label = f"{split} ({len(of_split)})" if of_split else None
        edge = {"edgecolors": "black", "linewidths": 0.8} if split != "train" else {}
        colored = left.scatter(
            x, y, c=psnr, cmap="viridis", vmin=low, vmax=high, marker=marker, s=70 if edge else 30, label=label, **edge
        )
    foreground = "PSNR of the foreground (dB)"
    left.set(xlabel=first.label, xscale=first.scale, ylabel=second.label if len(space) > 1 else foreground)
    if len(space) > 1:
        left.set_yscale(second.scale)
        figure.colorbar(colored, ax=left, label=f"{foreground}; dark: worse")
    else:
        middle = 0.5 * sum(left.get_ylim())  # differences of a tenth of a decibel are not to look large
        left.set_ylim(min(left.get_ylim()[0], middle - LEAST_SPAN), max(left.get_ylim()[1], middle + LEAST_SPAN))
    left.grid(alpha=0.3)
    title = "Members over the two parameters that matter most" if len(space) > 1 else "Members"
    left.legend(title=title, fontsize=8, ncols=3, loc="lower left", bbox_to_anchor=(0.0, 1.0), frameon=False)
    right.barh(
        [p.name for p in order[::-1]], [100.0 * importance.get(p.name, 0.0) for p in order[::-1]], color="tab:blue"
    )
    right.set(xlabel="change of colours over its range (%)")
    right.set_title("What matters", fontsize=10)
    return True


def _curves(record: Mapping[str, Any], figure: Any) -> bool:
    """PSNR of validation pictures over training steps, and the learning curve over members."""
    curve, more = [p for p in record["curve"] if p["psnr"] is not None], record["outlook"]["learning_curve"]
    if len(curve) < 2 and more is None:
        return False
    axes = iter(figure.subplots(1, (len(curve) > 1) + (more is not None), squeeze=False)[0])
    if len(curve) > 1:
        _training(curve, next(axes))
    if more is not None:
        _learning(more, record["outlook"]["gains"], next(axes))
    return True


def _training(curve: Sequence[Mapping[str, Any]], axis: Any) -> None:
    for _, points in groupby(curve, lambda point: point["stage"] if point["stage"] in KINDS else ""):
        part = list(points)  # variations have validation images of their own: nothing leads from one part to the next
        style = "-" if len(part) > 1 else "."
        axis.plot([p["step"] for p in part], [p["psnr"] for p in part], style, color="tab:orange")
    axis.set(xlabel="training step", ylabel="PSNR of validation pictures (dB)", title="Longer training")
    axis.grid(alpha=0.3)
    for before, after in pairwise(curve):
        if before["stage"] != after["stage"]:
            axis.axvline(before["step"], color="gray", linewidth=1, linestyle="--")
            label = f" {after['stage'].replace('_', ' ')} →"
            axis.text(before["step"], axis.get_ylim()[0], label, fontsize=8, color="gray", va="bottom", rotation=90)


def _learning(curve: Mapping[str, Any], gains: Sequence[Mapping[str, float]], axis: Any) -> None:
    """The learning curve as measured, and as expected from the number of members on."""
    members, sizes, decibels = curve["members"], np.array(curve["sizes"]), np.array(curve["decibels"])
    slope = np.polyfit(np.log(sizes), decibels, 1)
    now = float(np.polyval(slope, np.log(members)))
    axis.plot(sizes, decibels, "o", color="tab:blue", label="measured, with members left out")
    x, y = [members + g["more"] for g in gains], [now + g["decibels"] for g in gains]
    off = [[g["decibels"] - g["low"] for g in gains], [g["high"] - g["decibels"] for g in gains]]
    axis.errorbar(
        [members, *x], [now, *y], [[0, *off[0]], [0, *off[1]]], color="tab:orange", capsize=3, label="expected, 90 %"
    )
    axis.axvline(members, color="gray", linestyle="--", linewidth=1)
    axis.set(xlabel="members learnt from", ylabel="accuracy of the emulated field (dB)", title="More members")
    axis.grid(alpha=0.3)
    axis.legend(fontsize=8, loc="lower right")


def _groups(cells: Cells) -> dict[str, Sequence[Scored]]:
    """The images of each cell that has any, by its row and column in words."""
    groups = {f"{row}, {column}": scored for row, columns in cells.items() for column, scored in columns.items()}
    return {name.replace("_", " "): scored for name, scored in groups.items() if scored}
