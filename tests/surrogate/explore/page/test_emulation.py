"""A page draws the emulated field as the ray caster does: volumes and surfaces, with holes, by a card and by scripts."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from numpy.typing import NDArray

from catalogs.vocabulary.appearance import Isosurface, TransferFunction, VolumeRendering
from catalogs.vocabulary.cameras import Camera, orbit
from catalogs.vocabulary.parameters import Parameter, ParameterSpace
from catalogs.vocabulary.variations import VariationSetting, field_variation
from catalogs.vocabulary.variations.isovalue import IsovalueVariation
from surrogate import Surrogate
from surrogate.appearance.scale import ValueScale
from surrogate.emulation import EmulatedFields, FieldEmulator
from surrogate.evaluation.metrics import WHITE
from surrogate.explore.exporting.page import page_bytes
from surrogate.explore.run import Run
from surrogate.gaussians import Normalization
from surrogate.model import FieldModel
from surrogate.model.form import without_gaussians
from surrogate.model.representation import RepresentationScores
from tests.support.drawn_models import colored
from tests.support.drawn_pages import decibels, field_drawn, opened, places_of

if TYPE_CHECKING:
    from playwright.sync_api import Page

pytestmark = pytest.mark.slow
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


@pytest.mark.parametrize("name", MODELS)
def test_the_page_draws_what_the_ray_caster_draws(page: Page, tmp_path: Path, name: str) -> None:
    make, settings = MODELS[name]
    surrogate = make()
    opened(page, surrogate, tmp_path)
    cases, expected = [], []
    for camera, parameters, visualization in zip(
        cameras(), places_of(surrogate), itertools.cycle(settings), strict=False
    ):
        cases.append({"parameters": parameters, "visualization": visualization, "camera": camera.to_json()})
        expected.append(surrogate.at(parameters | visualization).render(camera, background=WHITE))
    assert max(float(picture.mean()) for picture in expected) < 0.99
    for engine in ("card", "scripts"):
        found = field_drawn(page, cases, engine)
        scores = [decibels(*pair) for pair in zip(found, expected, strict=True)]
        assert min(scores) >= 110.0, (engine, scores)


def test_a_surface_larger_than_a_tile_is_whole(page: Page, tmp_path: Path) -> None:
    surrogate, camera = surfaces(), cameras()[0].resized(300, 30)
    opened(page, surrogate, tmp_path)
    case = {"parameters": SPACE.middle, "visualization": {"isovalue": 0.2}, "camera": camera.to_json()}
    expected = surrogate.at(SPACE.middle, isovalue=0.2).render(camera, background=WHITE)
    (found,) = field_drawn(page, [case], "card")
    assert decibels(found, expected) >= 110.0


def test_any_function_is_drawn_by_the_distance_that_fits_it(page: Page, tmp_path: Path) -> None:
    surrogate, camera, parameters = model(), cameras()[0], SPACE.middle
    opened(page, surrogate, tmp_path)
    transfer = {"function": vars(PEAK), "free": True}
    case = {"parameters": parameters, "visualization": {}, "camera": camera.to_json(), "transfer": transfer}
    expected = surrogate.under(PEAK, parameters).render(camera, background=WHITE)
    for engine in ("card", "scripts"):
        (found,) = field_drawn(page, [case], engine)
        assert decibels(found, expected) >= 110.0, engine


def both() -> Surrogate:
    base = colored()
    own = FieldModel(EmulatedFields(base.space, {"": emulator()}), (VOLUME,), (), Normalization.of_box(BOX))
    scores = RepresentationScores({"view": {"gaussians": 30.0, "field": 40.0, "both": 35.0}})
    return replace(base, field=own, normalization=own.normalization, scores=scores)


def test_the_page_offers_all_ways_to_draw_and_takes_the_best(page: Page, tmp_path: Path) -> None:
    surrogate = both()
    opened(page, surrogate, tmp_path)
    names = page.locator("#using option").evaluate_all("options => options.map(option => option.value)")
    ways = [f"{kind}-{device}" for kind in ("gaussians", "field", "both") for device in ("card", "scripts")]
    assert names == ["", *ways]
    script = """async ([request, ways]) => {
      const { frame } = await import("draw/local.js"), found = [];
      for (const using of ways) {
        const { pictures: [bitmap], by } = await frame({ ...request, settings: [{ ...request.settings[0], using }] });
        const canvas = document.createElement("canvas");
        [canvas.width, canvas.height] = request.size;
        const context = canvas.getContext("2d");
        context.drawImage(bitmap, 0, 0);
        found.push([[...context.getImageData(0, 0, ...request.size).data], by[0]]);
      }
      return found;
    }"""
    camera = cameras()[0]
    seen = {"position": camera.position.tolist(), "target": (camera.position + camera.forward).tolist()}
    seen |= {"up": camera.up.tolist(), "field": camera.vertical_fov_degrees}
    setting = {"parameters": surrogate.space.middle, "visualization": {}, "color_map": ""}
    request = {"settings": [setting], "camera": seen, "size": [64, 56], "background": "#ffffff", "form": "png"}
    for name, (data, by) in zip(["", *ways], page.evaluate(script, [request, ["", *ways]]), strict=True):
        using = name.partition("-")[0] or "field"
        expected = surrogate.using(using).at(surrogate.space.middle).render(camera, background=WHITE)
        found = np.reshape(data, (56, 64, 4))[..., :3]
        assert np.abs(found - 255.0 * expected[..., :3]).mean() < 0.6, name
        assert {"gaussians": "Gaussians", "field": "emulated field", "both": "mean image"}[using] in by


def test_functions_that_the_gaussians_do_not_follow_are_drawn_from_the_field(page: Page, tmp_path: Path) -> None:
    surrogate = replace(both(), scores=RepresentationScores())
    opened(page, surrogate, tmp_path, modes=9)
    script = """async function_ => {
      const { ways } = await import("draw/local.js"), plain = { visualization: {}, color_map: "" };
      return [plain, { ...plain, function: function_ }].map(setting => ways.of(setting)[0]);
    }"""
    assert page.evaluate(script, vars(PEAK)) == ["gaussians", "field"]


def test_the_field_is_there_where_it_draws_best_or_modes_are_asked_for() -> None:
    surrogate = both()
    sizes = {modes: len(page_bytes(Run("a run", surrogate), None, modes)) for modes in (None, 0, 1, 99)}
    assert sizes[0] < sizes[1] < sizes[99] == sizes[None]
    worse = replace(surrogate, scores=RepresentationScores())
    assert len(page_bytes(Run("a run", worse))) == pytest.approx(sizes[0], abs=99)
    with pytest.raises(ValueError, match="hold neither: explore the run"):
        page_bytes(Run("a run", model()), None, 0)
