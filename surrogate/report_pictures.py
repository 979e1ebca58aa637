"""The report's pictures: comparisons at the best, median and worst test images, curves, and errors by parameter."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from catalogs.catalog import Catalog
from surrogate.evaluate import PARAMETERS, VIEWS, Evaluation, Scored
from surrogate.metrics import WHITE, composite
from surrogate.model import Surrogate

DIFFERENCE_SCALE = 0.2  # the colour bar's end: an error of this much in some channel
RESOLUTION = 130


def draw(directory: Path, surrogate: Surrogate, catalog: Catalog, evaluation: Evaluation) -> dict[str, str]:
    """Write PNG files into `directory`; returns titles and file names in the report's order."""
    import matplotlib

    matplotlib.use("agg")
    candidates: dict[str, tuple[str, Callable[[Any], bool]]] = {
        "Truth, prediction and difference": (
            "comparison.png",
            lambda f: _comparison(f, surrogate, catalog, evaluation),
        ),
        "Training": ("curves.png", lambda f: _curves(f, surrogate)),
        "Error by parameter": ("parameters.png", lambda f: _parameters(f, evaluation)),
        "Spread over images": ("spread.png", lambda f: _spread(f, evaluation)),
    }
    return {title: name for title, (name, plot) in candidates.items() if _save(directory / name, plot)}


def _save(path: Path, plot: Callable[[Any], bool]) -> bool:
    from matplotlib.figure import Figure

    figure = Figure(figsize=(9.0, 4.2), layout="constrained")
    drawn = plot(figure)
    if drawn:
        figure.savefig(path, dpi=RESOLUTION)
    return drawn


def _hardest_cell(evaluation: Evaluation) -> tuple[str, list[Scored]]:
    """The test images that ask most of the surrogate: unseen both ways if there are such."""
    for views in ("unseen_views", "seen_views"):
        for parameters in ("unseen_parameters", "seen_parameters"):
            scored = list(evaluation.cells[views][parameters])
            if scored:
                return f"{views.replace('_', ' ')}, {parameters.replace('_', ' ')}", scored
    return "validation", list(evaluation.validation)


def _comparison(figure: Any, surrogate: Surrogate, catalog: Catalog, evaluation: Evaluation) -> bool:
    label, scored = _hardest_cell(evaluation)
    if not scored:
        return False
    ordered = sorted(scored, key=lambda s: s.score.psnr)
    cases = {"worst": ordered[0], "median": ordered[len(ordered) // 2], "best": ordered[-1]}
    figure.set_size_inches(9.0, 9.6)
    axes = figure.subplots(len(cases), 3, squeeze=False)
    shown = None
    for row, (name, case) in zip(axes, cases.items(), strict=True):
        background = catalog.plan.background
        truth = catalog.image(case.target.member, str(surrogate.training["appearance"]), case.target.view)
        picture = surrogate.at(**case.target.member.parameters).render(case.target.camera, background=background)
        pair = [composite(image, background or WHITE) for image in (truth, picture)]
        difference = np.abs(pair[0] - pair[1]).max(axis=-1)  # [H, W]
        at = ", ".join(f"{key} = {value:g}" for key, value in case.target.member.parameters.items())
        row[0].set_ylabel(f"{name}: {case.score.psnr:.1f} dB\nview {case.target.view}", fontsize=10)
        row[0].set_title(f"truth\n{at}" if len(at) < 40 else "truth", fontsize=9)
        row[1].set_title("prediction", fontsize=9)
        row[2].set_title("largest difference of a channel", fontsize=9)
        row[0].imshow(pair[0])
        row[1].imshow(pair[1])
        shown = row[2].imshow(difference, cmap="magma", vmin=0.0, vmax=DIFFERENCE_SCALE)
        for axis in row:
            axis.set_xticks([])
            axis.set_yticks([])
    figure.colorbar(shown, ax=axes[:, 2], fraction=0.05, extend="max", label="absolute difference (colours in [0, 1])")
    figure.suptitle(f"{label.capitalize()}: {len(scored)} images", fontsize=11)
    return True


def _curves(figure: Any, surrogate: Surrogate) -> bool:
    curve = surrogate.training["curve"]
    if len(curve) < 2:
        return False
    steps = [point["step"] for point in curve]
    left, right = figure.subplots(1, 2)
    left.semilogy(steps, [point["loss"] for point in curve], color="tab:blue")
    left.set(xlabel="step", ylabel="training loss (L1 + SSIM)", title="Loss")
    right.plot(steps, [np.nan if p["psnr"] is None else p["psnr"] for p in curve], color="tab:orange")
    right.set(xlabel="step", ylabel="PSNR of validation images (dB)", title="Validation")
    change = next((p["step"] for p in reversed(curve) if p["stage"] == "canonical"), None)
    for axis in (left, right):
        axis.grid(alpha=0.3)
        if change is not None:
            axis.axvline(change, color="gray", linewidth=1, linestyle="--")
            axis.text(change, axis.get_ylim()[0], " deformation →", fontsize=8, color="gray", va="bottom")
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
