"""Gradients of pictures of an emulated field: against finite differences, against the float64 reference, and what has none."""

from __future__ import annotations

import copy
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest
import torch
from torch import Tensor

from catalogs.vocabulary.appearance import Appearance, Isosurface, TransferFunction, VolumeRendering
from catalogs.vocabulary.cameras import Camera
from catalogs.vocabulary.parameters import Parameter, ParameterSpace
from catalogs.vocabulary.variations.isovalue import isovalue_family
from surrogate import Surrogate
from surrogate.emulation import EmulatedFields, FieldEmulator
from surrogate.gaussians import Normalization
from surrogate.model import DifferentiableChoice, DifferentiableField, DifferentiableSurrogate, FieldModel
from surrogate.model.form import without_gaussians
from surrogate.model.representation import BOTH, FIELD, GAUSSIANS, RepresentationScores
from tests.support.surrogates import some_surrogate

F64 = torch.float64
SPACING, SIZE = 0.1, 9
FUNCTION = TransferFunction(((0.0, 0.0, 0.0, 1.0), (1.0, 1.0, 0.2, 0.0)), ((0.1, 0.0), (0.5, 0.3), (1.0, 0.6)), 0.2)
OTHER = TransferFunction(((0.0, 1.0, 0.0, 0.0), (1.0, 0.0, 1.0, 0.0)), ((0.0, 0.1), (0.9, 0.7)), 0.3)
CAMERA = Camera.look_at((2.0, 1.6, 1.2), (0.4, 0.4, 0.4), vertical_fov_degrees=30, width=12, height=10)
INSIDE = Camera.look_at((0.5, 0.4, 0.3), (0.0, 0.0, 0.0), vertical_fov_degrees=60, width=12, height=10)
AWAY = Camera.look_at((2.0, 2.0, 2.0), (4.0, 4.0, 4.0), vertical_fov_degrees=30, width=12, height=10)
SPACE = ParameterSpace((Parameter("Re", 10.0, 2500.0, scale="log"), Parameter("time", 0.0, 2.0)))
AT = torch.tensor([300.0, 0.9], dtype=F64)
SCALES = torch.tensor([200.0, 1.0], dtype=F64)  # so that both parameters have derivatives of about one size


def values_at(point: Any) -> np.ndarray:
    """A field (9, 9, 9) between 0 and 1 at a normalized point (2,)."""
    z, y, x = np.meshgrid(*[np.linspace(-1.0, 1.0, SIZE)] * 3, indexing="ij")
    first, second = point
    bump = np.exp(-((x - 0.3 * first) ** 2 + y**2 + (z + 0.2 * second) ** 2))
    return np.asarray((0.6 + 0.2 * second) * bump, dtype=np.float32)


@cache
def emulator_of(holes: Callable[[Any], Any] | None, values: Callable[[Any], np.ndarray]) -> FieldEmulator:
    """An emulator of ten members, `holes` by their points."""
    points = np.random.default_rng(1).uniform(-1.0, 1.0, (10, 2))
    fields = np.stack([values(point) for point in points])
    for field, point in zip(fields, points, strict=True):
        if holes is not None:
            field[holes(point)] = np.nan
    return FieldEmulator.fit(points, fields, (SPACING,) * 3, (0.0,) * 3)


def field_model(
    appearance: Appearance | None = None,
    holes: Callable[[Any], Any] | None = None,
    values: Callable[[Any], np.ndarray] = values_at,
    **changes: Any,
) -> FieldModel:
    """The emulator of ten members in a model."""
    emulator = emulator_of(holes, values)
    shown = appearance or VolumeRendering("dvr", FUNCTION)
    normalization = Normalization(np.full(3, 0.4), 0.8)
    model = FieldModel(EmulatedFields(SPACE, {"": emulator}), (shown,), (), normalization, training={"fingerprint": ""})
    return replace(model, **{"sample_distances": {"dvr": 0.04}, **changes})


def alone(**changes: Any) -> Surrogate:
    """A surrogate without Gaussians."""
    model = field_model(**changes)
    return Surrogate(**without_gaussians(model), field=model)


def cube(point: Any) -> Any:
    return np.s_[2:4, 3:5, 2:5]


def growing(point: Any) -> Any:
    return np.s_[2 : (4 if point[0] < 0.0 else 6), 3:5, 2:5]


def shaded() -> VolumeRendering:
    return VolumeRendering("dvr", FUNCTION, shaded=True)


