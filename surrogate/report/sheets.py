"""Strips of truth, surrogate and the best simple prediction, a row for each picture, with the worst part enlarged."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from catalogs.store.catalog import Catalog
from catalogs.vocabulary.appearance import TransferFunction, VolumeRendering
from catalogs.vocabulary.cameras import Camera
from catalogs.vocabulary.parameters import Parameter
from surrogate.evaluation.evaluate import Baseline
from surrogate.evaluation.metrics import TrueImage
from surrogate.evaluation.scoring import Scored
from surrogate.model import Surrogate

LARGEST_ERROR = 0.25  # of a channel, where the colours of the error end
LARGEST_WINDOW = 64  # pixels; and no more than a quarter of a side, or little would be enlarged
ROW_INCHES, COLUMN_INCHES, LINE_INCHES = 2.4, 2.2, 0.15
ARROWS = 0.16  # of a picture's height


def chosen(scored: Sequence[Scored], names: Sequence[str]) -> dict[str, Scored]:
    """The "worst", "median" and "best" image by PSNR of the foreground, those of them that are named; empty ones are best."""
    ordered = sorted(scored, key=lambda s: math.inf if math.isnan(s.score.psnr_foreground) else s.score.psnr_foreground)
    places: Mapping[str, int] = {"worst": 0, "median": len(ordered) // 2, "best": -1}
    return {name: ordered[places[name]] for name in names}


def draw_sheet(
    figure: Any,
    title: str,
    images: Mapping[str, Scored],
    surrogate: Surrogate,
    catalog: Catalog,
    rival: Baseline | None = None,
) -> None:
    """Draw a row for each of the images, by what they are called, into a figure, which is sized to hold them."""
    cases = [scored.target for scored in images.values()]
    rivals = dict(rival.pictures(cases)) if rival else {}
    names = ["truth", "surrogate", *([rival.name.split(" (")[0]] if rival and len(rivals) == len(cases) else [])]
    row = ROW_INCHES + LINE_INCHES * len(cases[0].parameters) / 2
    figure.set_size_inches(COLUMN_INCHES * (len(names) + 3), row * len(images) + 1.0)
    grid = figure.subplots(len(images), len(names) + 3, squeeze=False)
    spaces = surrogate.space, *(v.space for v in surrogate.variations)
    parameters = {p.name: p for space in spaces for p in space.parameters}
    background = catalog.plan.background
    for axes, (name, case) in zip(grid, zip(images, cases, strict=True), strict=True):
        truth = TrueImage(catalog.image(case.member, case.appearance, case.view), background)
        prediction = surrogate.at(case.parameters, outside="allow").render(case.camera, background=background)
        pictures = [prediction, *([rivals[case]] if len(names) > 2 else [])]
        titles = [f"{n}\n{_decibels(truth, p)}" for n, p in zip(names[1:], pictures, strict=True)]
        whole = dict(zip(["truth", *titles], [truth.displayed, *map(truth.composite, pictures)], strict=True))
        error = _draw_row(axes, whole)
        _arrows(axes[0], case.camera)
        axes[0].set_ylabel(f"{name}, view {case.view}", fontsize=9)
        axes[0].set_title(f"truth\n{_place(case.parameters, parameters)}", fontsize=8)
    bar = figure.colorbar(error, ax=list(grid[:, -3:].flat), location="bottom", shrink=0.6, aspect=40, pad=0.02)
    bar.set_label("error of the surrogate: mean absolute difference of the colours, black to white being 1", fontsize=8)
    appearances = {case.appearance for case in cases}
    [first, *_] = [a for a in catalog.plan.appearances if a.name in appearances]
    if isinstance(first, VolumeRendering) and len(appearances) == 1:
        _legend(figure, list(grid[:, :-3].flat), first.transfer_function, catalog.plan.field_label(first.field))
    figure.suptitle(title, fontsize=11)


def _decibels(truth: TrueImage, picture: NDArray[Any]) -> str:
    score = truth.score(picture)
    whole = f"{score.psnr:.1f} dB"
    return whole if math.isnan(score.psnr_foreground) else f"{score.psnr_foreground:.1f} dB (whole picture {whole})"


def _draw_row(axes: Sequence[Any], pictures: Mapping[str, NDArray[np.float32]]) -> Any:
    """Pictures (H, W, 3) with values in [0, 1]: whole, the second one's error, and the window where it is worst."""
    from matplotlib.patches import Rectangle

    truth, prediction = list(pictures.values())[:2]
    top, left, size = worst_window(truth, prediction)
    part = np.s_[top : top + size, left : left + size]
    *whole, difference, first, second = axes
    enlarged = {"truth, in the square": truth[part], "surrogate, in the square": prediction[part]}
    for axis, (name, picture) in zip((*whole, first, second), {**pictures, **enlarged}.items(), strict=True):
        axis.imshow(picture, interpolation="nearest")
        axis.set_title(name, fontsize=8)
    error = difference.imshow(np.abs(truth - prediction).mean(-1), cmap="magma", vmin=0.0, vmax=LARGEST_ERROR)
    difference.set_title("error", fontsize=8)
    for axis in axes:
        axis.set(xticks=[], yticks=[])
    for axis in (*whole, difference):
        corner = left - 0.5, top - 0.5
        axis.add_patch(Rectangle(corner, size, size, fill=False, edgecolor="tab:red", linewidth=0.8))
    return error


