"""Figures of answers, which need no explaining."""

from __future__ import annotations

import io
import textwrap
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from catalogs.files import durable
from catalogs.vocabulary.numbers import text

if TYPE_CHECKING:
    from surrogate.answers.next_runs import NextRuns

RESOLUTION = 130  # dots an inch
LEAST_ERROR = 1.0 / 255.0  # at the end of a map's colours


def save_next_runs(suggested: NextRuns, path: Path) -> None:
    """Draw the learning curve, and members with their errors and suggested runs over the two fastest parameters."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(9.0, 4.2), layout="constrained")
    left, right = figure.subplots(1, 2)
    _curve(suggested, left)
    _plane(suggested, right)
    save(figure, path)


def save_sure(
    picture: NDArray[np.float32], errors: NDArray[np.float32], sentence: str, parameters: Mapping[str, Any], path: Path
) -> None:
    """Draw a picture (H, W, 3) beside the map of its expected errors (H, W), under the sentence about it."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(8.6, 4.8), layout="constrained")
    named = ", ".join(
        f"{name} = {value if isinstance(value, str) else text(value)}" for name, value in parameters.items()
    )
    figure.suptitle("\n".join(textwrap.wrap(sentence, 100)), fontsize=10)
    left, right = figure.subplots(1, 2)
    left.imshow(np.clip(picture, 0.0, 1.0))
    left.set_title("picture", fontsize=9)
    colored = right.imshow(errors, cmap="magma_r", vmin=0.0, vmax=max(float(np.quantile(errors, 0.995)), LEAST_ERROR))
    right.set_title("where it may be wrong", fontsize=9)
    figure.colorbar(colored, ax=right, shrink=0.8, label="difference between predictions (colours from 0 to 1)")
    figure.supxlabel("\n".join(textwrap.wrap(named, 110)), fontsize=8)
    for axis in (left, right):
        axis.set_xticks([])
        axis.set_yticks([])
    save(figure, path)


def save(figure: Any, path: Path) -> None:
    """Write a figure in the format that the path's suffix names; raises ValueError for one that matplotlib can't write."""
    picture = io.BytesIO()
    figure.savefig(picture, format=path.suffix.removeprefix(".") or "png", dpi=RESOLUTION)
    durable.replace(path, picture.getvalue())


def _curve(suggested: NextRuns, axis: Any) -> None:
    curve = suggested.curve
    axis.set(xlabel="members learnt from", ylabel="accuracy of the emulated field (dB)", title="More runs")
    if curve is None:
        axis.text(0.5, 0.5, suggested.why_no_curve, ha="center", va="center", wrap=True, transform=axis.transAxes)
        return
    means = np.nanmean(curve.decibels, axis=1)  # [S]
    axis.plot(curve.sizes, means, "o", color="tab:blue", label="measured, with members left out")
    slope, _, _ = curve.line
    level = means.mean() - slope * np.log(curve.sizes).mean()
    more = np.arange(1, max(2 * curve.members, len(suggested.runs)) + 1)
    gains = [curve.gain(int(m)) for m in more]
    now = level + slope * np.log(curve.members)
    x = curve.members + more
    axis.plot(x, [now + g.decibels for g in gains], color="tab:orange", label="expected")
    axis.fill_between(
        x, [now + g.low for g in gains], [now + g.high for g in gains], color="tab:orange", alpha=0.2, label="90 %"
    )
    axis.axvline(curve.members, color="gray", linestyle="--", linewidth=1)
    axis.set_xscale("log")
    axis.set_xticks([], minor=True)
    axis.set_xticks(ticks := sorted({*curve.sizes.tolist(), curve.members, int(x[-1])}), labels=map(str, ticks))
    axis.grid(alpha=0.3)
    axis.legend(fontsize=8, loc="lower right")


def _plane(suggested: NextRuns, axis: Any) -> None:
    parameters = suggested.space.parameters
    by_length = range(len(parameters)) if suggested.lengths is None else np.argsort(suggested.lengths)
    first, second = [*by_length, *by_length][:2]
    names = parameters[first].name, parameters[second].name
    places = np.array([[at[n] for n in names] for at in suggested.members.values()])  # [M, 2]
    errors = np.array([100.0 * suggested.errors.get(name, np.nan) for name in suggested.members])  # [M]
    axis.plot(*places[np.isnan(errors)].T, ".", color="gray", label="members")
    if np.isfinite(errors).any():
        measured = np.isfinite(errors)
        order = np.argsort(errors[measured])  # the worst on top
        colored = axis.scatter(
            *places[measured][order].T, c=errors[measured][order], cmap="viridis", label="members, by their error"
        )
        axis.figure.colorbar(colored, ax=axis, label="error without it (% of the spread)")
    axis.plot(*suggested.runs[:, [first, second]].T, "+", color="tab:red", markersize=10, label="suggested")
    axis.set(
        xlabel=parameters[first].label,
        ylabel=parameters[second].label,
        xscale=parameters[first].scale,
        yscale=parameters[second].scale,
        title="Where",
    )
    axis.legend(fontsize=8, loc="upper center", bbox_to_anchor=(0.5, -0.14), ncols=3, frameon=False)
