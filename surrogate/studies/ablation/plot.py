"""Every seed of every variant as a dot."""

from __future__ import annotations

from collections.abc import Sequence
from io import BytesIO

from surrogate.studies.ablation.comparison import Row
from surrogate.studies.ablation.variants import DEFAULT

WIDTH_INCHES, ROW_INCHES = 8.0, 0.26
RESOLUTION = 130
SURE_COLOR, OTHER_COLOR, DEFAULT_COLOR = "tab:red", "0.45", "tab:blue"


def plot(rows: Sequence[Row]) -> bytes | None:
    """A PNG file: PSNR over variants, the best on top, a bar at each mean; None where nothing has a result."""
    import matplotlib

    matplotlib.use("agg")
    from matplotlib.figure import Figure

    shown = [row for row in rows if row.results]
    if not shown:
        return None
    figure = Figure(figsize=(WIDTH_INCHES, 1.2 + ROW_INCHES * len(shown)), layout="constrained")
    axes = figure.add_subplot()
    for place, row in enumerate(shown):
        color = DEFAULT_COLOR if row.variant.name == DEFAULT else SURE_COLOR if row.is_sure else OTHER_COLOR
        axes.plot([r.psnr for r in row.results], [place] * len(row.results), "o", color=color, markersize=4, alpha=0.8)
        axes.plot([row.mean("psnr")], [place], "|", color=color, markersize=11, markeredgewidth=1.5)
        if row.variant.name == DEFAULT:
            axes.axvline(row.mean("psnr"), color=color, linewidth=0.8, alpha=0.6, zorder=0)
    axes.set_yticks(range(len(shown)), [row.variant.name for row in shown], fontsize=8)
    axes.set_ylim(len(shown) - 0.5, -0.5)
    axes.grid(axis="x", linewidth=0.4, alpha=0.5)
    axes.set_xlabel("PSNR of validation images, dB", fontsize=9)
    axes.set_title("a dot per seed, a bar at their mean; red: differs by more than two standard errors", fontsize=8)
    content = BytesIO()
    figure.savefig(content, format="png", dpi=RESOLUTION, facecolor="white")
    return content.getvalue()
