"""Gradients of pictures, against finite differences of the float64 twin; those of the kernels against the twin's."""

from __future__ import annotations

import copy
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import torch
from torch import Tensor

from catalogs.vocabulary.cameras import Camera
from catalogs.vocabulary.parameters import Parameter, ParameterSpace
from surrogate import Surrogate, look_at
from surrogate.lighting import Lighting
from surrogate.rasterizer import Rasterizer
from tests.support.field_blobs import BLOBS
from tests.support.surrogates import CENTER, EXTENT, some_surrogate
from tests.support.visualizations import base, of_functions, of_isovalue, surrogate

F64 = torch.float64
CAMERA = Camera.look_at(CENTER + np.array([90.0, 120.0, 60.0]), CENTER, vertical_fov_degrees=35, width=12, height=10)
NEAR = Camera.look_at(CENTER + np.array([0.2 * EXTENT, 0.0, 0.0]), CENTER, vertical_fov_degrees=60, width=12, height=10)
AWAY = Camera.look_at(CENTER + 200.0, CENTER + 400.0, vertical_fov_degrees=35, width=12, height=10)
VIEWS = [pytest.param(CAMERA, id="outside"), pytest.param(NEAR, id="among the Gaussians")]


def plain() -> Surrogate:
    return replace(some_surrogate(12), rasterizer=Rasterizer())


def logarithmic() -> Surrogate:
    space = ParameterSpace((Parameter("Re", 15.0, 2500.0, scale="log"), Parameter("time", 0.0, 2.0)))
    return replace(plain(), space=space)


def varied() -> Surrogate:
    fitted = base()
    return surrogate(fitted, of_isovalue(fitted, 1), of_functions(fitted))


def loss_of(picture: Tensor) -> Tensor:
    """A number that weighs every channel of every pixel differently."""
    weights = torch.linspace(-1.0, 2.0, picture.numel(), dtype=F64).reshape(picture.shape)
    return (picture.double() * weights).sum() + picture.double().square().sum()


def differences(f: Callable[[Tensor], Tensor], at: Tensor, step: float) -> Tensor:
    """Central differences of a scalar function by each of the numbers of `at`."""
    found = torch.zeros_like(at)
    with torch.no_grad():
        for k in range(at.numel()):
            moved = torch.zeros_like(at).view(-1)
            moved[k] = step
            moved = moved.view_as(at)
            found.view(-1)[k] = (f(at + moved) - f(at - moved)) / (2.0 * step)
    return found


def gradient(f: Callable[[Tensor], Tensor], at: Tensor) -> Tensor:
    place = at.clone().requires_grad_()
    f(place).backward()
    assert place.grad is not None
    return place.grad


@pytest.mark.parametrize("camera", VIEWS)
@pytest.mark.parametrize("make", [plain, logarithmic])
def test_gradients_by_parameters_are_finite_differences(make: Any, camera: Camera) -> None:
    model = make().differentiable(dtype=F64, edges=False).requires_grad_(False)
    at = torch.tensor([1830.0, 0.9], dtype=F64)
    scale = torch.tensor([500.0, 1.0], dtype=F64)  # so that both have derivatives of about one size

    def f(x: Tensor) -> Tensor:
        return loss_of(model(x * scale, camera))

    found, expected = gradient(f, at / scale), differences(f, at / scale, 1e-7)
    assert expected.abs().max() > 1e-3
    torch.testing.assert_close(found, expected, rtol=1e-5, atol=1e-6 * float(expected.abs().max()))


@pytest.mark.parametrize("make", [plain, logarithmic])
def test_second_derivatives_by_parameters_are_finite_differences(make: Any) -> None:
    model = make().differentiable(dtype=F64, edges=False).requires_grad_(False)
    scale = torch.tensor([500.0, 1.0], dtype=F64)
    at = (torch.tensor([1830.0, 0.9], dtype=F64) / scale).requires_grad_()

    def slope(x: Tensor, graph: bool) -> Tensor:
        return torch.autograd.grad(loss_of(model(x * scale, CAMERA)), x, create_graph=graph)[0][0]

    [found] = torch.autograd.grad(slope(at, True), at)
    steps = [torch.tensor(s, dtype=F64) for s in ([1e-5, 0.0], [0.0, 1e-5])]
    ends = [[slope((at.detach() + side * s).requires_grad_(), False) for side in (1.0, -1.0)] for s in steps]
    expected = torch.stack([(ahead - behind) / 2e-5 for ahead, behind in ends])
    assert expected.abs().max() > 1e-3
    torch.testing.assert_close(found, expected, rtol=1e-4, atol=1e-5 * float(expected.abs().max()))


