from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from catalogs.vocabulary.appearance import TransferFunction
from surrogate import Surrogate
from surrogate.deformation import BilinearDeformation, ValuesDeformation
from surrogate.deformation.visualization import Visualization
from surrogate.gaussians import NAMES, Gaussians, Normalization
from surrogate.rasterizer import Rasterizer
from surrogate.storage.encoding import encode
from surrogate.training.state import FittedGaussians
from tests.support.comparing import same
from tests.support.field_blobs import BLOBS, FUNCTION, FUNCTIONS
from tests.support.visualizations import SMALL, base, of_functions, of_isovalue, shaken, surrogate

OTHER = TransferFunction(((0, 0, 1, 0), (3, 1, 0, 1)), ((0, 0.9), (3, 0.1)), 0.5)
AT_BASE, ELSEWHERE = [0.0] * 4, [0.5, -1.0, 0.25, 1.0]


def encoded(model: Surrogate) -> Surrogate:
    """All of it in few bits, as `choose_precision` stores it."""
    fitted = FittedGaussians(model.gaussians, model.deformation)
    encodings = {name: encode(tensor, "uint8") for name, tensor in fitted.tensors().items()}
    fitted = FittedGaussians.load({name: encoding.decoded() for name, encoding in encodings.items()}, fitted.record())
    shown = []
    for i, visual in enumerate(model.visualizations):
        codes = {name: encode(tensor, "uint8") for name, tensor in visual.stored().items()}
        shown.append(Visualization.load({name: c.decoded() for name, c in codes.items()}, visual.record()))
        encodings |= {f"visualization{i}.{name}": c for name, c in codes.items()}
    return replace(
        model,
        gaussians=fitted.gaussians,
        deformation=fitted.deformation,
        encodings=encodings,
        visualizations=tuple(shown),
    )


def numbers(gaussians: Gaussians) -> list[np.ndarray]:
    return [tensor.numpy() for tensor in gaussians.tensors().values()]


@pytest.mark.parametrize("color_degree", [0, 1])
def test_at_the_base_setting_it_is_f_sim_bit_for_bit(color_degree: int) -> None:
    fitted = base(color_degree)
    visual = of_functions(fitted)
    for p in (-1.0, 0.2, 1.3):
        expected = fitted.at(torch.tensor([p]))
        assert same(visual.gaussians_at(*fitted, torch.tensor([p, *AT_BASE])), expected)
        moved = visual.gaussians_at(*fitted, torch.tensor([p, *ELSEWHERE]))
        assert not torch.equal(moved.opacity_logits, expected.opacity_logits)
        assert not torch.equal(moved.colors, expected.colors)
        assert all(torch.equal(getattr(moved, name), getattr(expected, name)) for name in NAMES[:3])


@pytest.mark.parametrize("small", [False, True], ids=["float32", "encoded"])
def test_so_it_is_after_being_saved(small: bool, tmp_path: Path) -> None:
    fitted = base()
    model = surrogate(fitted, of_functions(fitted), of_isovalue(fitted))
    model = encoded(model) if small else model
    model.save(tmp_path)
    loaded = Surrogate.load(tmp_path)
    for p in (0.0, 0.4, 1.0):
        shown = loaded.at(p=p, **dict(zip(FUNCTIONS.space.names, AT_BASE, strict=True)))
        assert same(shown.gaussians, loaded.at(p=p).gaussians)
        for more in ({"c1_value": 0.4}, {"isovalue": 0.2}):
            assert same(loaded.at(p=p, **more).gaussians, model.at(p=p, **more).gaussians)
    stored = (tmp_path / "model.safetensors").read_bytes()
    loaded.save(tmp_path / "again")
    assert (tmp_path / "again" / "model.safetensors").read_bytes() == stored
    assert loaded.megabytes == model.megabytes


def test_the_base_of_an_isovalue_is_f_sim_alone() -> None:
    fitted = base()
    visual = of_isovalue(fitted, color_degree=1)
    expected = fitted.at(torch.tensor([0.3]))
    assert same(visual.gaussians_at(*fitted, torch.tensor([0.3, torch.nan])), expected)
    moved = visual.gaussians_at(*fitted, torch.tensor([0.3, 0.0]))
    assert moved.color_degree == 1
    assert not torch.equal(moved.means, expected.means)


def test_an_isovalue_acts_on_the_tuned_f_sim() -> None:
    fitted = base()
    visual, place = of_isovalue(fitted), torch.tensor([0.3, -0.4])
    assert visual.simulation is not None
    tuned = visual.simulation.deformed(fitted.gaussians, place[:1])
    assert same(visual.gaussians_at(*fitted, place), visual.deformation.deformed(tuned, place))


