"""In how few bits models are stored that follow visualization parameters."""

from __future__ import annotations

from dataclasses import replace

import pytest
import torch

from surrogate.deformation import BilinearDeformation
from surrogate.deformation.visualization import Visualization
from surrogate.settings import TrainingSettings
from surrogate.training.compression.evaluator import Evaluator
from surrogate.training.compression.precision import precision_of_visualization
from surrogate.training.data import TrainingData
from surrogate.training.state import FittedGaussians
from tests.support.comparing import same, stored_picture
from tests.support.field_blobs import BLOBS
from tests.support.visualizations import base, of_functions, of_isovalue

KINDS = ("values", "isovalue")


def model(kind: str) -> tuple[FittedGaussians, Visualization]:
    fitted = base()
    return fitted, of_isovalue(fitted, 1) if kind == "isovalue" else of_functions(fitted)


def evaluator(fitted: FittedGaussians, visual: Visualization, tolerance: float) -> Evaluator:
    """Images that the model fits as exactly as bytes can."""
    places, images = ((-0.8, 0.6), (0.5, -0.3)), []
    for p, v in places:
        place = torch.tensor([p, *[v] * len(visual.variation.space)])
        shown = visual.gaussians_at(*fitted, place)
        images += [stored_picture(shown, camera, place) for camera in BLOBS.cameras()[:3]]
    return Evaluator(TrainingSettings(need_tolerance=tolerance), TrainingData([], images, None))


@pytest.mark.slow
@pytest.mark.parametrize("tolerance", [0.05, 100.0])
@pytest.mark.parametrize("kind", KINDS)
def test_few_bits_cost_no_more_than_the_tolerance(kind: str, tolerance: float) -> None:
    fitted, visual = model(kind)
    judged = evaluator(fitted, visual, tolerance)
    found, encodings, choice = precision_of_visualization(visual, fitted, judged)
    scores = [judged.psnr_of(lambda p, v=v: v.gaussians_at(*fitted, p)) for v in (visual, found)]  # type: ignore[misc]
    assert scores[1] >= scores[0] - tolerance - 1e-9
    assert set(encodings) <= set(visual.stored())
    for name, tensor in found.stored().items():
        expected = encodings[name].decoded() if name in encodings else visual.stored()[name]
        assert torch.equal(tensor, expected)
    assert choice.name == ("precision, isovalue" if kind == "isovalue" else "precision, transfer function")
    if tolerance == 100.0:
        assert {e.form for e in encodings.values() if len(e.codes) >= 8} == {"uint8"}
        assert {e.form for e in encodings.values() if len(e.codes) < 8} <= {"float16"}  # levels of few rows take more
        assert set(encodings) == set(visual.stored())
    assert (choice.options[0].psnr, choice.options[-1].psnr) == pytest.approx(tuple(scores))


def test_f_vis_in_few_bits_still_leaves_the_base_as_it_is() -> None:
    fitted, visual = model("values")
    found, _, _ = precision_of_visualization(visual, fitted, evaluator(fitted, visual, 100.0))
    place = torch.tensor([0.3, 0.0, 0.0, 0.0, 0.0])
    assert same(found.gaussians_at(*fitted, place), fitted.at(place[:1]))


def test_what_would_become_infinite_is_not_stored_in_half_precision() -> None:
    fitted, visual = model("isovalue")
    deformation = visual.deformation
    assert isinstance(deformation, BilinearDeformation)
    latents = deformation.latents * 1e6
    large = replace(deformation, latents=latents, units=deformation.units * 1e-6)
    visual = replace(visual, deformation=large)
    found, encodings, _ = precision_of_visualization(visual, fitted, evaluator(fitted, visual, 0.05))
    assert all(torch.isfinite(tensor).all() for tensor in found.stored().values())
    assert "deformation.latents" not in encodings or encodings["deformation.latents"].form != "float16"
