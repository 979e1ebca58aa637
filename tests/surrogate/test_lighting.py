from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from catalogs.vocabulary.appearance import Isosurface, TransferFunction, VolumeRendering
from native import kernels
from surrogate import Surrogate
from surrogate.gaussians import Gaussians
from surrogate.lighting import Lighting
from surrogate.model.form import stored_form
from surrogate.splatting.directional import directions
from tests.support.comparing import same
from tests.support.field_blobs import BLOBS, ISOVALUE
from tests.support.kernel_calls import recorded
from tests.support.visualizations import base, of_isovalue, surrogate

GOLD = Isosurface("gold", 2.0, (0.95, 0.72, 0.35))
VOLUME = VolumeRendering("dvr", TransferFunction(((0, 0, 1, 0), (3, 1, 0, 1)), ((0, 0.9), (3, 0.1)), 0.5))


def gaussians(normals: torch.Tensor, lighting: Lighting | None) -> Gaussians:
    count = len(normals)
    return Gaussians(
        torch.zeros(count, 3),
        torch.zeros(count, 3),
        torch.ones(count, 4),
        torch.zeros(count),
        normals,
        lighting=lighting,
    )


@pytest.mark.parametrize("appearance", [GOLD, replace(GOLD, specular=0.0), replace(GOLD, specular_power=0.5)])
def test_colors_are_those_of_the_renderer_on_both_sides(appearance: Isosurface) -> None:
    """The formula of `render.isosurface.HEADLIGHT`, written again in numpy."""
    lighting = Lighting.of([appearance])
    assert lighting is not None
    angles = np.linspace(0.0, np.pi, 25)
    normals = torch.tensor(np.stack([np.sin(angles), np.zeros(25), np.cos(angles)], axis=1))
    found = gaussians(normals, lighting).colors_from(torch.tensor([0.0, 0.0, -2.0], dtype=torch.float64))
    facing = np.clip(np.abs(np.cos(angles)), 1e-6, 1.0)[:, None]
    expected = (appearance.ambient + appearance.diffuse * facing) * np.array(appearance.color)
    expected = np.clip(expected + appearance.specular * facing**appearance.specular_power, 0.0, 1.0)
    np.testing.assert_allclose(found.numpy(), expected, atol=1e-9)


@pytest.mark.parametrize("power", [0.0, 0.5, 1.0, 20.0])
def test_gradients_are_finite_however_a_surface_lies(power: float) -> None:
    lighting = Lighting((0.9, 0.7, 0.3), 0.1, 0.7, 0.2, power)
    normals = torch.tensor([[0.0, 0, 0], [1, 0, 0], [0, 0, 5], [0, 0, 1e-30]], requires_grad=True)
    lighting.colors(normals, torch.tensor([[0.0, 0, 1]]).expand(4, 3)).sum().backward()
    assert torch.isfinite(normals.grad).all()
    inner = torch.tensor([[0.3, 0.2, 0.4]], dtype=torch.float64, requires_grad=True)
    towards = torch.nn.functional.normalize(torch.tensor([[0.3, -0.5, 0.7]], dtype=torch.float64), dim=1)
    assert torch.autograd.gradcheck(lambda n: lighting.colors(n, towards), inner)


def test_only_surfaces_that_are_lit_alike_have_a_light() -> None:
    assert Lighting.of([GOLD, replace(GOLD, name="other", isovalue=3.0)]) == Lighting.of([GOLD])
    assert Lighting.of([GOLD, replace(GOLD, diffuse=0.5)]) is None
    assert Lighting.of([GOLD, VOLUME]) is None
    assert Lighting.of([]) is None


@pytest.mark.parametrize(
    ("change", "error"),
    [
        ({"specular": -0.1}, "lighting specular must not be negative, got -0.1"),
        ({"color": [0.1, 2.0, 0.3]}, "lighting color"),
        ({"ambient": float("nan")}, "lighting ambient"),
        ({"shine": 1.0}, "lighting must consist of"),
    ],
)
def test_a_lighting_that_can_not_be_is_refused(change: dict[str, object], error: str) -> None:
    lighting = Lighting.of([GOLD])
    assert lighting is not None
    assert Lighting.from_json(lighting.to_json()) == lighting
    with pytest.raises(ValueError, match=error):
        Lighting.from_json(lighting.to_json() | change)


