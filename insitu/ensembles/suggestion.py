"""A first transfer function, from what pilot members hold and how opaque they look."""

from __future__ import annotations

import itertools
import json
import math
import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from catalogs.vocabulary.appearance import TransferFunction, VolumeRendering
from catalogs.vocabulary.scene import ViewPlan
from insitu.ensembles.probe import Probe
from insitu.fields.boxes import Box, box_around, box_of, cameras_around

if TYPE_CHECKING:
    from render.grids import Grid

TARGET_ALPHA = 0.5
CLIPPED = 0.001  # of all values, at either end, lie outside the suggested range
COMMONPLACE = 0.5  # of all values, the most frequent ones, stay transparent
LARGEST_OPACITY = 0.8
FAINTEST = 0.05  # of the largest surprise: what is hardly rarer than the commonplace stays transparent too
BINS = 64
SMOOTHING = 2.5  # bins: members between the pilots have their background between the pilots' backgrounds
POINTS = 12
VISIBLE = 1.0 / 255.0
LONGEST_NAME = 60
NOT_IN_NAMES = r"[^A-Za-z0-9_.+=-]"  # of appearances
PROBE_VIEWS = ViewPlan(frequency=1, width=96, height=96)

# Blue to red through pale tones, dark at neither end: neighbouring values part, and nothing vanishes on white or black.
COLORS = (
    (0.17, 0.25, 0.72),
    (0.13, 0.56, 0.84),
    (0.25, 0.78, 0.68),
    (0.72, 0.85, 0.34),
    (0.98, 0.76, 0.22),
    (0.93, 0.43, 0.16),
    (0.72, 0.10, 0.20),
)


def appearance_names(fields: Sequence[str]) -> dict[str, str]:
    """A name for the appearance of each field: like the field's as far as names allow, no two alike."""
    names: dict[str, str] = {}
    for field in fields:
        stem = f"dvr-{re.sub(NOT_IN_NAMES, '-', field)[:LONGEST_NAME]}"
        tried = (stem if number == 1 else f"{stem}-{number}" for number in itertools.count(1))
        names[field] = next(name for name in tried if name not in names.values())
    return names


@dataclass(frozen=True)
class Suggestion:
    """A transfer function and the mean foreground alpha of each pilot member's pictures under it.

    Foreground is every pixel with an alpha above 1/255.
    """

    appearance: VolumeRendering
    alphas: tuple[float, ...]

    def toml(self) -> str:
        """The `[[appearance]]` table of a scene, ready to paste."""
        function, field = self.appearance.transfer_function, self.appearance.field
        named = f"field = {json.dumps(field, ensure_ascii=False)}\n" if field else ""
        colors = "\n".join("    " + str(list(p)) + "," for p in function.color_points)
        opacities = "\n".join("    " + str(list(p)) + "," for p in function.opacity_points)
        return (
            f'[[appearance]]\nkind = "volume"\nname = "{self.appearance.name}"\n{named}\n[appearance.transfer_function]\n'
            f"opacity_unit_distance = {function.opacity_unit_distance}\n"
            f"# value, red, green, blue\ncolor_points = [\n{colors}\n]\n"
            f"# value, opacity per unit distance\nopacity_points = [\n{opacities}\n]\n"
        )


def suggest(
    probe: Probe, grids: Sequence[Grid], *, name: str = "dvr", alpha: float = TARGET_ALPHA, field: str = ""
) -> Suggestion:
    """A transfer function that leaves commonplace values transparent and rare ones visible through the depth.

    A value is as common as in the member that has most of it.  Otherwise the background of one member would fill its images with
    fog where that value is rare in the others.  The most common values, half of all, are transparent.  Beyond, opacity grows
    with a value's information, -log of frequency (compare Bordoloi & Shen 2005, "View selection for volume rendering",
    section 3).  Colours are spread so that each covers an equal part of what is visible.  The unit distance is then solved for
    a mean foreground alpha of `alpha` over small images of `grids`.  The optical depth along every ray is inversely proportional
    to it, so one image serves all distances (Max 1995, "Optical models for direct volume rendering", absorption only).

    It cannot know which values matter to you: it is a start to edit.  `field` names the field of `grids`, where members have
    several.

    Raises ValueError where `alpha` is not between 0 and 1.
    """
    if not 0 < alpha < 1:
        raise ValueError(f"alpha must lie between 0 and 1, got {alpha}")
    bounds = box_around([box_of(grid) for grid in grids])
    low, high = probe.quantile(CLIPPED), probe.quantile(1.0 - CLIPPED)
    if not low < high:
        middle = probe.quantile(0.5)
        margin = abs(middle) * 0.5 or 0.5
        low, high = middle - margin, middle + margin
    histograms, edges = probe.histogram(BINS, low, high)
    opacities = _opacity_curve(histograms.max(axis=0))  # [B]
    opacity_points = _simplified((edges[:-1] + edges[1:]) / 2.0, opacities, low, high)
    color_points = _color_points(histograms.mean(axis=0) * opacities, edges)
    size = float(np.linalg.norm(np.subtract(*bounds)))

    def appearance(unit_distance: float) -> VolumeRendering:
        function = TransferFunction(color_points, opacity_points, _rounded(unit_distance, 3))
        return VolumeRendering(name, function, field=field)

    depths = [-np.log1p(-np.minimum(a, 1.0 - 1e-6)) * size for a in _alphas(grids, appearance(size), bounds)]
    finest, coarsest = 1e-3 * size, 10.0 * size
    for _ in range(30):
        middle = math.sqrt(finest * coarsest)
        if np.mean([_foreground_mean(-np.expm1(-depth / middle)) for depth in depths]) > alpha:
            finest = middle
        else:
            coarsest = middle
    chosen = appearance(math.sqrt(finest * coarsest))
    return Suggestion(chosen, tuple(map(_foreground_mean, _alphas(grids, chosen, bounds))))