@pytest.mark.parametrize("color_degree", [0, 1])
@pytest.mark.parametrize("moving", [3, 12])
def test_both_deformations_at_once_are_one_after_the_other_bit_for_bit(color_degree: int, moving: int) -> None:
    fitted, place = base(), torch.tensor([0.3, -0.4])
    visual = of_isovalue(fitted, color_degree)
    wide = fitted.gaussians.with_color_degree(1)
    of_vis = shaken(BilinearDeformation.create(wide, 2, SMALL, color_columns=moving))
    visual = replace(visual, deformation=of_vis)
    shown, rest = visual.gaussians_at(*fitted, place), visual.simulated(*fitted, place[:1])
    assert same(shown, of_vis.deformed(rest, place))
    assert shown.color_degree == max(color_degree, moving // 12)
    expected = of_vis.offsets(rest, place).applied_to(rest)
    for name in NAMES:  # the definition in float32: some roundings of numbers of size 10
        torch.testing.assert_close(getattr(shown, name), getattr(expected, name), rtol=0, atol=1e-5)


def test_a_wider_colour_shows_the_same_picture_at_the_base() -> None:
    fitted = base()
    camera = Normalization.of_box(BLOBS.bounds).camera(BLOBS.cameras()[3])
    wide = fitted.at(torch.tensor([0.3])).with_color_degree(1)
    assert wide.color_degree == 1
    drawn, expected = (Rasterizer().draw(g, camera) for g in (wide, fitted.at(torch.tensor([0.3]))))
    assert torch.equal(drawn.color, expected.color)


def test_any_transfer_function_can_be_asked_of_values() -> None:
    fitted = base()
    visual, place = of_functions(fitted), torch.tensor([0.3])
    assert isinstance(visual.deformation, ValuesDeformation)
    found = visual.under(*fitted, place, OTHER)
    assert same(found, visual.deformation.under(fitted.at(place), OTHER))
    assert same(visual.under(*fitted, place, FUNCTION), fitted.at(place))


@pytest.mark.parametrize("kind", ["values", "isovalue"])
def test_it_survives_its_record(kind: str) -> None:
    fitted = base()
    visual = of_isovalue(fitted, 1) if kind == "isovalue" else of_functions(fitted)
    loaded = Visualization.load(visual.stored(), json.loads(json.dumps(visual.record())))
    place = torch.tensor([0.3, *ELSEWHERE[: len(visual.variation.space)]])
    assert same(loaded.gaussians_at(*fitted, place), visual.gaussians_at(*fitted, place))
    assert loaded.variation == visual.variation
    assert loaded.color_degree == visual.color_degree
    assert (loaded.simulation is None) == (visual.simulation is None)


@pytest.mark.parametrize("kind", ["values", "isovalue"])
def test_some_of_its_gaussians_look_as_before(kind: str) -> None:
    fitted, rows = base(), torch.tensor([5, 0, 7])
    visual = of_isovalue(fitted) if kind == "isovalue" else of_functions(fitted)
    place = torch.tensor([0.3, *ELSEWHERE[: len(visual.variation.space)]])
    whole, some = visual.gaussians_at(*fitted, place), visual.of(rows).gaussians_at(*fitted.of(rows), place)
    for name in NAMES:
        torch.testing.assert_close(getattr(some, name), getattr(whole, name)[rows], rtol=0, atol=1e-6)


@pytest.mark.parametrize("kind", ["values", "isovalue"])
def test_a_copy_has_tensors_of_its_own(kind: str) -> None:
    fitted = base()
    visual = of_isovalue(fitted) if kind == "isovalue" else of_functions(fitted)
    copied, kept = visual.copy(), {name: t.clone() for name, t in visual.stored().items()}
    for part in (copied.deformation, copied.simulation):
        for tensor in part.tensors().values() if part is not None else ():
            tensor.add_(1.0)
    assert all(torch.equal(tensor, kept[name]) for name, tensor in visual.stored().items())


def test_hidden_isovalues_and_functions_stay_finite_on_extreme_gaussians() -> None:
    fitted = base()
    fitted.gaussians.opacity_logits[:4] = torch.tensor([-80.0, 80.0, -7.0, 14.0])
    visual = of_functions(fitted)
    for place in (AT_BASE, ELSEWHERE, [-1.0, 1.0, 1.0, -1.0]):
        shown = visual.gaussians_at(*fitted, torch.tensor([1.0, *place]))
        assert all(np.isfinite(array).all() for array in numbers(shown))
