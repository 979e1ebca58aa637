"""A page draws visualizations of the base as the engine does: lit surfaces, other fields, and functions by weights."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
import torch

from catalogs.vocabulary.parameters import Parameter, ParameterSpace
from catalogs.vocabulary.variations import POINT_PARAMETERS, Variation, VariationSetting, field_variation
from catalogs.vocabulary.variations.isovalue import IsovalueVariation
from catalogs.vocabulary.variations.transfer_function import TransferFunctionVariation
from surrogate import Surrogate
from surrogate.deformation import BilinearDeformation, ValuesDeformation
from surrogate.deformation.visualization import Visualization
from surrogate.evaluation.metrics import WHITE
from surrogate.lighting import Lighting
from surrogate.rasterizer import Rasterizer
from surrogate.settings import TrainingSettings
from surrogate.storage.encoding import encode
from tests.support.drawn_models import BASE, cameras, carrying, colored
from tests.support.drawn_pages import assert_agree, opened, places_of

if TYPE_CHECKING:
    from playwright.sync_api import Page

pytestmark = pytest.mark.slow
TRAINED = (1.0, 1.5, 4.0, 9.0)  # at uneven steps
ISOVALUES = IsovalueVariation(
    "base",
    ParameterSpace((Parameter("isovalue", 1.0, 9.0),)),
    tuple(VariationSetting(f"iso={value}", (value,), "train") for value in TRAINED),
)
FIELDS = field_variation("base", appearances=("speed", "density"))
STEPS = (0.05, 0.1, 0.05, 0.1)
FUNCTIONS = TransferFunctionVariation(
    "base",
    ParameterSpace(tuple(Parameter(n, -step, step) for n, step in zip(POINT_PARAMETERS, STEPS, strict=True))),
    (VariationSetting("moved", STEPS, "train"),),
)
LIGHT = Lighting((0.9, 0.6, 0.3), 0.15, 0.75, 0.2, 20.0)


def deformation(surrogate: Surrogate, variation: Variation, columns: int, seed: int = 8) -> BilinearDeformation:
    """A random one of the simulation's and the variation's parameters."""
    gaussians, random = colored().gaussians, torch.Generator().manual_seed(seed)
    blank = BilinearDeformation.create(
        gaussians,
        len(surrogate.space) + len(variation.space),
        TrainingSettings(latent_size=4, hidden_width=8),
        color_columns=columns,
        for_visualization=True,
    )
    changed = {name: t + 0.05 * torch.randn(t.shape, generator=random) for name, t in blank.tensors().items()}
    return blank.with_tensors(changed)


def tuned(surrogate: Surrogate) -> BilinearDeformation:
    return surrogate.deformation.with_tensors({n: 1.1 * t for n, t in surrogate.deformation.tensors().items()})


def lit() -> Surrogate:
    """Isosurfaces of Gaussians of their own, in few bits."""
    base, own = carrying(follow=True), colored().gaussians
    visualization = Visualization(ISOVALUES, deformation(base, ISOVALUES, 3), gaussians=own, lighting=LIGHT)
    stored = encode(visualization.stored()["deformation.latents"], "uint8")
    tensors = visualization.tensors() | {"deformation.latents": stored.decoded()}
    encodings = {**base.encodings, "visualization0.deformation.latents": stored}
    made = replace(base, visualizations=(visualization.with_tensors(tensors),), encodings=encodings)
    return replace(made, rasterizer=Rasterizer(surface_samples=2))


def composed(variation: Variation, columns: int = 3, degree: int = 0, simulation: bool = True) -> Surrogate:
    """A deformation on top of that of the base's colours."""
    base = colored(columns)
    width = 12 if degree or columns == 12 else 3
    own = Visualization(variation, deformation(base, variation, width), tuned(base) if simulation else None, degree)
    return replace(base, visualizations=(own,))


def on_values(variation: Variation, degree: int = 0) -> Surrogate:
    """A deformation of Gaussians that carry values, as the base's function shows them."""
    base = carrying(follow=True, scale="log")
    own = Visualization(variation, deformation(base, variation, 12 if degree else 3), tuned(base), degree)
    return replace(base, visualizations=(own,))


def weighed() -> Surrogate:
    base = colored(12)
    values = np.linspace(0.0, 1.0, 12) ** 1.5
    return replace(
        base, visualizations=(Visualization(FUNCTIONS, ValuesDeformation.create(base.gaussians, BASE, values, STEPS)),)
    )


ISO: dict[str, Any] = {"isovalue": 2.2}
MODELS: dict[str, tuple[Callable[[], Surrogate], list[dict[str, Any]]]] = {
    "lit surfaces": (lit, [ISO, {"isovalue": 9.5}, {"isovalue": 0.9}, {}]),
    "isovalues": (lambda: composed(ISOVALUES), [ISO, {"isovalue": 7.0}]),
    "isovalues of degree 1": (lambda: composed(ISOVALUES, degree=1, simulation=False), [ISO]),
    "other colours of degree 1": (
        lambda: composed(FIELDS, 12, 1),
        [{"appearance": "density"}, {"appearance": "base"}],
    ),
    "other fields on values": (lambda: on_values(FIELDS), [{"appearance": "speed"}, {"appearance": "base"}]),
    "isovalues on values, of degree 1": (lambda: on_values(ISOVALUES, 1), [ISO]),
    "functions by weights": (weighed, [{"c1_value": 0.04, "c2_opacity": -0.04}, {"c1_opacity": 0.09}]),
}


@pytest.mark.parametrize("name", MODELS)
def test_visualizations_are_drawn_as_the_engine_draws_them(page: Page, tmp_path: Path, name: str) -> None:
    make, settings = MODELS[name]
    surrogate = make()
    opened(page, surrogate, tmp_path)
    cases, expected = [], []
    for camera, place, setting in zip(cameras(4), places_of(surrogate), itertools.cycle(settings), strict=False):
        parameters = place | setting
        case = {"parameters": parameters, "camera": camera.to_json()}
        if name == "functions by weights":
            case["visualization"] = setting
        cases.append(case)
        expected.append(surrogate.at(parameters, outside="allow").render(camera, background=WHITE))
    assert_agree(page, cases, expected)


def test_the_isovalue_is_chosen_in_the_page(page: Page, tmp_path: Path) -> None:
    opened(page, lit(), tmp_path)
    picture = "document.querySelector('#stage canvas').toDataURL()"
    base = page.evaluate(picture)
    page.locator("#kind-isovalue").click()
    page.wait_for_function("() => window.explorer.resting")
    surface = page.evaluate(picture)
    page.locator("#isovalue").focus()
    page.keyboard.press("End")
    page.wait_for_function("() => window.explorer.resting")
    assert len({base, surface, page.evaluate(picture)}) == 3