def test_pictures_say_whether_they_are_lit_so() -> None:
    lighting, random = Lighting.of([GOLD]), np.random.default_rng(0)
    assert lighting is not None
    facing = torch.tensor(random.uniform(0.0, 1.0, (500, 1)))
    lit = lighting.colors(facing, torch.ones_like(facing)).numpy()
    half = (lit + lit[::-1]) / 2.0  # as at the edges of surfaces before others
    for shown in (lit, half, np.round(255 * lit) / 255):
        assert lighting.explains(shown)
    for shown in (lit[:, ::-1], random.uniform(0, 1, (500, 3)), np.full((500, 3), 0.5), np.zeros((0, 3))):
        assert not lighting.explains(shown)


def test_gaussians_keep_their_light() -> None:
    lit = gaussians(torch.randn(4, 3), Lighting.of([GOLD]))
    for other in (lit.copy(), lit.to(torch.float64), lit.of(torch.tensor([1, 2]))):
        assert other.lighting == lit.lighting


def test_a_surrogate_with_surfaces_of_their_own_is_kept_and_shown(tmp_path: Path) -> None:
    fitted = base()
    shared = of_isovalue(fitted)
    own = replace(shared, gaussians=fitted.gaussians.copy(), simulation=None, lighting=Lighting.of([GOLD]))
    model, camera = surrogate(fitted, own), BLOBS.cameras()[2]
    model.save(tmp_path)
    loaded = Surrogate.load(tmp_path)
    isovalue = ISOVALUE.settings[0].values[0]
    seen = model.at(p=0.3, isovalue=isovalue)
    assert same(loaded.at(p=0.3).gaussians, surrogate(fitted, shared).at(p=0.3).gaussians)
    np.testing.assert_array_equal(loaded.at(p=0.3, isovalue=isovalue).render(camera), seen.render(camera))
    module = model.differentiable()
    picture = module({"p": 0.3, "isovalue": torch.tensor(isovalue, requires_grad=True)}, camera)
    np.testing.assert_allclose(np.clip(picture.detach().numpy(), 0, 1), seen.render(camera), atol=1e-6)
    picture.sum().backward()
    assert any("gaussians" in n and t.grad is not None and t.grad.abs().sum() > 0 for n, t in module.named_parameters())
    assert model.digest == loaded.digest


def test_a_model_whose_own_gaussians_do_not_fit_is_refused() -> None:
    fitted = base()
    own = replace(of_isovalue(fitted), gaussians=fitted.gaussians.of(torch.arange(3)), simulation=None)
    broken = surrogate(fitted, own)
    with pytest.raises(ValueError, match="latents must have a row for each of 3 Gaussians"):
        Surrogate.of_bytes(*stored_form(broken).contents())


POSITION = torch.tensor([0.4, -3.0, 1.2])
POWERS = [0.0, 0.5, 1.0, 20.0, 300.0]


def surfaces(count: int, seed: int = 0, longest: float = 1.2) -> tuple[torch.Tensor, torch.Tensor]:
    """Means and normals (N, 3), some longer than 1."""
    random = np.random.default_rng(seed)
    normals = random.normal(size=(count, 3))
    normals *= random.uniform(0.0, longest, (count, 1)) / np.linalg.norm(normals, axis=1, keepdims=True)
    return torch.from_numpy(random.uniform(-1.0, 1.0, (count, 3))).float(), torch.from_numpy(normals).float()


def lit_gradients(lighting: Lighting, tensors: tuple[torch.Tensor, ...], upstream: torch.Tensor) -> list[torch.Tensor]:
    leaves = [tensor.clone().requires_grad_() for tensor in tensors]
    found = lighting.colors_from(*leaves, POSITION.to(leaves[0].dtype))
    return list(torch.autograd.grad((found * upstream.to(found)).sum(), leaves))


@pytest.mark.parametrize("power", POWERS)
@pytest.mark.parametrize("longest", [1e-7, 0.9, 1.2])
def test_the_kernel_is_the_definition(power: float, longest: float) -> None:
    """In its last digits, which a power of f multiplies; aside from the kinks, where either slope is one."""
    lighting, tensors = Lighting((0.95, 0.7, 0.3), 0.15, 0.75, 0.4, power), surfaces(4000, longest=longest)
    doubles = tuple(tensor.double() for tensor in tensors)
    found = lighting.colors_from(*tensors, POSITION).double()
    wanted = lighting.colors_from(*doubles, POSITION.double())
    digits = 1e-6 * max(1.0, power)
    assert (found - wanted).abs().max() < digits
    facing = (doubles[1] * directions(doubles[0], POSITION.double())).sum(dim=1).abs()
    free = (
        ((facing - 1.0).abs() > 1e-5) & ((facing / 1e-6 - 1.0).abs() > 1e-4) & ((wanted - 1.0).abs() > 1e-5).all(dim=1)
    )
    assert free.double().mean() > 0.5
    upstream = torch.randn(found.shape, generator=torch.Generator().manual_seed(1)) * free[:, None]
    for mine, exact in zip(
        lit_gradients(lighting, tensors, upstream), lit_gradients(lighting, doubles, upstream), strict=True
    ):
        largest = exact.abs().amax(dim=1, keepdim=True)  # [N, 1]
        assert ((mine.double() - exact).abs() <= 10.0 * digits * (largest + 1e-2)).all()