def flat(point: Any) -> np.ndarray:
    return np.full((SIZE,) * 3, 0.4, np.float32)


def loss_of(picture: Tensor) -> Tensor:
    """A number that weighs every channel of every pixel differently."""
    weights = torch.linspace(-1.0, 2.0, picture.numel(), dtype=F64).reshape(picture.shape)
    return (picture.double() * weights).sum() + picture.double().square().sum()


def gradient(model: torch.nn.Module, at: Tensor, camera: Camera, **options: Any) -> Tensor:
    place = at.clone().requires_grad_()
    loss_of(model(place * SCALES, camera, **options)).backward()
    assert place.grad is not None
    return place.grad


def differences(model: torch.nn.Module, at: Tensor, camera: Camera, step: float, **options: Any) -> Tensor:
    """Central differences by each parameter over its scale."""
    steps = step * torch.eye(2, dtype=F64)
    with torch.no_grad():
        ends = [[loss_of(model((at + side * s) * SCALES, camera, **options)) for side in (1.0, -1.0)] for s in steps]
    return torch.stack([(ahead - behind) / (2.0 * step) for ahead, behind in ends])


CASES: dict[str, tuple[dict[str, Any], Camera, Tensor]] = {
    "ordinary": ({}, CAMERA, AT),
    "camera inside": ({}, INSIDE, AT),
    "holes": ({"holes": cube}, CAMERA, AT),
    "shaded": ({"appearance": shaded()}, CAMERA, AT),
    "shaded holes": ({"appearance": shaded(), "holes": cube}, CAMERA, AT),
    "at the lower bounds": ({}, CAMERA, torch.tensor([10.0, 0.0], dtype=F64)),
    "at the upper bounds": ({}, CAMERA, torch.tensor([2500.0, 2.0], dtype=F64)),
    "out of bounds": ({}, CAMERA, torch.tensor([4000.0, -0.3], dtype=F64)),
}


@pytest.mark.parametrize("name", CASES)
def test_gradients_by_parameters_are_finite_differences(name: str) -> None:
    changes, camera, at = CASES[name]
    model = alone(**changes).differentiable(dtype=F64)
    found = gradient(model, at / SCALES, camera)
    expected = differences(model, at / SCALES, camera, 1e-3)  # values are float32: shorter steps drown in that
    assert expected.abs().max() > 1e-3
    torch.testing.assert_close(found, expected, rtol=0.02, atol=5e-3 * float(expected.abs().max()))


@pytest.mark.parametrize("name", [name for name in CASES if "shaded" not in name])
def test_the_kernels_gradients_are_those_of_the_reference(name: str) -> None:
    changes, camera, at = CASES[name]
    surrogate = alone(**changes)
    single, double = (gradient(surrogate.differentiable(dtype=d), at / SCALES, camera) for d in (torch.float32, F64))
    torch.testing.assert_close(single, double, rtol=2e-3, atol=2e-3 * float(double.abs().max()))


@pytest.mark.parametrize("dtype", [torch.float32, F64])
def test_a_constant_field_and_an_empty_picture_have_gradients_of_zero(dtype: torch.dtype) -> None:
    assert not gradient(alone(values=flat).differentiable(dtype=dtype), AT / SCALES, CAMERA).any()
    assert not gradient(alone().differentiable(dtype=dtype), AT / SCALES, AWAY).any()


@pytest.mark.parametrize("dtype", [torch.float32, F64])
def test_gradients_by_control_points_are_finite_differences(dtype: torch.dtype) -> None:
    surrogate = alone()
    own = [torch.tensor([o for _, o in FUNCTION.opacity_points]), torch.tensor([c[1:] for c in FUNCTION.color_points])]
    asked = [tensor.to(dtype).clamp(0.1, 0.9).requires_grad_() for tensor in own]
    loss_of(surrogate.differentiable(dtype=dtype)(AT, CAMERA, opacities=asked[0], colors=asked[1])).backward()
    exact, step = surrogate.differentiable(dtype=F64), 1e-5
    for k, tensor in enumerate(asked):
        assert tensor.grad is not None
        for place in range(tensor.numel()):
            ends = []
            for side in (step, -step):
                moved = [t.detach().double().clone() for t in asked]
                moved[k].view(-1)[place] += side
                ends.append(loss_of(exact(AT, CAMERA, opacities=moved[0], colors=moved[1])))
            expected = (ends[0] - ends[1]) / (2.0 * step)
            tolerance = 2e-3 * float(tensor.grad.abs().max())
            assert float(tensor.grad.view(-1)[place]) == pytest.approx(float(expected), rel=5e-3, abs=tolerance)


