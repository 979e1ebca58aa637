"""Plots that read on light and on dark pages: on a white card, with colours that differ in lightness too."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from io import BytesIO
from pathlib import Path
from typing import Any

from catalogs.files import durable
from research.benchmarks.timing import MeasuredTime

COLORS = ("#0b5fa5", "#e07b00", "#2a9d57", "#a0346e", "#555555")
MARKERS = ("o", "s", "D", "^", "v")


@contextmanager
def panels(path: Path, count: int = 1, *, width: float = 5.2, height: float = 3.8) -> Iterator[Any]:
    """Axes to draw on, `count` side by side; the plot is written whole, as PNG, when the block ends."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot

    style = {
        "font.size": 9,
        "axes.grid": True,
        "grid.alpha": 0.3,
        "axes.spines.top": False,
        "axes.spines.right": False,
        "axes.titlesize": 10,
        "legend.frameon": False,
        "legend.fontsize": 8,
    }
    with pyplot.rc_context(style):
        figure, axes = pyplot.subplots(
            1, count, figsize=(width * count, height), constrained_layout=True, squeeze=False
        )
        try:
            yield axes[0] if count > 1 else axes[0][0]
            content = BytesIO()
            figure.savefig(content, format="png", dpi=120, facecolor="white")
            durable.replace(path, content.getvalue())
        finally:
            pyplot.close(figure)


def plain_ticks(axis: Any) -> None:
    """Tick labels of a logarithmic axis (`axes.xaxis`) as plain numbers, at 1, 2 and 5 of each decade."""
    from matplotlib import ticker

    axis.set_major_locator(ticker.LogLocator(subs=(1.0, 2.0, 5.0)))
    axis.set_major_formatter(ticker.FuncFormatter(lambda value, _: f"{value:,g}"))
    axis.set_minor_formatter(ticker.NullFormatter())


def with_labels(axes: Any, points: Iterable[tuple[float, float, str]], style: int, label: str) -> None:
    """A line through (x, y, text), with the texts beside its points; `style` chooses colour and marker."""
    x, y, texts = zip(*points, strict=True)
    axes.plot(x, y, MARKERS[style] + "-", color=COLORS[style], markersize=4, label=label)
    for place in zip(texts, zip(x, y, strict=True), strict=True):
        axes.annotate(*place, xytext=(5, -9), textcoords="offset points", fontsize=7)


def with_spread(axes: Any, x: Any, taken: list[MeasuredTime], style: int, *, line: str = "-", **options: Any) -> None:
    """Medians as points, the fastest and slowest as bars; `style` chooses colour and marker."""
    medians = [m.median for m in taken]
    spread = [[m.median - m.lowest for m in taken], [m.highest - m.median for m in taken]]
    axes.errorbar(
        x,
        medians,
        spread,
        fmt=MARKERS[style] + line,
        color=COLORS[style],
        markersize=4,
        capsize=2,
        elinewidth=0.8,
        **options,
    )
