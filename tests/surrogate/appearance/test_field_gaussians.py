"""Gaussians that carry values, beside blobs of one value each, of which any transfer function's pictures are known."""

from __future__ import annotations

import pickle
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from catalogs.vocabulary.appearance import TransferFunction, VolumeRendering
from surrogate import Surrogate
from surrogate.appearance.averages import LEAST_SPREAD
from surrogate.appearance.field_gaussians import FieldGaussians, FieldValues, load_gaussians
from surrogate.appearance.scale import ValueScale
from surrogate.deformation import BilinearDeformation
from surrogate.deformation.visualization import Visualization
from surrogate.gaussians import Normalization
from surrogate.model.rigid import in_camera
from surrogate.rasterizer import primitives
from surrogate.settings import TrainingSettings
from surrogate.training.state import FittedGaussians
from tests.support.field_blobs import BLOBS, FUNCTION, FUNCTIONS
from tests.support.visualizations import shaken, surrogate

OTHERS = {
    "base": FUNCTION,
    "half as opaque": replace(FUNCTION, opacity_points=tuple((v, o / 2.0) for v, o in FUNCTION.opacity_points)),
    "other unit": replace(FUNCTION, opacity_unit_distance=0.9),
    "other colours": replace(FUNCTION, color_points=((0.0, 0.9, 0.1, 0.1), (3.0, 0.1, 0.9, 0.4))),
    "a ramp down": replace(FUNCTION, opacity_points=((0.0, 0.7), (3.0, 0.1))),
    "points beyond the knots": replace(FUNCTION, opacity_points=((-4.0, 0.1), (7.0, 0.8))),
    "nothing": replace(FUNCTION, opacity_points=((0.0, 0.0), (3.0, 0.0))),
}


def carried(p: float = 0.4, spread: float = LEAST_SPREAD) -> FieldGaussians:
    """The blobs of one value each, 1.5 unit distances thick."""
    plain, scale = BLOBS.gaussians(p), ValueScale.of_function(FUNCTION)
    values = torch.zeros(len(plain), 2)  # [N, 2]
    values[:, 0] = torch.from_numpy(scale.places(BLOBS.values))
    values[:, 1] = float(np.log(spread))
    thickness = torch.full((len(plain),), 1.5)  # [N]
    logits = thickness.expm1().log()  # [N]
    return FieldGaussians(plain.means, plain.log_scales, plain.quats, logits, values, FieldValues(FUNCTION, scale))


def fitted() -> FittedGaussians:
    gaussians = carried()
    return FittedGaussians(
        gaussians, shaken(BilinearDeformation.create(gaussians, 1, TrainingSettings(latent_size=4, hidden_width=8)))
    )


@pytest.mark.parametrize("name", OTHERS)
def test_they_look_as_a_function_says(name: str) -> None:
    function = OTHERS[name]
    drawn, truth = carried().drawn(function), BLOBS.shown(0.4, VolumeRendering("any", function))
    relative = FUNCTION.opacity_unit_distance / function.opacity_unit_distance
    depths = relative * torch.nn.functional.softplus(truth.opacity_logits)  # [N], those of blobs are per unit distance
    assert torch.equal(drawn.means, truth.means)
    np.testing.assert_allclose(torch.nn.functional.softplus(drawn.opacity_logits), depths, atol=0.02)
    shown = depths > 0.02
    np.testing.assert_allclose(drawn.colors[shown], truth.colors[shown], atol=0.02)


def test_a_wide_spread_shows_what_narrow_ones_show_on_average() -> None:
    wide = carried(spread=0.2).drawn()
    places = carried().field.scale.places(BLOBS.values)  # [N]
    expected = np.zeros((len(wide), 4))
    for shift in np.linspace(-4.0, 4.0, 801):
        values = carried().field.scale.values(places + 0.2 * shift)
        extinctions = -np.log1p(-np.minimum(FUNCTION.opacities(values), 0.999))  # [N]
        columns = extinctions[:, None] * np.concatenate([np.ones((len(values), 1)), FUNCTION.colors(values)], axis=1)
        expected += np.exp(-0.5 * shift**2) / np.sqrt(2.0 * np.pi) * 0.01 * columns
    depths = torch.nn.functional.softplus(wide.opacity_logits)  # [N]
    np.testing.assert_allclose(depths, 1.5 * expected[:, 0], rtol=2e-3)
    np.testing.assert_allclose(wide.colors, expected[:, 1:] / expected[:, :1], atol=2e-3)


def test_what_is_stored_is_read_again(tmp_path: Path) -> None:
    model = surrogate(fitted())
    model.save(tmp_path)
    again = Surrogate.load(tmp_path)
    camera = BLOBS.cameras()[0]
    for function in OTHERS.values():
        expected = model.under(function, p=0.3).render(camera)
        np.testing.assert_array_equal(again.under(function, p=0.3).render(camera), expected)
        np.testing.assert_array_equal(pickle.loads(pickle.dumps(model)).under(function, p=0.3).render(camera), expected)
    np.testing.assert_array_equal(again.at(p=0.3).render(camera), model.under(FUNCTION, p=0.3).render(camera))


