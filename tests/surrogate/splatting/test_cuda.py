"""The adapter to gsplat: its conventions against gsplat's own plain-torch projection, and, on a GPU, the kernels themselves."""

from __future__ import annotations

import importlib
from types import SimpleNamespace
from typing import Any

import pytest
import torch
from torch import Tensor

import surrogate.splatting
from catalogs.vocabulary.cameras import Camera
from surrogate.splatting import Constants, Primitives, cuda, draw_over, render
from surrogate.splatting.cuda import chosen_device
from surrogate.training.losses import image_loss_reference
from tests.support.clouds import cloud, off_center, view

CONSTANTS = {"near": 0.05, "dilation": 0.1, "alpha_floor": 1.0 / 255.0}


def without_gpu(monkeypatch: pytest.MonkeyPatch, rasterization: Any) -> None:
    """Let tensors in main memory pass, and this function stand for gsplat's."""
    monkeypatch.setattr(cuda, "_on_gpu", lambda tensor: True)
    monkeypatch.setattr(cuda, "_gsplat", lambda: SimpleNamespace(rasterization=rasterization))


def plain_rasterization(
    means: Tensor,
    quats: Tensor,
    scales: Tensor,
    opacities: Tensor,
    colors: Tensor,
    viewmats: Tensor,
    Ks: Tensor,
    width: int,
    height: int,
    near_plane: float,
    eps2d: float,
    **others: Any,
) -> tuple[Tensor, Tensor, dict[str, Tensor]]:
    """gsplat's projection in torch, and its rule of compositing written out pixel by pixel."""
    plain = importlib.import_module("gsplat.cuda._torch_impl")
    assert others["radius_clip"] == 0.0
    assert others["rasterize_mode"] == "classic"
    covariances, _ = plain._quat_scale_to_covar_preci(quats, scales, compute_preci=False)
    _, means2d, depths, conics, _ = plain._fully_fused_projection(
        means, covariances, viewmats, Ks, width, height, eps2d=eps2d, near_plane=near_plane
    )
    rows, columns = torch.meshgrid(torch.arange(height) + 0.5, torch.arange(width) + 0.5, indexing="ij")
    color, through = torch.zeros(height, width, 3), torch.ones(height, width)
    done = torch.zeros(height, width, dtype=torch.bool)
    for i in depths[0].argsort(stable=True).tolist():
        if depths[0, i] < near_plane:
            continue
        dx, dy = means2d[0, i, 0] - columns, means2d[0, i, 1] - rows
        a, b, c = conics[0, i]
        alpha = (opacities[i] * torch.exp(-0.5 * (a * dx * dx + c * dy * dy) - b * dx * dy)).clamp(max=0.999)
        shown = (alpha >= 1.0 / 255.0) & ~done
        done = done | (shown & (through * (1.0 - alpha) <= 1e-4))
        alpha = torch.where(shown & ~done, alpha, 0.0)
        color = color + (through * alpha)[..., None] * colors[i]
        through = through * (1.0 - alpha)
    return color[None], (1.0 - through)[None, ..., None], {"means2d": means2d}


