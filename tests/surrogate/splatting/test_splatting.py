"""Outputs of every backend beside colour and alpha: depth, and the gradient by the camera's pose."""

from __future__ import annotations

import pytest
import torch
from torch import Tensor

from catalogs.vocabulary.cameras import Camera
from surrogate.splatting import Constants, Primitives, reference, render

VIEW = Camera.look_at((3.0, 0.6, 0.4), (0, 0, 0), vertical_fov_degrees=35.0, width=23, height=17)
BACKENDS = ("cpu", "reference")


def scene(count: int = 40) -> list[Tensor]:
    random = torch.Generator().manual_seed(1)
    means, scales, quats, opacities, colors = (
        torch.rand(*shape, generator=random, dtype=torch.float64)
        for shape in ((count, 3), (count, 3), (count, 4), (count,), (count, 3))
    )
    gaussians = [means - 0.5, 0.05 + 0.1 * scales, quats - 0.5, 0.1 + 0.8 * opacities, colors]
    return [t.float().double() for t in gaussians]


def depth_by_definition(gaussians: list[Tensor], camera: Camera) -> Tensor:
    """Sum of transmittance, alpha and depth over the sorted Gaussians, for each pixel."""
    splats = reference.project(Primitives(*gaussians), camera, Constants())
    matrix = torch.tensor(camera.world_to_camera)
    depths = gaussians[0] @ matrix[2, :3] + matrix[2, 3]
    alphas = reference.alphas_at(reference.pixel_centers(camera).double(), splats, Constants())
    weights = reference.transmittances(alphas) * alphas
    return (weights @ depths.sort().values).view(camera.height, camera.width)


@pytest.mark.parametrize("backend", BACKENDS)
def test_depth_is_composited_like_a_colour_and_has_a_gradient(backend: str) -> None:
    slow = [t.requires_grad_() for t in scene()]
    wanted = depth_by_definition(slow, VIEW)
    fast = [t.detach().to(torch.float32 if backend == "cpu" else torch.float64).requires_grad_() for t in slow]
    picture = render(*fast, VIEW, backend=backend, depth=True)
    assert picture.depth is not None
    assert float((picture.depth - wanted).detach().abs().max()) < 1e-5
    plain = render(*fast, VIEW, backend=backend)
    assert plain.depth is None
    assert torch.equal(plain.color, picture.color)
    weights = torch.randn(17, 23, generator=torch.Generator().manual_seed(2), dtype=torch.float64)
    by_slow = torch.autograd.grad((wanted * weights).sum(), slow[:4])
    by_fast = torch.autograd.grad((picture.depth * weights.to(picture.depth)).sum(), fast[:4])
    for a, b in zip(by_fast, by_slow, strict=True):
        assert float((a - b).abs().max()) < 2e-5 * float(b.abs().max())


def test_a_gaussian_as_far_away_as_numbers_go_has_a_finite_depth() -> None:
    gaussians = [t.float() for t in scene(3)]
    gaussians[0][1] = torch.tensor([-3e38, -3e38, -3e38])
    picture = render(*gaussians, VIEW, depth=True)
    assert picture.depth is not None
    assert torch.isfinite(picture.depth).all()


@pytest.mark.parametrize("alpha_cap", [1.0, 1.5, 0.0, float("nan")])
def test_a_cap_that_lets_nothing_through_is_refused(alpha_cap: float) -> None:
    with pytest.raises(ValueError, match="alpha_cap must lie above alpha_floor and below 1"):
        render(*(t.float() for t in scene(3)), VIEW, alpha_cap=alpha_cap)  # type: ignore[misc]


def rigid(pose: Tensor, gaussians: list[Tensor]) -> list[Tensor]:
    """The Gaussians turned by the rotation vector pose[:3] (small) and moved by pose[3:]."""
    half = torch.cat([torch.ones(1).to(pose), 0.5 * pose[:3]])
    turn = half / half.norm()
    rotation = reference.rotations(turn[None])[0]
    w, x, y, z = turn
    left = torch.stack(  # the matrix that multiplies a quaternion from the left
        [torch.stack(row) for row in ((w, -x, -y, -z), (x, w, -z, y), (y, z, w, -x), (z, -y, x, w))]
    )
    return [gaussians[0] @ rotation.T + pose[3:], gaussians[1], gaussians[2] @ left.T, *gaussians[3:]]


@pytest.mark.parametrize("backend", BACKENDS)
def test_the_gradient_by_the_cameras_pose_is_that_of_moving_the_world(backend: str) -> None:
    """Against finite differences of the float64 twin, seen by cameras that really move."""
    gaussians = scene()
    weights = torch.randn(17, 23, 3, generator=torch.Generator().manual_seed(3), dtype=torch.float64)

    def value(camera: Camera) -> float:
        return float((render(*gaussians, camera, backend="reference").color * weights).sum())

    def moved(k: int, step: float) -> Camera:
        pose = torch.zeros(6, dtype=torch.float64)
        pose[k] = step
        matrix = torch.eye(4, dtype=torch.float64)
        matrix[:3, :3] = reference.rotations(torch.cat([torch.ones(1), 0.5 * pose[:3]])[None].double())[0]
        matrix[:3, 3] = pose[3:]
        return Camera(
            VIEW.world_to_camera @ matrix.numpy(), VIEW.fx, VIEW.fy, VIEW.cx, VIEW.cy, VIEW.width, VIEW.height
        )

    wanted = torch.tensor([(value(moved(k, 1e-6)) - value(moved(k, -1e-6))) / 2e-6 for k in range(6)])
    dtype = torch.float32 if backend == "cpu" else torch.float64
    pose = torch.zeros(6, dtype=dtype, requires_grad=True)
    picture = render(*rigid(pose, [t.to(dtype) for t in gaussians]), VIEW, backend=backend)
    (got,) = torch.autograd.grad((picture.color * weights.to(dtype)).sum(), pose)
    assert float((got - wanted).abs().max()) < 2e-4 * float(wanted.abs().max())