def test_float64_draws_the_same() -> None:
    model = surrogate(fitted())
    camera = BLOBS.cameras()[1]
    exact = model.differentiable(dtype=torch.float64)({"p": 0.7}, camera).detach()
    np.testing.assert_allclose(model.at(p=0.7).render(camera), exact.clamp(0.0, 1.0), atol=2e-3)


def test_everything_that_is_carried_has_a_gradient() -> None:
    model = surrogate(fitted()).differentiable()
    model({"p": torch.tensor(0.7)}, BLOBS.cameras()[1]).square().sum().backward()
    for name, parameter in model.named_parameters():
        assert parameter.grad is not None, name
        assert parameter.grad.isfinite().all(), name
        assert parameter.grad.any(), name


def needles() -> FieldGaussians:
    """The same, along z twenty times as long as they are wide."""
    gaussians, upright = carried(), torch.tensor([1.0, 0.0, 0.0, 0.0]).repeat(len(carried()), 1)
    return replace(gaussians, log_scales=gaussians.log_scales[:, :1] + torch.tensor([0.0, 0.0, 3.0]), quats=upright)


def test_needles_are_more_opaque_along_their_axis_and_those_of_earlier_models_alike() -> None:
    record = needles().record()["field"]
    earlier = load_gaussians(needles().tensors(), {k: v for k, v in record.items() if k != "medium"}).drawn()
    now = load_gaussians(needles().tensors(), record).drawn()
    side, end = torch.tensor([9.0, 0.0, 0.0]), torch.tensor([0.0, 0.0, 9.0])
    assert torch.equal(earlier.opacities_from(side), earlier.opacities_from(end))
    assert (now.opacities_from(end) > now.opacities_from(side)).all()
    kept = (now.of(torch.arange(len(now))), now.to(torch.float32), now.copy())
    assert all(torch.equal(other.opacities_from(end), now.opacities_from(end)) for other in kept)


def test_gradients_by_the_pose_know_of_the_rays() -> None:
    drawn, camera = needles().drawn().to(torch.float64), BLOBS.cameras()[1]
    here = Normalization(np.zeros(3), 1.0)
    pose = torch.tensor(camera.world_to_camera)

    def opacities(shift: torch.Tensor) -> torch.Tensor:
        moved = torch.cat([pose[:, :3], pose[:, 3:] + torch.nn.functional.pad(shift, (0, 1))[:, None]], dim=1)
        return in_camera(drawn, here, moved).opacities

    at_rest = torch.zeros(3, dtype=torch.float64, requires_grad=True)
    torch.testing.assert_close(opacities(at_rest), primitives(drawn, camera).opacities, rtol=1e-6, atol=0.0)
    assert torch.autograd.gradcheck(opacities, at_rest)


@pytest.mark.parametrize("medium", [1, "yes", None])
def test_a_medium_is_one_or_not(medium: Any) -> None:
    with pytest.raises(ValueError, match="medium must be true or false"):
        load_gaussians(carried().tensors(), carried().record()["field"] | {"medium": medium})


def test_a_gradient_by_the_function_is_refused() -> None:
    model = surrogate(fitted(), Visualization(FUNCTIONS, None)).differentiable()
    name = FUNCTIONS.argument_names[0]
    model({"p": torch.tensor(0.7, requires_grad=True), name: 0.1}, BLOBS.cameras()[1]).sum().backward()
    with pytest.raises(ValueError, match=f"no gradient by {name}"):
        model({"p": 0.7, name: torch.tensor(0.1, requires_grad=True)}, BLOBS.cameras()[1])


@pytest.mark.parametrize(
    ("change", "complaint"),
    [
        ({"values": torch.zeros(12, 3)}, r"values must be of shape \(12, 2\)"),
        ({"opacity_logits": torch.zeros(12, 1)}, r"opacity_logits must be of shape \(12,\)"),
        ({"colors": torch.zeros(12, 3)}, "they must consist of"),
    ],
)
def test_tensors_that_do_not_fit_are_named(change: dict[str, Any], complaint: str) -> None:
    with pytest.raises(ValueError, match=complaint):
        load_gaussians(carried().tensors() | change, carried().record()["field"])


def test_colours_know_no_functions() -> None:
    with pytest.raises(ValueError, match="carry colours and know no transfer functions"):
        BLOBS.gaussians(0.1).drawn(FUNCTION)


def test_few_tables_are_kept() -> None:
    field = carried().field
    functions = [TransferFunction(FUNCTION.color_points, ((0.0, 0.0), (3.0, i / 400)), 1.0) for i in range(1, 301)]
    tables = [field.table(function) for function in functions]
    assert field.table(functions[-1]) is tables[-1]
    assert field.table(functions[0]) is not tables[0]