def _arrows(axis: Any, camera: Camera) -> None:
    """The directions of the world's axes, as the camera sees them, in the lower left corner."""
    length = ARROWS * camera.height
    place = np.array([0.22 * camera.width, 0.8 * camera.height])
    for name, (x, y) in zip("xyz", camera.world_to_camera[:2, :3].T, strict=True):
        tip = place + length * np.array([x, y])
        axis.annotate("", tip, place, arrowprops={"arrowstyle": "->", "linewidth": 0.8, "color": "gray"})
        if np.hypot(x, y) > 0.2:
            axis.text(*(place + 1.25 * (tip - place)), name, fontsize=7, color="gray", ha="center", va="center")


def _legend(figure: Any, axes: Sequence[Any], function: TransferFunction, label: str) -> None:
    """A colour bar of a transfer function, which fades to white as it becomes transparent."""
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import ListedColormap, Normalize

    low, high = function.bounds
    values = np.linspace(low, high, 256)
    opacities = function.opacities(values)[:, None]
    opacities = opacities / max(float(opacities.max()), np.finfo(float).tiny)
    colors = np.clip(opacities * function.colors(values) + 1.0 - opacities, 0.0, 1.0)
    mapped = ScalarMappable(Normalize(low, high), ListedColormap(colors))
    bar = figure.colorbar(mapped, ax=axes, location="bottom", shrink=0.6, aspect=40, pad=0.02)
    bar.set_label(f"{label or 'the field'}; pale where it is transparent", fontsize=8)


def worst_window(truth: NDArray[np.float32], prediction: NDArray[np.float32]) -> tuple[int, int, int]:
    """Top row, left column and side of the square with the largest squared error, of two pictures (H, W, 3)."""
    size = max(1, min(LARGEST_WINDOW, min(truth.shape[:2]) // 4))
    errors = np.square(truth.astype(np.float64) - prediction).sum(axis=-1)  # [H, W]
    sums = np.pad(errors.cumsum(axis=0).cumsum(axis=1), ((1, 0), (1, 0)))  # [H + 1, W + 1]
    windows = sums[size:, size:] - sums[:-size, size:] - sums[size:, :-size] + sums[:-size, :-size]
    top, left = np.unravel_index(int(windows.argmax()), windows.shape)
    return int(top), int(left), size


def _place(parameters: Mapping[str, float | str], by_name: Mapping[str, Parameter]) -> str:
    """The parameters, two to a line."""
    at = [
        f"{name} = {value}"
        if isinstance(value, str)
        else f"{name} = {by_name[name].text(value, 4)} {by_name[name].unit}".rstrip()
        for name, value in parameters.items()
    ]
    return "\n".join(", ".join(at[i : i + 2]) for i in range(0, len(at), 2))