@pytest.mark.parametrize(
    "asked", [{"isovalue": 0.23}, {"c1_value": 0.05, "c1_opacity": 0.04, "c2_value": -0.07, "c2_opacity": 0.1}], ids=str
)
def test_gradients_by_visualization_parameters_are_finite_differences(asked: dict[str, float]) -> None:
    model, camera = (
        varied().differentiable(dtype=F64, edges=False).requires_grad_(False),
        BLOBS.cameras()[3].resized(10, 10),
    )
    at = torch.tensor([0.3, *asked.values()], dtype=F64)

    def f(x: Tensor) -> Tensor:
        return loss_of(model(dict(zip(["p", *asked], x.unbind(0), strict=True)), camera))

    found, expected = gradient(f, at), differences(f, at, 1e-7)
    assert (expected.abs() > 1e-4).all()
    torch.testing.assert_close(found, expected, rtol=1e-4, atol=1e-5 * float(expected.abs().max()))


def moved(pose: Tensor, motion: Tensor) -> Tensor:
    """The pose after a rigid motion (6,): an angle around, and a shift along, each of the camera's axes."""
    a, b, c, x, y, z = motion.unbind(0)
    zero = torch.zeros_like(a)
    rows = [[zero, -c, b, x], [c, zero, -a, y], [-b, a, zero, z], [zero] * 4]
    return torch.linalg.matrix_exp(torch.stack([torch.stack(row) for row in rows])) @ pose


@pytest.mark.parametrize("camera", VIEWS)
def test_gradients_by_the_pose_are_finite_differences(camera: Camera) -> None:
    model = plain().differentiable(dtype=F64, edges=False).requires_grad_(False)
    pose, parameters = torch.tensor(camera.world_to_camera), torch.tensor([1830.0, 0.9], dtype=F64)
    units = torch.tensor([1.0, 1.0, 1.0, EXTENT, EXTENT, EXTENT], dtype=F64)

    def f(x: Tensor) -> Tensor:
        return loss_of(model(parameters, camera, pose=moved(pose, x * units)))

    at = 0.01 * torch.arange(6, dtype=F64)
    # The box lies 1e6 from the origin, where float64 resolves 1e-10: shorter steps drown in that.
    found, expected = gradient(f, at), differences(f, at, 1e-6)
    assert (expected.abs() > 1e-3).all()
    torch.testing.assert_close(found, expected, rtol=1e-4, atol=1e-5 * float(expected.abs().max()))


@pytest.mark.parametrize("camera", VIEWS)
@pytest.mark.parametrize("name", ["means", "log_scales", "quats", "opacity_logits", "colors", "deformation_latents"])
def test_gradients_by_gaussians_are_finite_differences(name: str, camera: Camera) -> None:
    model, parameters = plain().differentiable(dtype=F64, edges=False), torch.tensor([1830.0, 0.9], dtype=F64)
    loss_of(model(parameters, camera)).backward()
    tensor = model.get_parameter(name)
    found = tensor.grad
    assert found is not None
    chosen = found.abs().flatten().topk(5).indices
    for k in chosen.tolist():

        def f(x: Tensor, k: int = k) -> Tensor:
            with torch.no_grad():
                before = tensor.view(-1)[k].clone()
                tensor.view(-1)[k] = x
                loss = loss_of(model(parameters, camera))
                tensor.view(-1)[k] = before
            return loss

        expected = differences(f, tensor.detach().view(-1)[k].clone(), 1e-7)
        torch.testing.assert_close(found.view(-1)[k], expected, rtol=1e-4, atol=1e-6 * float(found.abs().max()))


@pytest.mark.parametrize("camera", VIEWS)
@pytest.mark.parametrize("make", [plain, logarithmic])
@pytest.mark.parametrize("edges", [True, False])
def test_the_kernels_gradients_are_those_of_the_twin(make: Any, camera: Camera, edges: bool) -> None:
    results = []
    for dtype in (torch.float32, F64):
        model = make().differentiable(dtype=dtype, edges=edges)
        parameters = torch.tensor([1830.0, 0.9], dtype=dtype, requires_grad=True)
        motion = torch.full((6,), 0.02, dtype=F64, requires_grad=True)
        pose = moved(torch.tensor(camera.world_to_camera), motion)
        loss_of(model(parameters, camera, pose=pose)).backward()
        results.append([parameters.grad, motion.grad, *(p.grad for p in model.parameters())])
    for single, double in zip(*results, strict=True):
        assert single is not None
        assert double is not None
        error = (single.double() - double).norm() / double.norm().clamp(min=1e-9)
        assert error < 1e-3, error


