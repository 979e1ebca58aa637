"""Sheets of truth, prediction and difference, a row for each image, with the worst part of each enlarged."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from catalogs.store.catalog import Catalog
from catalogs.vocabulary.parameters import Parameter
from surrogate.evaluation.metrics import WHITE, composite
from surrogate.evaluation.scoring import Scored
from surrogate.model import Surrogate

DIFFERENCE_FACTOR = 4.0
LARGEST_WINDOW = 64  # pixels; and no more than a quarter of a side, or little would be enlarged
ROW_INCHES, WIDTH_INCHES = 2.5, 11.0


def chosen(scored: Sequence[Scored], names: Sequence[str]) -> dict[str, Scored]:
    """The "worst", "median" and "best" image by PSNR, those of them that are named."""
    ordered = sorted(scored, key=lambda s: s.score.psnr)
    places: Mapping[str, int] = {"worst": 0, "median": len(ordered) // 2, "best": -1}
    return {name: ordered[places[name]] for name in names}


def draw_sheet(figure: Any, title: str, images: Mapping[str, Scored], surrogate: Surrogate, catalog: Catalog) -> None:
    """Draw a row for each of the images, by what they are called, into a figure, which is sized to hold them."""
    figure.set_size_inches(WIDTH_INCHES, ROW_INCHES * len(images) + 0.5)
    grid = figure.subplots(len(images), 5, squeeze=False)
    spaces = surrogate.space, *(v.space for v in surrogate.variations)
    parameters = {p.name: p for space in spaces for p in space.parameters}
    for axes, (name, scored) in zip(grid, images.items(), strict=True):
        case, background = scored.target, catalog.plan.background
        truth = catalog.image(case.member, case.appearance, case.view)
        prediction = surrogate.at(case.parameters).render(case.camera, background=background)
        _draw_row(
            axes,
            _place(case.parameters, parameters),
            *(composite(image, background or WHITE) for image in (truth, prediction)),
        )
        axes[0].set_ylabel(f"{name}: {scored.score.psnr:.1f} dB\nview {case.view}", fontsize=9)
    figure.suptitle(title, fontsize=11)


def _draw_row(axes: Sequence[Any], title: str, truth: NDArray[np.float32], prediction: NDArray[np.float32]) -> None:
    """Pictures (H, W, 3) with values in [0, 1]: whole, their difference, and the window where they differ most."""
    from matplotlib.patches import Rectangle

    top, left, size = worst_window(truth, prediction)
    part = np.s_[top : top + size, left : left + size]
    difference = np.clip(DIFFERENCE_FACTOR * np.abs(truth - prediction), 0.0, 1.0)
    whole = {title: truth, "prediction": prediction, f"difference × {DIFFERENCE_FACTOR:g}": difference}
    parts = {f"truth, worst {size}×{size} pixels": truth[part], "prediction of these": prediction[part]}
    for axis, (name, picture) in zip(axes, {**whole, **parts}.items(), strict=True):
        axis.imshow(picture, interpolation="nearest")
        axis.set_title(name, fontsize=8)
        axis.set(xticks=[], yticks=[])
    for axis in axes[:3]:
        corner = left - 0.5, top - 0.5
        axis.add_patch(Rectangle(corner, size, size, fill=False, edgecolor="tab:red", linewidth=0.8))


def worst_window(truth: NDArray[np.float32], prediction: NDArray[np.float32]) -> tuple[int, int, int]:
    """Top row, left column and side of the square with the largest squared error, of two pictures (H, W, 3)."""
    size = max(1, min(LARGEST_WINDOW, min(truth.shape[:2]) // 4))
    errors = np.square(truth.astype(np.float64) - prediction).sum(axis=-1)  # [H, W]
    sums = np.pad(errors.cumsum(axis=0).cumsum(axis=1), ((1, 0), (1, 0)))  # [H + 1, W + 1]
    windows = sums[size:, size:] - sums[:-size, size:] - sums[size:, :-size] + sums[:-size, :-size]
    top, left = np.unravel_index(int(windows.argmax()), windows.shape)
    return int(top), int(left), size


def _place(parameters: Mapping[str, float | str], by_name: Mapping[str, Parameter]) -> str:
    values = {
        name: value if isinstance(value, str) else f"{by_name[name].text(value, 4)} {by_name[name].unit}".rstrip()
        for name, value in parameters.items()
    }
    at = [f"{name} = {value}" for name, value in values.items()]
    return "\n".join(["truth", *(", ".join(at[i : i + 2]) for i in range(0, len(at), 2))])
