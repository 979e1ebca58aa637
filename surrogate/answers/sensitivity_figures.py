"""Figures of what matters."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from surrogate.answers.figures import save
from surrogate.answers.sensitivity import Sensitivity
from surrogate.answers.sobol import SobolIndices

COLUMNS = 4
Array = NDArray[Any]

PANEL = 2.3  # inches
BRIGHTEST = 99.5  # percentile of the maps' pixels that has the last colour


def save_sensitivity(answer: Sensitivity, path: Path) -> None:
    """Draw the picture, each parameter's map on one colour scale, and bars for the view and the region."""
    from matplotlib.figure import Figure
    from matplotlib.patches import Rectangle

    count = len(answer.space)
    columns = min(count + 1, COLUMNS)
    rows = -(-(count + 1) // columns)
    figure = Figure(figsize=(PANEL * columns + 3.8, (PANEL + 0.6) * rows + 0.8), layout="constrained")
    parts: Any = figure.subfigures(1, 2, width_ratios=(PANEL * columns, 3.8))
    left, right = parts
    axes = left.subplots(rows, columns, squeeze=False).ravel()
    axes[0].imshow(answer.picture, interpolation="nearest")
    axes[0].set_title("\n".join(["picture", *_place(answer)]), fontsize=8)
    brightest = float(np.percentile(answer.magnitudes, BRIGHTEST)) or 1.0
    for j, (parameter, magnitude) in enumerate(zip(answer.space.parameters, answer.magnitudes, strict=True), start=1):
        heat = axes[j].imshow(magnitude, cmap="magma", vmin=0.0, vmax=brightest, interpolation="nearest")
        range_ = f"{parameter.text(parameter.low)} to {parameter.text(parameter.high)} {parameter.unit}".rstrip()
        agreement = None if answer.agreements is None else answer.agreements[j - 1]
        lines = [parameter.name, range_ + (", log" if parameter.scale == "log" else "")]
        if agreement is not None:
            lines.append("hardly changes" if np.isnan(agreement) else f"predictions agree {agreement:.2f}")
        axes[j].set_title("\n".join(lines), fontsize=8)
    for axis in axes:
        axis.set_axis_off()
        if answer.region is not None and axis.images:
            x0, y0, x1, y1 = answer.region
            frame = Rectangle((x0 - 0.5, y0 - 0.5), x1 - x0, y1 - y0, fill=False, edgecolor="tab:cyan", linewidth=1.2)
            axis.add_patch(frame)
    bar = left.colorbar(heat, ax=list(axes), extend="max", location="bottom", shrink=0.5, aspect=40)
    bar.set_label("change of colour over the parameter's range, at the rate here (black to white = 1)", fontsize=8)
    bar.ax.tick_params(labelsize=8)
    series: dict[str, tuple[Array, Array | None]] = {"whole view": (answer.of_view, None)}
    if answer.of_region is not None:
        series["marked region"] = (answer.of_region, None)
    _bars(right.subplots(), answer.space.names, series, "mean change of colour (black to white = 1)")
    save(figure, path)


def save_indices(answer: SobolIndices, path: Path) -> None:
    """Draw total and first indices with 95 % intervals, and the field's length scales beside them."""
    from matplotlib.figure import Figure

    lengths = answer.response.lengths
    figure = Figure(figsize=(9.0, 1.8 + 0.5 * len(answer.space)), layout="constrained")
    axis, *beside = figure.subplots(1, 1 if lengths is None else 2, squeeze=False, sharey=True)[0]
    series = {
        "with others (total index)": (answer.total, answer.total_half),
        "alone (first index)": (answer.first, answer.first_half),
    }
    order = _bars(axis, answer.space.names, series, "share of the variance, with 95 % intervals")
    axis.set_title(f"Variance of the {answer.response.words}", fontsize=10)
    if lengths is not None:
        beside[0].plot(lengths[order], np.arange(len(order)), "D", color="tab:green")
        beside[0].set_xscale("log")
        beside[0].xaxis.set_major_formatter("{x:g}")
        beside[0].xaxis.set_minor_formatter("{x:g}")
        beside[0].tick_params(axis="x", which="both", labelsize=8)
        beside[0].set_xlabel("length scale (ranges of the parameter)")
        beside[0].set_title("Length scales: short where the field changes fast", fontsize=10)
        beside[0].grid(alpha=0.3, which="both")
    source = f"by the {answer.response.source}; " if answer.response.source else ""
    figure.supxlabel(f"{source}parameters {answer.distribution}", fontsize=8)
    save(figure, path)


def _bars(axis: Any, names: Sequence[str], series: Mapping[str, tuple[Array, Array | None]], label: str) -> Array:
    """Bars of each name, the longest of the first series on top; returns the names' order from top to bottom."""
    order = np.argsort(-next(iter(series.values()))[0], kind="stable")
    height = 0.8 / len(series)
    for i, (name, (values, halves)) in enumerate(series.items()):
        places = np.arange(len(names)) + (i - (len(series) - 1) / 2.0) * height
        errors = None if halves is None else halves[order]
        axis.barh(places, values[order], height, xerr=errors, label=name, error_kw={"elinewidth": 1.0, "capsize": 2.0})
    axis.set_yticks(range(len(names)), labels=[names[j] for j in order])
    axis.set_ylim(len(names) - 0.4, -0.6)
    axis.set_xlabel(label)
    axis.grid(alpha=0.3, axis="x")
    axis.set_axisbelow(True)
    axis.legend(fontsize=8, loc="lower right")
    return order


def _place(answer: Sensitivity) -> list[str]:
    """The parameters of an answer, two a line."""
    texts = []
    for name, value in answer.parameters.items():
        parameter = next((p for p in answer.space.parameters if p.name == name), None)
        texts.append(
            f"{name} = {value}"
            if parameter is None
            else f"{name} = {parameter.text(float(value), 3)} {parameter.unit}".rstrip()
        )
    return [", ".join(texts[i : i + 2]) for i in range(0, len(texts), 2)]
