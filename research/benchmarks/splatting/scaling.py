"""Scaling of time with the number of Gaussians and with the size of the image."""

from __future__ import annotations

from typing import Any

from research.benchmarks.page import table
from research.benchmarks.splatting.drawing import ERROR_HEADER, TIMES, DrawingMeasurement, measure
from research.benchmarks.splatting.figures import panels, plain_ticks, with_spread
from research.benchmarks.splatting.reference_patches import InteractionCounts, draw_patches
from research.benchmarks.splatting.setup import Setup, said
from research.benchmarks.splatting.workloads import FIXED, Workload, thousands

COUNTS = (1_000, 3_000, 10_000, 30_000, 100_000, 300_000, 1_000_000)
SIZES = (128, 256, 512, 1024)
FIGURE = "splatting_scaling.png"

Series = dict[tuple[int, int], tuple[DrawingMeasurement, InteractionCounts]]  # by (Gaussians or size, threads)


def scaling(setup: Setup) -> str:
    """Both tables and the plot."""
    counts, sizes = (COUNTS[:3], SIZES[:2]) if setup.quick else (COUNTS, SIZES)
    by_count = _series({count: FIXED.at_size(512).with_count(count) for count in counts}, setup)
    by_size = _series({size: FIXED.at_size(size) for size in sizes}, setup)
    with panels(setup.output / FIGURE, 2) as axes:
        _plot(axes[0], by_count, setup, "Gaussians in a 512² picture")
        _plot(axes[1], by_size, setup, "size of the picture of 20k Gaussians")
        axes[0].set_xticks(counts, [thousands(count) for count in counts])
        axes[1].set_xticks(sizes, [f"{size}²" for size in sizes])
        for panel in axes:
            panel.xaxis.minorticks_off()
            plain_ticks(panel.yaxis)
    return "\n".join(
        [
            "Gaussians in a 512² picture (the more, the smaller: together they always fill the same volume):\n",
            _table("Gaussians", by_count),
            "Size of the picture, the fixed scene:\n",
            _table("size", by_size),
        ]
    )


def _series(workloads: dict[int, Workload], setup: Setup) -> Series:
    series: Series = {}
    for number, workload in workloads.items():
        setup.say(workload.title)
        view = workload.view()
        exact = draw_patches(view, setup.patches)
        for threads in setup.threads:
            drawn = measure(view, exact, setup.seconds / 2, threads=threads)
            series[number, threads] = drawn, exact.counted
    return series


def _table(what: str, series: Series) -> str:
    rows = []
    for (number, threads), (drawn, counted) in series.items():
        name = f"{number}²" if what == "size" else f"{number:,}"
        rows.append([name, str(threads), f"{counted.depth:.0f}", *drawn.times(), *drawn.error_cells()])
    return table([what, "threads", "per covered pixel", *TIMES, *ERROR_HEADER], rows)


def _plot(axes: Any, series: Series, setup: Setup, label: str) -> None:
    for pass_index, name in enumerate(("forward", "backward")):
        for threads in setup.threads:
            points = {number: getattr(drawn, name) for (number, t), (drawn, _) in series.items() if t == threads}
            line = "-" if threads == 1 else "--"
            with_spread(
                axes, list(points), list(points.values()), pass_index, line=line, label=f"{name}, {said(threads)}"
            )
    axes.set(xscale="log", yscale="log", xlabel=label, ylabel="ms")
    axes.legend()