@pytest.mark.parametrize("background", [None, (1.0, 0.5, 0.0)])
@pytest.mark.parametrize("make", [plain, logarithmic])
def test_the_picture_is_that_of_the_surrogate_bit_for_bit(make: Any, background: Any) -> None:
    model = make()
    expected = model.at(Re=1830.0, time=0.4).render(CAMERA, background=background)
    found = model.differentiable()(torch.tensor([1830.0, 0.4], dtype=F64), CAMERA, background=background)
    np.testing.assert_array_equal(found.detach().clamp(0.0, 1.0).numpy(), expected)


def test_pictures_of_surfaces_are_those_of_the_surrogate_however_many_samples_they_have() -> None:
    fitted, camera = base(), BLOBS.cameras()[3].resized(10, 10)
    lighting = Lighting((0.9, 0.5, 0.2), 0.2, 0.7, 0.1, 20.0)
    surfaces = replace(of_isovalue(fitted), simulation=None, gaussians=fitted.gaussians, lighting=lighting)
    model = replace(surrogate(fitted, surfaces), rasterizer=Rasterizer(surface_samples=2))
    expected = model.at(p=0.3, isovalue=0.23).render(camera)
    found = model.differentiable()({"p": 0.3, "isovalue": 0.23}, camera)
    np.testing.assert_array_equal(found.detach().clamp(0.0, 1.0).numpy(), expected)
    coarse = replace(model, rasterizer=Rasterizer()).at(p=0.3, isovalue=0.23).render(camera)
    assert abs(coarse - expected).max() > 1e-3


def test_a_pose_is_that_of_a_camera() -> None:
    model, parameters = plain(), {"Re": 1830.0, "time": 0.4}
    expected = model.at(**parameters).render(CAMERA)
    for camera in (CAMERA, NEAR):  # only the pose counts
        found = model.differentiable()(
            parameters, replace(camera, fx=CAMERA.fx, fy=CAMERA.fy), pose=torch.tensor(CAMERA.world_to_camera)
        )
        np.testing.assert_allclose(found.detach().clamp(0.0, 1.0).numpy(), expected, atol=2e-5)
    looking = look_at(torch.tensor(CENTER + np.array([90.0, 120.0, 60.0])), torch.tensor(CENTER))
    np.testing.assert_allclose(looking.numpy(), CAMERA.world_to_camera, atol=1e-8)


def test_any_rotation_becomes_a_pose() -> None:
    """Also half turns, where a quaternion's first component is zero."""
    model, parameters = plain().differentiable(), {"Re": 1830.0, "time": 0.4}
    for direction in np.vstack([np.eye(3), -np.eye(3), [[1.0, 1.0, 0.3], [-1.0, 1.0, -0.3]]]):
        up = (0.0, 1.0, 0.0) if abs(direction[2]) == 1.0 else (0.0, 0.0, -1.0)
        place = CENTER + 170.0 * direction
        camera = Camera.look_at(place, CENTER, vertical_fov_degrees=30, width=9, height=9, up=up)
        found = model(parameters, camera, pose=torch.tensor(camera.world_to_camera)).detach()
        expected = model(parameters, camera).detach()
        torch.testing.assert_close(found, expected, atol=5e-5, rtol=0.0)


@pytest.mark.parametrize("dtype", [torch.float32, F64])
@pytest.mark.parametrize("with_pose", [False, True])
def test_an_empty_picture_has_gradients_of_zero(dtype: torch.dtype, with_pose: bool) -> None:
    model = plain().differentiable(dtype=dtype)
    parameters = torch.tensor([1830.0, 0.9], dtype=dtype, requires_grad=True)
    pose = torch.tensor(AWAY.world_to_camera, requires_grad=True) if with_pose else None
    picture = model(parameters, AWAY, pose=pose)
    assert not picture.detach().any()
    picture.sum().backward()
    for tensor in [parameters, *model.parameters(), *([] if pose is None else [pose])]:
        assert tensor.grad is not None
        assert not tensor.grad.any()


def test_what_is_behind_the_camera_has_gradients_of_zero() -> None:
    made = plain()
    made.gaussians.means[:5] = torch.from_numpy(2.0 * (NEAR.position - CENTER) / EXTENT).float()
    model = made.differentiable()
    model({"Re": 1830.0, "time": 0.9}, NEAR, pose=torch.tensor(NEAR.world_to_camera)).sum().backward()
    gradients = {name: tensor.grad for name, tensor in model.named_parameters()}
    for name in ("means", "log_scales", "quats", "opacity_logits", "colors"):
        found = gradients[name]
        assert found is not None
        assert torch.isfinite(found).all()
        assert not found[:5].any()
        assert found[5:].any()


