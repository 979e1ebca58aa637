"""How much each approximation of splatting changes the pictures of a fitted model, beside that model's error."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.fidelity.fitting import Subject
from benchmarks.fidelity.rules import differences, pictures
from surrogate.evaluation.metrics import decibels
from surrogate.gaussians import Gaussians
from surrogate.rasterizer import Rasterizer
from surrogate.settings import TrainingSettings
from surrogate.training.data import Example

VIEWS = 4
PIXELS = 192  # of each view, where there is something to see


def study(subject: Subject, gaussians: Gaussians, settings: TrainingSettings) -> dict[str, Any]:
    """Mean differences over some validation views, in dB, and the model's own error at the same pixels."""
    found = []
    for example in _spread(subject.examples["validation"], VIEWS):
        pixels = _shown(example, subject.background)
        drawn = pictures(gaussians, example.camera, Rasterizer.of(settings), pixels)
        truth = example.pixels[pixels[:, 1], pixels[:, 0]] / 255.0  # [P, 3 or 4]
        channels = truth.shape[1]
        error = decibels(float(np.mean((drawn["drawn"][:, :channels] - truth) ** 2)))
        found.append({"error": error, **differences(drawn)})
    return {name: float(np.mean([one[name] for one in found])) for name in found[0]}


def _spread(examples: Any, count: int) -> list[Example]:
    return [examples[i] for i in np.linspace(0, len(examples) - 1, count).astype(int)]


def _shown(example: Example, background: tuple[float, float, float] | None) -> NDArray[np.int64]:
    """(P, 2) columns and rows of pixels that show something, drawn by a fixed seed."""
    pixels = example.pixels / 255.0
    shown = pixels[..., 3] > 0 if background is None else np.abs(pixels - np.array(background)).max(axis=2) > 0.01
    rows, columns = np.nonzero(shown)
    drawn = np.random.default_rng(0).choice(len(rows), min(PIXELS, len(rows)), replace=False)
    return np.stack([columns[drawn], rows[drawn]], axis=1)
