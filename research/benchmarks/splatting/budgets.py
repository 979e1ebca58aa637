"""One trained model rendered with its most important Gaussians alone, without further training."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import torch
from torch import Tensor

from research.benchmarks.page import table
from research.benchmarks.splatting.figures import panels, with_labels
from research.benchmarks.splatting.reference_patches import decibels
from research.benchmarks.splatting.setup import Setup, limited_to
from research.benchmarks.splatting.trained import TrainedModels, pictures
from research.benchmarks.timing import MeasuredTime, timed
from surrogate.evaluation.metrics import composite, psnr
from surrogate.training.compression.choices import importance
from surrogate.training.data import ImageRow, load_examples, training_rows

PARTS = (1.0, 0.5, 0.25, 0.12)
FIGURE = "splatting_budgets.png"
WEIGHED, JUDGED = 200, 60  # training images for importance, validation images that are rendered
REPEATS = 3


def budgets(setup: Setup, trained: TrainedModels) -> str:
    """Time and error by the fraction of the Gaussians that is rendered, and the plot."""
    few = 20 if setup.quick else 1
    learned = training_rows(trained.catalog, [str(trained.model.training["appearance"])])
    setup.say(f"{trained.name}: the importance of each Gaussian")
    weights = _importance(trained, learned[:: max(1, len(learned) * few // WEIGHED)])
    rows = trained.validation(JUDGED // few)
    results = {part: _drawn(trained, rows, weights, part) for part in PARTS}
    with panels(setup.output / FIGURE, height=3.6) as axes:
        for style, name in enumerate(("the stored images", "the whole model")):
            said = {part: f"{100 * part:.0f} %" if style == 0 else "" for part in PARTS}
            points = [(taken.median, errors[style], said[part]) for part, (taken, *errors) in results.items()]
            with_labels(axes, [point for point in points if np.isfinite(point[1])], style, f"against {name}")
        axes.set(xlabel="ms per picture (one thread)", ylabel="PSNR, dB")
        axes.set_title(f"{trained.name}: part of the Gaussians drawn")
        axes.set_xlim(left=0)
        axes.margins(y=0.12)
        axes.legend()
    total = float(weights.sum())
    cells = []
    for part, (taken, truth, whole) in results.items():
        indices = _kept(weights, part)
        share = f"{100 * float(weights[indices].sum()) / total:.2f} %"
        same = f"{whole:.1f}" if np.isfinite(whole) else "the same"
        cells.append([f"{100 * part:.0f} %", f"{len(indices):,}", share, str(taken), same, f"{truth:.2f}"])
    header = ["drawn", "Gaussians", "of all weight", "ms per picture", "PSNR against the whole model, dB"]
    camera = trained.catalog.members[0].cameras[0]
    size = f"{camera.width} x {camera.height}"
    note = f"{trained.name}, {len(rows)} validation images of {size}, one thread.\n\n"
    return note + table([*header, "PSNR against the stored images, dB"], cells)


def _importance(trained: TrainedModels, rows: Sequence[ImageRow]) -> Tensor:
    """Contribution of each Gaussian of the model to the images of `rows`, (N,)."""
    model = trained.model
    examples = load_examples(trained.catalog, rows, model.normalization)
    return importance(lambda p: model.deformation.deformed(model.gaussians, p), examples, model.rasterizer)


def _kept(weights: Tensor, part: float) -> Tensor:
    """Indices of the most important Gaussians, in their old order."""
    count = max(1, round(part * len(weights)))
    return torch.argsort(weights, descending=True, stable=True)[:count].sort().values


def _drawn(
    trained: TrainedModels, rows: Sequence[ImageRow], weights: Tensor, part: float
) -> tuple[MeasuredTime, float, float]:
    """Time per picture, mean PSNR against the stored images, and against the whole model (inf where nothing differs)."""
    indices = _kept(weights, part)
    taken, to_truth, to_whole = [], [], []
    with limited_to(1):
        for row, whole, camera in pictures(trained.model, rows):
            some = replace(whole, gaussians=whole.gaussians.of(indices))
            taken.append(min(timed(lambda s=some, c=camera: s.render(c)) for _ in range(REPEATS)))
            picture = composite(some.render(camera), trained.background)
            difference = picture.astype(np.float64) - composite(whole.render(camera), trained.background)
            to_truth.append(psnr(trained.truth(row), picture))
            to_whole.append(float(np.mean(np.square(difference))))
    return MeasuredTime.of(taken), float(np.mean(to_truth)), decibels(float(np.mean(to_whole)))