@pytest.mark.parametrize("background", [None, (1.0, 0.5, 0.0)])
@pytest.mark.parametrize(
    "changes",
    [{}, {"holes": growing}, {"appearance": shaded()}, {"sample_distances": {}}],
    ids=lambda changes: ", ".join(changes) or "nothing",
)
def test_the_picture_is_that_of_the_surrogate_bit_for_bit(changes: Any, background: Any) -> None:
    surrogate = alone(**changes)
    model = surrogate.differentiable()
    expected = surrogate.at(Re=300.0, time=0.9).render(CAMERA, background=background)
    np.testing.assert_array_equal(model(AT, CAMERA, background=background).clamp(0.0, 1.0).numpy(), expected)
    under = surrogate.under(OTHER, Re=300.0, time=0.9).render(CAMERA, background=background)
    found = model(AT, CAMERA, background=background, transfer_function=OTHER)
    np.testing.assert_array_equal(found.clamp(0.0, 1.0).numpy(), under)
    posed = model(AT, replace(AWAY, fx=CAMERA.fx, fy=CAMERA.fy), pose=torch.tensor(CAMERA.world_to_camera))
    np.testing.assert_array_equal(posed.numpy(), model(AT, CAMERA).numpy())


def test_parameters_are_recovered_from_a_picture() -> None:
    surrogate = alone()
    target = torch.from_numpy(surrogate.at(Re=900.0, time=1.4).render(CAMERA))
    model = surrogate.differentiable()
    place = torch.tensor([np.log(100.0), 0.5], dtype=F64, requires_grad=True)
    optimizer = torch.optim.LBFGS([place], max_iter=60, line_search_fn="strong_wolfe")

    def closure() -> Tensor:
        optimizer.zero_grad()
        loss = 1e4 * (model({"Re": place[0].exp(), "time": place[1]}, CAMERA) - target).square().mean()
        loss.backward()
        return loss

    optimizer.step(closure)
    assert float(place[0].detach().exp()) == pytest.approx(900.0, rel=0.01)
    assert float(place[1].detach()) == pytest.approx(1.4, rel=0.01)


def surface() -> Any:
    return isovalue_family("dvr", train=(0.2, 0.6), validation=(), test=())


def with_surfaces() -> Surrogate:
    family = surface()
    model = field_model()
    model = replace(model, appearances=(*model.appearances, *family.appearances), variations=(family.variation,))
    return Surrogate(**without_gaussians(model), field=model)


REFUSED: list[tuple[Callable[[], Surrogate], dict[str, Any], str]] = [
    (
        lambda: alone(appearance=Isosurface("iso", 0.3)),
        {},
        "'iso' is an isosurface, whose pictures .* have no gradients",
    ),
    (lambda: alone(holes=growing), {}, "holes move with the parameters"),
    (lambda: alone(appearance=shaded()), {}, r"'dvr' is shaded.*differentiable\(dtype=torch.float64\)"),
    (
        alone,
        {"pose": torch.tensor(CAMERA.world_to_camera, requires_grad=True)},
        r"not by pose: .*using\(\"gaussians\"\)",
    ),
    (alone, {"pose": torch.eye(3)}, r"pose must be a tensor \(4, 4\)"),
    (alone, {"background": (0, 0)}, "background"),
    (alone, {"opacities": torch.zeros(2)}, r"opacities must be a tensor of shape \(3,\).* got \(2,\)"),
    (alone, {"colors": [1.0]}, r"colors must be a tensor of shape \(2, 3\).* got list"),
    (alone, {"opacities": torch.full((3,), 1.5)}, "opacity"),
    (lambda: alone(appearance=Isosurface("iso", 0.3)), {"opacities": torch.zeros(3)}, "no transfer function"),
]


@pytest.mark.parametrize(("make", "options", "complaint"), REFUSED)
def test_what_has_no_gradient_is_named(make: Callable[[], Surrogate], options: dict[str, Any], complaint: str) -> None:
    model = make().differentiable()
    with pytest.raises(ValueError, match=complaint):
        model(AT.clone().requires_grad_(), CAMERA, **options)


