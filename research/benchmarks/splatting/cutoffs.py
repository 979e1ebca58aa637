"""Time saved by leaving out faint contributions, and the error in the image."""

from __future__ import annotations

from dataclasses import replace

from research.benchmarks.page import table
from research.benchmarks.splatting.drawing import ERROR_HEADER, TIMES, DrawingMeasurement, measure
from research.benchmarks.splatting.figures import panels, with_labels
from research.benchmarks.splatting.reference_patches import draw_patches
from research.benchmarks.splatting.setup import Setup
from research.benchmarks.splatting.trained import TrainedModels
from research.benchmarks.splatting.workloads import FIXED, View
from research.benchmarks.timing import digits

FLOORS = {"1/64": 1 / 64, "1/128": 1 / 128, "1/255": 1 / 255, "1/1024": 1 / 1024, "1e-4": 1e-4}
ALL = 1e-9  # effectively no floor: 20,000 such contributions are 2e-5 together
FIGURE = "splatting_cutoffs.png"


def cutoffs(setup: Setup, trained: TrainedModels) -> str:
    """Alpha floors on the fixed scene and on a trained model, against a reference without a floor."""
    cases = {FIXED.title: FIXED.view(), f"model of {trained.name}": trained.view()}
    results = {name: _measured(name, view, setup) for name, view in cases.items()}
    with panels(setup.output / FIGURE, height=3.6) as axes:
        for style, (name, by_floor) in enumerate(results.items()):
            points = [(drawn.both.median, drawn.image.decibels, label) for label, (drawn, _) in by_floor.items()]
            with_labels(axes, points, style, name)
        axes.set(xlabel="forward + backward, ms (one thread)", ylabel="PSNR against no floor, dB")
        axes.set_xlim(left=0)
        axes.margins(y=0.1)
        axes.legend(loc="lower right")
    rows = [
        [name, label, digits(pairs), *drawn.times(), *drawn.error_cells()]
        for name, by_floor in results.items()
        for label, (drawn, pairs) in by_floor.items()
    ]
    return table(["scene", "alpha floor", "pairs, M", *TIMES, *ERROR_HEADER], rows)


def _measured(name: str, view: View, setup: Setup) -> dict[str, tuple[DrawingMeasurement, float]]:
    """By floor: the drawing, and millions of pairs."""
    everything = draw_patches(_with_floor(view, ALL), setup.patches)
    results = {}
    for label, floor in FLOORS.items():
        setup.say(f"{name}: alpha floor {label}")
        seen = _with_floor(view, floor)
        counted = draw_patches(seen, setup.patches, gradients=False).counted
        pairs = counted.interactions / counted.pixels * view.camera.width * view.camera.height / 1e6
        results[label] = measure(seen, everything, setup.seconds, threads=1), pairs
    return results


def _with_floor(view: View, floor: float) -> View:
    return view._replace(constants=replace(view.constants, alpha_floor=floor))