@pytest.mark.parametrize("instruction_set", kernels.instruction_sets())
@pytest.mark.parametrize("count", [0, 1, 7, 65, 2000])
def test_every_instruction_set_has_the_same_and_threads_change_no_bit(instruction_set: str, count: int) -> None:
    given = (
        *(tensor.numpy() for tensor in surfaces(count, longest=0.99)),
        (0.9, 0.7, 0.3, 0.1, 0.5, 0.1, 20.0),
        POSITION.tolist(),
    )
    upstream = np.linspace(-1.0, 1.0, 3 * count, dtype=np.float32).reshape(count, 3)

    def made(threads: int, name: str) -> list[np.ndarray]:
        return [
            kernels.lit_colors(*given, threads, name),
            *kernels.lit_colors_gradient(*given, upstream, threads, name),
        ]

    alone, best = made(1, instruction_set), made(1, "")
    assert [a.shape for a in alone] == [(count, 3)] * 3
    for mine, other, shared in zip(alone, best, made(3, instruction_set), strict=True):
        np.testing.assert_array_equal(mine, shared)
        np.testing.assert_allclose(mine, other, rtol=1e-4, atol=1e-5)


def test_at_the_very_place_it_is_as_dark_as_one_that_faces_away() -> None:
    for dtype in (torch.float32, torch.float64):
        means, normals = (tensor.to(dtype).requires_grad_() for tensor in surfaces(3))
        lighting = Lighting((0.9, 0.7, 0.3), 0.2, 0.7, 0.2, 20.0)
        found = lighting.colors_from(means, normals, means[1].detach())
        torch.testing.assert_close(found[1], 0.2 * torch.tensor([0.9, 0.7, 0.3], dtype=dtype), atol=1e-5, rtol=0.0)
        for by in torch.autograd.grad(found[1].sum(), (means, normals)):
            assert not by.any()


@pytest.mark.parametrize("number", [np.nan, np.inf])
@pytest.mark.parametrize("attribute", range(2))
def test_what_is_not_finite_stays_in_its_row(attribute: int, number: float) -> None:
    lighting, tensors = Lighting((0.9, 0.7, 0.3), 0.1, 0.5, 0.1, 20.0), surfaces(40)
    clean = lighting.colors_from(*tensors, POSITION)
    tensors[attribute][4, 0] = number
    found = lighting.colors_from(*tensors, POSITION)
    assert torch.equal(torch.cat([found[:4], found[5:]]), torch.cat([clean[:4], clean[5:]]))
    wanted = lighting.colors_from(*(t.double() for t in tensors), POSITION.double())
    torch.testing.assert_close(found[4].double(), wanted[4], rtol=1e-5, atol=1e-6, equal_nan=True)


def test_only_where_it_can_the_kernel_is_taken(monkeypatch: pytest.MonkeyPatch) -> None:
    calls = recorded(monkeypatch, "lit_colors", "lit_colors_gradient")
    lighting, tensors, upstream = Lighting((0.9, 0.7, 0.3), 0.1, 0.5, 0.1, 20.0), surfaces(5), torch.ones(5, 3)
    with torch.no_grad():
        lighting.colors_from(*tensors, POSITION)
    lit_gradients(lighting, tensors, upstream)
    assert calls == ["lit_colors", "lit_colors", "lit_colors_gradient"]
    lit_gradients(lighting, tuple(t.double() for t in tensors), upstream)
    lighting.colors_from(*tensors, POSITION.clone().requires_grad_())
    assert len(calls) == 3
    leaf = tensors[0].requires_grad_()
    with pytest.raises(RuntimeError, match=r"differentiated once only.*apply `Lighting.colors`"):
        torch.autograd.grad(lighting.colors_from(leaf, tensors[1], POSITION).sum(), leaf, create_graph=True)
    with pytest.raises(ValueError, match=r"normals must have shape \[5, 3\]"):
        kernels.lit_colors(np.zeros((5, 3), np.float32), np.zeros((4, 3), np.float32), (0.5,) * 7, (0.0,) * 3, 1)