def test_pictures_without_gradients_are_drawn_all_the_same() -> None:
    for surrogate in (alone(appearance=Isosurface("iso", 0.3)), alone(holes=growing)):
        with torch.no_grad():
            picture = surrogate.differentiable()(AT.clone().requires_grad_(), CAMERA)
        np.testing.assert_array_equal(picture.numpy(), surrogate.at(Re=300.0, time=0.9).render(CAMERA))
    model = with_surfaces().differentiable()
    assert not model({"Re": 300.0, "time": 0.9, "isovalue": 0.4}, CAMERA).requires_grad
    with pytest.raises(ValueError, match="is an isosurface"):
        model({"Re": 300.0, "time": 0.9, "isovalue": torch.tensor(0.4, requires_grad=True)}, CAMERA)


def test_second_derivatives_and_other_devices_are_refused() -> None:
    place = AT.clone().requires_grad_()
    for dtype in (torch.float32, F64):
        picture = alone().differentiable(dtype=dtype)(place, CAMERA)
        with pytest.raises(RuntimeError, match="can be differentiated once only"):
            torch.autograd.grad(picture.square().sum(), place, create_graph=True)
    with pytest.raises(ValueError, match=r'drawn on "cpu", not on \'cuda\''):
        alone().differentiable("cuda")
    with pytest.raises(ValueError, match=r"got torch\.float16"):
        alone().differentiable(dtype=torch.float16)


def ensemble(**psnr: dict[str, float]) -> Surrogate:
    """Gaussians and an emulated field of the same parameters, with scores."""
    space = ParameterSpace((Parameter("Re", 10.0, 2500.0, scale="log"), Parameter("time", 0.0, 2.0)))
    model = field_model()
    gaussians = some_surrogate(12)
    return replace(
        gaussians, space=space, normalization=model.normalization, field=model, scores=RepresentationScores(psnr)
    )


@pytest.mark.parametrize(
    ("using", "psnr", "kind"),
    [
        ("", {}, DifferentiableSurrogate),
        ("", {"view": {FIELD: 40.0, GAUSSIANS: 30.0}}, DifferentiableField),
        ("", {"view": {FIELD: 40.0, GAUSSIANS: 30.0}, "transfer_function": {GAUSSIANS: 30.0}}, DifferentiableChoice),
        ("", {"view": {BOTH: 40.0}}, DifferentiableChoice),
        (GAUSSIANS, {"view": {FIELD: 40.0}}, DifferentiableSurrogate),
        (FIELD, {}, DifferentiableField),
        (BOTH, {}, DifferentiableChoice),
    ],
)
def test_pictures_are_those_of_at_whatever_draws(using: str, psnr: dict[str, dict[str, float]], kind: type) -> None:
    surrogate = ensemble(**psnr)
    surrogate = surrogate.using(using) if using else surrogate
    model = surrogate.differentiable()
    assert type(model) is kind
    assert repr(model).startswith(f"<{kind.__name__} of ")
    at = AT.clone().requires_grad_()
    picture = copy.deepcopy(model)(at, CAMERA)
    expected = surrogate.at(Re=300.0, time=0.9).render(CAMERA)
    np.testing.assert_array_equal(picture.detach().clamp(0.0, 1.0).numpy(), expected)
    picture.sum().backward()
    assert at.grad is not None
    assert at.grad.all()


def test_the_mean_image_has_the_mean_of_the_gradients() -> None:
    surrogate = ensemble()
    models = [surrogate.using(name).differentiable(dtype=F64) for name in (GAUSSIANS, FIELD, BOTH)]
    found = []
    for model in models:
        at = (AT / SCALES).requires_grad_()
        (model(at * SCALES, CAMERA) * torch.linspace(0.0, 1.0, 480, dtype=F64).reshape(10, 12, 4)).sum().backward()
        assert at.grad is not None
        found.append(at.grad)
    torch.testing.assert_close(found[2], 0.5 * (found[0] + found[1]), rtol=1e-5, atol=1e-9)
    assert len(models[2].state_dict()) == len(models[0].state_dict()) > len(models[1].state_dict()) == 0


def test_gaussians_have_no_gradient_by_control_points() -> None:
    with pytest.raises(
        ValueError, match=r"by Gaussians have no gradient by a function's control points.*using\(\"field\"\)"
    ):
        ensemble().differentiable()(AT, CAMERA, opacities=torch.zeros(3))