def _alphas(grids: Sequence[Grid], appearance: VolumeRendering, bounds: Box) -> list[NDArray[np.float64]]:
    """Alpha [V, H, W] of each grid's pictures."""
    from render import render_views

    cameras = cameras_around(bounds, PROBE_VIEWS)
    return [
        np.stack([rgba[..., 3] for rgba in render_views(grid, appearance, cameras, float_output=True)]).astype(float)
        for grid in grids
    ]


def _foreground_mean(alphas: NDArray[np.float64]) -> float:
    """Mean over the foreground (alpha > 1/255); 0 where there is none."""
    visible = alphas[alphas > VISIBLE]
    return float(visible.mean()) if visible.size else 0.0


def contact_sheet(grids: Sequence[Grid], appearance: VolumeRendering, *, size: int = 192) -> NDArray[np.uint8]:
    """Pictures on white, RGBA: one grid per row, five views each, every picture `size` pixels square."""
    from render import render_views

    cameras = cameras_around(box_around([box_of(grid) for grid in grids]), ViewPlan(width=size, height=size))[20:230:52]
    rows = [np.concatenate(list(render_views(grid, appearance, cameras)), axis=1) for grid in grids]
    sheet = np.concatenate(rows, axis=0)  # [H, W, 4]
    sheet[..., :3] += 255 - sheet[..., 3:]
    sheet[..., 3] = 255
    return sheet


def _opacity_curve(fractions: NDArray[np.float64]) -> NDArray[np.float64]:
    """Opacity (B,) by bin: none for the most frequent values, growing with surprise, -log of frequency, beyond."""
    reach = int(3 * SMOOTHING)
    kernel = np.exp(-0.5 * (np.arange(-reach, reach + 1) / SMOOTHING) ** 2)
    smooth = np.convolve(np.pad(fractions, reach, mode="edge"), kernel / kernel.sum(), mode="valid")  # [B]
    order = np.argsort(-smooth, kind="stable")
    common = order[: int(np.searchsorted(np.cumsum(smooth[order]), COMMONPLACE * smooth.sum())) + 1]
    threshold = float(smooth[common].min())
    floor = max(1e-5, float(smooth.min()))
    if threshold <= floor * (1.0 + 1e-9):
        return np.full(len(fractions), LARGEST_OPACITY)  # all values alike: nothing to set apart
    surprise = np.log(threshold / np.maximum(smooth, floor)) / np.log(threshold / floor)
    return LARGEST_OPACITY * np.clip((surprise - FAINTEST) / (1.0 - FAINTEST), 0.0, 1.0)


def _simplified(
    values: NDArray[np.float64], opacities: NDArray[np.float64], low: float, high: float
) -> tuple[tuple[float, float], ...]:
    """At most POINTS control points near the curve, from `low` to `high` (Ramer 1972, Douglas & Peucker 1973)."""
    values = np.concatenate([[low], values, [high]])
    opacities = np.concatenate([opacities[:1], opacities, opacities[-1:]])
    points = [0, len(values) - 1]
    while len(points) < POINTS:
        error = np.abs(opacities - np.interp(values, values[points], opacities[points]))
        error[opacities == 0.0] *= 5.0  # what is to be clear must not become fog
        if error.max() < 0.01:
            break
        points = sorted([*points, int(np.argmax(error))])
    digits = _digits(high - low)
    return tuple((round(float(values[i]), digits), round(float(opacities[i]), 3)) for i in points)


def _color_points(
    visible: NDArray[np.float64], edges: NDArray[np.float64]
) -> tuple[tuple[float, float, float, float], ...]:
    """Colour control points (value, r, g, b), the colours between them covering equal parts of what is visible.

    Half equal parts of the range, half of the visible mass: a single peak must not take every colour.
    """
    mass = visible / visible.sum() if visible.sum() > 0 else np.zeros_like(visible)
    mass = 0.5 * mass + 0.5 / len(mass)
    cumulative = np.concatenate([[0.0], np.cumsum(mass)])
    places = np.interp(np.linspace(0.0, 1.0, len(COLORS)), cumulative / cumulative[-1], edges)
    digits = _digits(edges[-1] - edges[0])
    return tuple((round(float(v), digits), *color) for v, color in zip(places, COLORS, strict=True))


def _digits(width: float) -> int:
    """Decimals that resolve a ten-thousandth of `width`."""
    return 4 - math.floor(math.log10(width))


def _rounded(value: float, digits: int) -> float:
    return float(f"{value:.{digits}g}")