@pytest.mark.parametrize(
    "camera", [view(), off_center(41, 23), view(1, 1)], ids=["square", "off the middle", "one pixel"]
)
def test_its_conventions_are_ours(camera: Camera, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("gsplat")
    without_gpu(monkeypatch, plain_rasterization)
    scene = cloud(40, opacities=(0.05, 0.3))  # nowhere so opaque that its other rule of stopping matters
    slow = [tensor.clone().requires_grad_() for tensor in scene]
    fast = [tensor.float().requires_grad_() for tensor in scene]
    random = torch.Generator().manual_seed(1)
    by_color = torch.randn(camera.height, camera.width, 3, generator=random)
    by_alpha = torch.randn(camera.height, camera.width, generator=random)
    found = []
    for leaves, backend in ((slow, "reference"), (fast, "cuda")):
        picture = render(*leaves, camera, backend=backend, **CONSTANTS)  # type: ignore[arg-type]
        value = (picture.color * by_color).sum() + (picture.alpha * by_alpha).sum()
        found.append((picture, torch.autograd.grad(value, leaves)))
    (true, true_gradients), (got, gradients) = found
    assert float((got.color - true.color).detach().abs().quantile(0.999)) < 2e-5
    assert float((got.alpha - true.alpha).detach().abs().quantile(0.999)) < 2e-5
    for name, a, b in zip(Primitives._fields, gradients, true_gradients, strict=True):
        assert float((a - b).abs().max()) < 1e-3 * float(b.abs().max()), name


def test_depth_and_a_background_come_by_the_same_way(monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("gsplat")
    without_gpu(monkeypatch, plain_rasterization)
    scene = [tensor.float() for tensor in cloud(20)]
    true = render(*scene, view(), backend="reference", depth=True)
    got = render(*scene, view(), backend="cuda", depth=True)
    assert got.depth is not None
    assert true.depth is not None
    torch.testing.assert_close(got.depth, true.depth, rtol=0, atol=2e-3)
    over = draw_over(Primitives(*scene), view(), (1.0, 0.5, 0.0), Constants(), backend="cuda")
    torch.testing.assert_close(
        over, torch.cat([got.over((1.0, 0.5, 0.0)), got.alpha[..., None]], dim=2), rtol=0, atol=1e-6
    )


def test_gsplat_is_told_what_our_arguments_mean(monkeypatch: pytest.MonkeyPatch) -> None:
    told: dict[str, Any] = {}

    def record(**arguments: Any) -> tuple[Tensor, Tensor, dict[str, Tensor]]:
        told.update(arguments)
        return torch.zeros(1, 23, 41, 3), torch.zeros(1, 23, 41, 1), {"means2d": torch.zeros(1, 5, 2)}

    without_gpu(monkeypatch, record)
    camera, scene = off_center(41, 23), list(cloud(5))
    lengths = torch.tensor([1e-30, 1e-9, 1e15, 1e-30, 1e-9], dtype=torch.float64)
    scene[2] = lengths[:, None] * scene[2] / scene[2].norm(dim=1, keepdim=True)
    picture = render(*scene, camera, backend="cuda", near=0.3, dilation=0.2)
    assert picture.color.shape == (23, 41, 3)
    assert picture.alpha.shape == (23, 41)
    assert told["near_plane"] == 0.3
    assert told["eps2d"] == 0.2
    assert (told["width"], told["height"]) == (41, 23)
    intrinsics = torch.tensor([[camera.fx, 0, camera.cx], [0, camera.fy, camera.cy], [0, 0, 1]])
    torch.testing.assert_close(told["Ks"][0], intrinsics.float())
    torch.testing.assert_close(told["viewmats"][0].double(), torch.tensor(camera.world_to_camera), rtol=0, atol=1e-6)
    assert all(told[name].dtype == torch.float32 for name in Primitives._fields)
    torch.testing.assert_close(told["quats"].norm(dim=1), torch.ones(5))
    assert told["quats"][0].tolist() == [1.0, 0.0, 0.0, 0.0]


@pytest.mark.parametrize(
    ("options", "complaint"),
    [
        ({"alpha_floor": 1e-3}, r"alpha_floor = 0.00392157, which is compiled into gsplat, got 0.001"),
        ({"alpha_cap": 0.99}, r"alpha_cap = 0.999, which is compiled into gsplat, got 0.99"),
        ({}, "needs means on a CUDA device, got cpu: move it or choose 'cpu'"),
    ],
)
def test_what_gsplat_can_not_do_is_refused(options: dict[str, float], complaint: str) -> None:
    with pytest.raises(ValueError, match=complaint):
        render(*cloud(5), view(), backend="cuda", **options)  # type: ignore[arg-type]


@pytest.mark.parametrize("name", Primitives._fields)
def test_what_is_not_finite_is_named(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    without_gpu(monkeypatch, None)
    scene = cloud(9)
    getattr(scene, name)[7] = torch.nan
    monkeypatch.setattr(cuda, "_gsplat", lambda: pytest.fail("it must not be drawn"))
    with pytest.raises(ValueError, match=f"{name} of Gaussian 7"):
        render(*scene, view(), backend="cuda")


def test_no_gaussian_is_an_empty_picture_with_a_gradient(monkeypatch: pytest.MonkeyPatch) -> None:
    without_gpu(monkeypatch, None)
    leaves = [tensor.float().requires_grad_() for tensor in cloud(0)]
    picture = render(*leaves, view(5, 4), backend="cuda")
    picture.color.sum().backward()
    assert not picture.color.detach().any()
    assert picture.alpha.shape == (4, 5)
    assert leaves[0].grad is not None


def test_what_is_missing_is_said(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(cuda, "_on_gpu", lambda tensor: True)
    monkeypatch.setattr(cuda.importlib, "import_module", lambda name: (_ for _ in ()).throw(ImportError(name)))
    monkeypatch.setattr(cuda.importlib.util, "find_spec", lambda name: None)
    with pytest.raises(
        ModuleNotFoundError, match=r"gsplat >= 1.5.3 is not installed: pip install 'gs-surrogate\[cuda\]'"
    ):
        render(*cloud(5), view(), backend="cuda")
    assert chosen_device("auto") == chosen_device("cpu") == torch.device("cpu")
    with pytest.raises(RuntimeError, match=r'training\.device is "cuda", but gsplat'):
        chosen_device("cuda")


def test_a_machine_without_a_gpu_draws_in_main_memory(monkeypatch: pytest.MonkeyPatch) -> None:
    scene = [tensor.float() for tensor in cloud(9)]
    assert torch.equal(render(*scene, view()).color, render(*scene, view(), backend="cpu").color)
    monkeypatch.setattr(cuda, "render", lambda *inputs, **_: pytest.fail("there is no GPU"))
    draw_over(Primitives(*scene), view(), (1.0, 1.0, 1.0), Constants())
    assert surrogate.splatting.AUTO not in surrogate.splatting.BACKENDS


def test_the_loss_of_gpus_is_that_of_the_kernel() -> None:
    """On a GPU it is the reference that is used, with bytes and a channel that is not compared."""
    from surrogate.training.losses import image_loss

    random = torch.Generator().manual_seed(0)
    image = torch.rand(19, 23, 4, generator=random)
    target = torch.randint(0, 256, (19, 23, 3), generator=random, dtype=torch.uint8)
    leaves = [image.clone().requires_grad_() for _ in range(2)]
    losses = [image_loss(leaves[0], target), image_loss_reference(leaves[1], target)]
    gradients = [torch.autograd.grad(loss, leaf)[0] for loss, leaf in zip(losses, leaves, strict=True)]
    assert losses[0].item() == pytest.approx(losses[1].item(), rel=1e-5)
    torch.testing.assert_close(gradients[0], gradients[1], rtol=1e-4, atol=1e-8)


@pytest.mark.cuda
@pytest.mark.skipif(bool(cuda.unusable()), reason=f"the GPU's kernels are not tested: {cuda.unusable()}")
class TestOnAGpu:
    def test_ordinary_scenes(self) -> None:
        scene = cloud(400, opacities=(0.02, 0.6))
        slow = [tensor.clone().requires_grad_() for tensor in scene]
        fast = [tensor.float().cuda().requires_grad_() for tensor in scene]
        true, got = render(*slow, view(), backend="reference"), render(*fast, view())
        assert float((got.color.cpu() - true.color).detach().abs().quantile(0.999)) < 2e-5
        wanted = torch.autograd.grad(true.color.sum() + true.alpha.sum(), slow)
        found = torch.autograd.grad(got.color.sum() + got.alpha.sum(), fast)
        for a, b in zip(found, wanted, strict=True):
            assert float((a.cpu() - b).abs().flatten().quantile(0.99)) < 2e-4 * float(b.abs().max())
