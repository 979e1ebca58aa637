"""Figures of which parameters draw pictures."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from surrogate.answers.figures import save
from surrogate.answers.posterior import Inverse
from surrogate.answers.targets import Target
from surrogate.evaluation.metrics import WHITE, composite
from surrogate.model import Surrogate

MOST = 3  # pictures that are drawn
PANEL = 2.2  # inches
LEAST_SCALE = 0.05  # the difference, of colours from 0 to 1, that is at least the last colour


def save_inverse(
    answer: Inverse,
    surrogate: Surrogate,
    targets: Sequence[Target],
    background: Sequence[float] | None,
    path: Path,
) -> None:
    """Draw each picture beside the surrogate's at the best solution and their difference, and intervals over the ranges."""
    from matplotlib.figure import Figure

    some = list(zip(targets, answer.cameras[0], strict=True))[:MOST]
    height = max(PANEL * len(some) + 0.9, 0.62 * len(answer.parameters) + 1.1)
    figure = Figure(figsize=(PANEL * 3.0 * bool(some) + 6.0, height), layout="constrained")
    right: Any = figure
    if some:
        parts: Any = figure.subfigures(1, 2, width_ratios=(PANEL * 3.0, 6.0))
        left, right = parts
        axes = left.subplots(len(some), 3, squeeze=False)
        for row, (target, camera) in zip(axes, some, strict=True):
            rgba = surrogate.at(answer.values, outside="allow").render(camera)
            _pictures(row, target, composite(rgba, background or WHITE), left)
        for axis, title in zip(axes[0], ("the picture", "best by surrogate", "difference"), strict=True):
            axis.set_title(title, fontsize=9)
    _intervals(answer, surrogate, right.subplots())
    if answer.foreign:
        figure.suptitle(answer.sentences[0], color="tab:red", fontsize=9, wrap=True)
    save(figure, path)


def _pictures(row: Any, target: Target, best: Any, figure: Any) -> None:
    difference = np.abs(best - target.picture).max(-1)  # [H, W]
    row[0].imshow(target.picture, interpolation="nearest")
    row[1].imshow(np.clip(best, 0.0, 1.0), interpolation="nearest")
    most = max(LEAST_SCALE, float(difference.max()))
    heat = row[2].imshow(difference, cmap="magma", vmin=0.0, vmax=most, interpolation="nearest")
    bar = figure.colorbar(heat, ax=row[2], shrink=0.7)
    bar.ax.tick_params(labelsize=7)
    bar.set_label("of colours from 0 to 1", fontsize=7)
    for axis in row:
        axis.set_axis_off()
        if target.mask is not None:
            axis.contour(target.mask, levels=[0.5], colors="tab:cyan", linewidths=1.0)


def _intervals(answer: Inverse, surrogate: Surrogate, axis: Any) -> None:
    """Of each parameter a line over its range, the interval thick on it, grey where pictures do not show it."""
    labels = []
    for place, (parameter, one, ends) in enumerate(
        zip(surrogate.space.parameters, answer.parameters, answer.normalized, strict=True)
    ):
        color = "tab:blue" if one.identified else "silver"
        axis.plot([0.0, 1.0], [place, place], color="gainsboro", linewidth=1.0, zorder=0)
        low, high = ((end + 1.0) / 2.0 for end in ends)
        axis.plot([low, high], [place, place], color=color, linewidth=7.0, solid_capstyle="butt")
        others = [float(parameter.fraction(solution[one.name])) for solution in answer.solutions]
        axis.plot(others[1:], [place] * (len(others) - 1), "o", color="white", markeredgecolor="black", markersize=5)
        axis.plot(others[0], place, "o", color="black", markersize=5)
        text = f"{parameter.text(one.value)}  ({parameter.text(one.low)} to {parameter.text(one.high)})"
        axis.text(0.0, place - 0.22, parameter.text(parameter.low), fontsize=7, color="gray", va="bottom")
        axis.text(1.0, place - 0.22, parameter.text(parameter.high), fontsize=7, color="gray", va="bottom", ha="right")
        axis.text(1.04, place, text if one.identified else f"{text}\nnot shown", fontsize=8, va="center")
        unit = f" ({parameter.unit})" if parameter.unit else ""
        labels.append(parameter.name + unit + (", log" if parameter.scale == "log" else ""))
    axis.set_yticks(range(len(labels)), labels=labels, fontsize=9)
    axis.set(xlim=(-0.02, 1.7), ylim=(len(labels) - 0.4, -0.6), xticks=[])
    axis.spines[:].set_visible(False)
    axis.tick_params(left=False)
    several = "; circles: other solutions" if len(answer.solutions) > 1 else ""
    axis.set_title(f"90 % intervals over each range (dot: best{several})", fontsize=9, loc="left")
