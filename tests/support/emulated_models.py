"""Emulated fields that pages draw: volumes and surfaces, with holes, and cameras around them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from catalogs.vocabulary.appearance import Isosurface, TransferFunction, VolumeRendering
from catalogs.vocabulary.cameras import Camera, orbit
from catalogs.vocabulary.parameters import Parameter, ParameterSpace
from catalogs.vocabulary.variations import VariationSetting, field_variation
from catalogs.vocabulary.variations.isovalue import IsovalueVariation
from surrogate import Surrogate
from surrogate.appearance.scale import ValueScale
from surrogate.emulation import EmulatedFields, FieldEmulator
from surrogate.gaussians import Normalization
from surrogate.model import FieldModel
from surrogate.model.form import without_gaussians
from surrogate.model.representation import RepresentationScores
from tests.support.drawn_models import colored

SHAPE, SPACING, ORIGIN = (14, 12, 16), (0.3, 0.4, 0.35), (-30.0, 5.0, 2.0)
SPAN = np.array(SPACING) * (np.array(SHAPE[::-1]) - 1)
BOX = (np.array(ORIGIN), np.array(ORIGIN) + SPAN)
POINTS = np.random.default_rng(4).uniform(-1.0, 1.0, (9, 2))
SPACE = ParameterSpace((Parameter("Re", 100.0, 2500.0, scale="log"), Parameter("time", 0.0, 2.0)))
FUNCTION = TransferFunction(
    ((-1.0, 0.1, 0.2, 0.8), (0.1, 0.9, 0.9, 0.4), (1.0, 0.8, 0.1, 0.1)),
    ((-1.0, 0.4), (-0.4, 0.02), (0.2, 0.0), (0.25, 0.7), (0.4, 0.1), (1.0, 0.95)),
    1.0,
)
PEAK = TransferFunction(FUNCTION.color_points[::2], ((-1.0, 0.0), (0.3, 0.0), (0.33, 0.9), (0.36, 0.0)), 0.5)
PALE = TransferFunction(FUNCTION.color_points, ((-1.0, 0.2), (1.0, 0.4)), 1.0)
VOLUME = VolumeRendering("dvr", FUNCTION)
SURFACE = Isosurface("iso=0", 0.0, (0.9, 0.7, 0.3))
ISOVALUES = IsovalueVariation(
    "dvr",
    ParameterSpace((Parameter("isovalue", -0.5, 0.5),)),
    (VariationSetting("iso=0", (-0.5,), "train"), VariationSetting("iso=1", (0.5,), "train")),
)


def fields(holes: str = "") -> NDArray[np.float32]:
    """Waves that follow both parameters (M, Z, Y, X), with `holes` that stand still, move, or both."""
    k, j, i = np.meshgrid(*map(np.arange, SHAPE), indexing="ij")
    made = []
    for first, second in POINTS:
        wave = np.sin(0.5 * i + first) * np.cos(0.4 * j) + 0.5 * np.cos(0.6 * k + second)
        if "still" in holes:
            wave[4:7, 3:8, 5:9] = np.nan
        if "moving" in holes:
            wave[(i - 8 - 2 * first) ** 2 + (j - 6) ** 2 + (k - 7) ** 2 < 9.0] = np.nan
        made.append(wave)
    return np.stack(made).astype(np.float32)


def emulator(holes: str = "", scale: ValueScale | None = None, factor: float = 1.0) -> FieldEmulator:
    return FieldEmulator.fit(POINTS, factor * fields(holes), SPACING, ORIGIN, scale)


def alone(own: FieldModel) -> Surrogate:
    return Surrogate(**without_gaussians(own), field=own)


def model(appearance: Any = VOLUME, holes: str = "", distance: float | None = 0.11, **more: Any) -> Surrogate:
    emulators = EmulatedFields(SPACE, {"": emulator(holes, **more)})
    distances = {} if distance is None else {appearance.name: distance}
    return alone(FieldModel(emulators, (appearance,), (), Normalization.of_box(BOX), sample_distances=distances))


def surfaces(holes: str = "") -> Surrogate:
    emulators = EmulatedFields(SPACE, {"": emulator(holes)})
    own = FieldModel(
        emulators, (VOLUME, SURFACE, replace(SURFACE, name="iso=1")), (ISOVALUES,), Normalization.of_box(BOX)
    )
    return alone(own)


def others() -> Surrogate:
    emulators = EmulatedFields(SPACE, {"p": emulator(), "q": emulator("still", factor=0.5)})
    shown = replace(VOLUME, field="p"), VolumeRendering("other", PEAK, shaded=True, field="q")
    variation = field_variation("dvr", appearances=("other",))
    return alone(FieldModel(emulators, shown, (variation,), Normalization.of_box(BOX)))


SCALE = ValueScale.of_function(FUNCTION)
MODELS: dict[str, tuple[Callable[[], Surrogate], list[dict[str, Any]]]] = {
    "volume": (model, [{}]),
    "volume on a scale, by the distance that fits": (lambda: model(scale=SCALE, distance=None), [{}]),
    "shaded volume": (lambda: model(replace(VOLUME, shaded=True), distance=0.4), [{}]),
    "narrow field": (lambda: model(VolumeRendering("dvr", PALE), factor=1e-3), [{}]),
    "volume with holes": (lambda: model(holes="still moving"), [{}]),
    "shaded volume with holes": (lambda: model(replace(VOLUME, shaded=True), "still", 0.4), [{}]),
    "surfaces": (surfaces, [{"isovalue": 0.1}, {"isovalue": -0.3}]),
    "surfaces with holes": (lambda: surfaces("still moving"), [{"isovalue": 0.1}]),
    "other fields": (others, [{"appearance": "other"}, {"appearance": "dvr"}]),
}


def cameras() -> list[Camera]:
    """Around the box, on lines along it, and inside."""
    middle = (BOX[0] + BOX[1]) / 2.0
    around = orbit(middle, float(np.linalg.norm(SPAN)) / 2.0, width=64, height=56, frequency=2)
    place = BOX[0] + 0.4 * SPAN
    inside = Camera.look_at(place, place + np.array([0.3, 1.0, 0.2]), vertical_fov_degrees=70.0, width=64, height=56)
    return [around[3], around[17], inside]


def both() -> Surrogate:
    base = colored()
    own = FieldModel(EmulatedFields(base.space, {"": emulator()}), (VOLUME,), (), Normalization.of_box(BOX))
    scores = RepresentationScores({"view": {"gaussians": 30.0, "field": 40.0, "both": 35.0}})
    return replace(base, field=own, normalization=own.normalization, scores=scores)