def test_a_parameter_is_recovered_from_a_picture() -> None:
    made = plain()
    target = torch.from_numpy(made.at(Re=2210.0, time=0.5).render(CAMERA))
    model = made.differentiable().requires_grad_(False)
    low, ranges = torch.tensor([1500.0, 0.0]), torch.tensor([1000.0, 2.0])
    share = torch.tensor([0.2, 0.6], requires_grad=True)  # of the range
    optimizer = torch.optim.LBFGS([share], max_iter=60, line_search_fn="strong_wolfe")

    def closure() -> Tensor:
        optimizer.zero_grad()
        loss = 1e4 * (model(low + ranges * share, CAMERA) - target).square().mean()
        loss.backward()
        return loss

    optimizer.step(closure)
    np.testing.assert_allclose((low + ranges * share).detach().numpy(), [2210.0, 0.5], rtol=0.01)


def test_a_camera_is_recovered_from_a_picture() -> None:
    made, parameters = plain(), {"Re": 1830.0, "time": 0.4}
    target = torch.from_numpy(made.at(**parameters).render(CAMERA))
    model = made.differentiable().requires_grad_(False)
    position = torch.tensor(CAMERA.position + np.array([6.0, -5.0, 4.0]), requires_grad=True)
    optimizer = torch.optim.Adam([position], lr=1.0)
    for k in range(80):
        optimizer.param_groups[0]["lr"] = 0.95**k
        optimizer.zero_grad()
        (model(parameters, CAMERA, pose=look_at(position, torch.tensor(CENTER))) - target).square().mean().backward()
        optimizer.step()
    np.testing.assert_allclose(position.detach().numpy(), CAMERA.position, atol=0.5)


def test_a_module_is_a_copy_that_can_be_copied() -> None:
    made = plain()
    model = made.differentiable()
    with torch.no_grad():
        model.get_parameter("means").add_(1.0)
    assert not torch.equal(made.gaussians.means, model.get_parameter("means"))
    parameters = {"Re": 1830.0, "time": 0.4}
    again = copy.deepcopy(model)
    torch.testing.assert_close(again(parameters, CAMERA), model(parameters, CAMERA), rtol=0.0, atol=0.0)
    fresh = made.differentiable()
    fresh.load_state_dict(model.state_dict())
    torch.testing.assert_close(fresh(parameters, CAMERA), model(parameters, CAMERA), rtol=0.0, atol=0.0)
    assert (
        repr(model)
        == "<DifferentiableSurrogate of Re in [1500, 2500], time in [0, 2] s: 30 Gaussians, torch.float32, cpu>"
    )


@pytest.mark.parametrize(
    ("parameters", "options", "complaint"),
    [
        (torch.zeros(3), {}, r"tensor of shape \(2,\), for Re, time"),
        (3.0, {}, "or a mapping of names, got float"),
        ({"Re": 1830.0}, {}, r"missing time"),
        ({"Re": torch.tensor([1.0, 2.0]), "time": 1.0}, {}, "parameter Re must be one number"),
        (torch.tensor([float("nan"), 1.0]), {}, "Re must be"),
        (torch.tensor([1e9, 1.0]), {}, "too far outside its bounds"),
        (torch.tensor([1830.0, 1.0]), {"background": (0, 0)}, "background"),
        (torch.tensor([1830.0, 1.0]), {"pose": torch.eye(3)}, r"pose must be a tensor \(4, 4\)"),
        (torch.tensor([1830.0, 1.0]), {"pose": 2.0 * torch.eye(4)}, "must hold a rotation"),
        (torch.tensor([1830.0, 1.0]), {"pose": torch.full((4, 4), float("nan"))}, "finite 4x4"),
    ],
)
def test_what_can_not_be_drawn_is_named(parameters: Any, options: Any, complaint: str) -> None:
    with pytest.raises(ValueError, match=complaint):
        plain().differentiable()(parameters, CAMERA, **options)


def test_precisions_and_devices_that_there_are_not_are_named() -> None:
    with pytest.raises(ValueError, match=r"torch\.float32 or torch\.float64, got torch\.float16"):
        plain().differentiable(dtype=torch.float16)
    with pytest.raises(ValueError, match='device must be "cpu" or "cuda"'):
        plain().differentiable("meta")
