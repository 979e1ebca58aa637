"""The kernels against the float64 twin, forward and backward, on ordinary and on hostile input."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
import torch
from torch import Tensor

from catalogs.vocabulary.cameras import Camera
from native import kernels
from surrogate.splatting import Constants, Primitives, draw_over, render

Scene = list[Tensor]
CONSTANTS = {"near": 0.05, "dilation": 0.1, "alpha_floor": 1.0 / 255.0}
NAMES = ("means", "scales", "quats", "opacities", "colors")


def camera(width: int = 61, height: int = 47, distance: float = 3.0) -> Camera:
    return Camera.look_at((distance, 0.6, 0.4), (0, 0, 0), vertical_fov_degrees=35.0, width=width, height=height)


def scene(
    count: int,
    *,
    seed: int = 0,
    scales: tuple[float, float] = (0.02, 0.08),
    opacities: tuple[float, float] = (0.02, 0.9),
) -> Scene:
    """Gaussians in the cube [-0.6, 0.6]^3, in float64."""
    random = torch.Generator().manual_seed(seed)

    def uniform(*shape: int, low: float = 0.0, high: float = 1.0) -> Tensor:
        return torch.rand(*shape, generator=random, dtype=torch.float64) * (high - low) + low

    return [
        uniform(count, 3, low=-0.6, high=0.6),
        uniform(count, 3, low=scales[0], high=scales[1]),
        uniform(count, 4, low=-1.0),
        uniform(count, low=opacities[0], high=opacities[1]),
        uniform(count, 3),
    ]


def weighted(gaussians: Scene, view: Camera, seed: int = 9, **options: object) -> tuple[Tensor, Tensor, list[Tensor]]:
    """Colour, alpha, and the gradients of a fixed random functional of both."""
    leaves = [t.detach().clone().requires_grad_() for t in gaussians]
    picture = render(*leaves, view, **{**CONSTANTS, **options})  # type: ignore[arg-type]
    random = torch.Generator().manual_seed(seed)
    shape = (view.height, view.width)
    by_color = torch.randn(*shape, 3, generator=random, dtype=torch.float64).to(picture.color)
    by_alpha = torch.randn(*shape, generator=random, dtype=torch.float64).to(picture.color)
    value = (picture.color * by_color).sum() + (picture.alpha * by_alpha).sum()
    return picture.color.detach(), picture.alpha.detach(), list(torch.autograd.grad(value, leaves))


def snapped(gaussians: Scene) -> Scene:
    """The values that both precisions can hold, so that only the arithmetic differs."""
    return [t.float().double() for t in gaussians]


def needles(s: Scene) -> Scene:
    s[1][:, 0], s[1][:, 1:] = 0.4, 4e-4
    return s


def pancakes(s: Scene) -> Scene:
    s[1][:, 0], s[1][:, 1:] = 1e-4, 0.2
    return s


def below_a_pixel(s: Scene) -> Scene:
    s[1][:] = 1e-6
    return s


def zero_and_long_quaternions(s: Scene) -> Scene:
    s[2][::3] = 0.0
    s[2][1::3] *= 1e4
    return s


def opacity_at_the_ends(s: Scene) -> Scene:
    s[3][::3], s[3][1::3] = 0.0, 1.0
    return s


def equal_depths(s: Scene) -> Scene:
    s[0][:] = s[0][:1]
    return s


def around_the_near_plane(s: Scene) -> Scene:
    s[0][:, 0] = torch.linspace(2.0, 4.0, len(s[0]), dtype=torch.float64)
    s[0][:, 1:] *= 0.05
    s[1][:] *= 0.1
    return s


def far_off_axis(s: Scene) -> Scene:
    s[0][:, 1] *= 6.0
    s[1][:] *= 3.0
    return s


def huge(s: Scene) -> Scene:
    s[1][:] = 30.0
    return s


def opaque_stack(s: Scene) -> Scene:
    s[3][:] = 0.95
    return s


def needles_without_width(s: Scene) -> Scene:
    s[1][:, 0], s[1][:, 1:] = 0.4, 4e-9
    return s


def no_extent_at_all(s: Scene) -> Scene:
    s[1][::2], s[1][1::4, 0] = 0.0, 0.0
    return s


def denormal_scales(s: Scene) -> Scene:
    s[1][:] = 1e-42
    return s


def beyond_any_frame(s: Scene) -> Scene:
    s[1][:20], s[1][20:40], s[1][40:] = 1e3, 1e9, 1e18
    return s


def denormal_quaternions(s: Scene) -> Scene:
    s[2][::2] *= 1e-39
    s[2][1::2] *= 1e-9
    return s


def opacity_almost_at_the_ends(s: Scene) -> Scene:
    s[3][::3], s[3][1::3] = 1e-8, 1.0 - 1e-7
    return s


def far_away(s: Scene) -> Scene:
    s[0][:] *= 1e6
    return s


def grazing_the_near_plane(s: Scene) -> Scene:
    s[0][:, 0] = torch.linspace(2.9, 2.951, len(s[0]), dtype=torch.float64)
    s[0][:, 1], s[0][:, 2] = 0.6, 0.4
    return s


HARD: dict[str, Callable[[Scene], Scene]] = {
    f.__name__: f
    for f in (
        needles,
        pancakes,
        below_a_pixel,
        zero_and_long_quaternions,
        opacity_at_the_ends,
        equal_depths,
        around_the_near_plane,
        far_off_axis,
        huge,
        opaque_stack,
        needles_without_width,
        no_extent_at_all,
        denormal_scales,
        beyond_any_frame,
        denormal_quaternions,
        opacity_almost_at_the_ends,
        far_away,
        grazing_the_near_plane,
    )
}


def assert_close(gaussians: Scene, view: Camera, image_bound: float, gradient_bound: float, **options: object) -> None:
    gaussians = snapped(gaussians)
    constants = {name: value for name, value in options.items() if name in CONSTANTS}
    color, alpha, gradients = weighted(gaussians, view, backend="reference", **constants)
    fast_color, fast_alpha, fast = weighted([t.float() for t in gaussians], view, **options)
    # A pixel that stands exactly on the floor may fall to either side: judge all but the worst thousandth.
    difference = torch.cat([(fast_color - color).abs().amax(-1).flatten(), (fast_alpha - alpha).abs().flatten()])
    assert float(difference.quantile(0.999)) <= image_bound
    assert float(difference.max()) <= max(image_bound, 1.1 / 255.0)
    for name, got, wanted in zip(NAMES, fast, gradients, strict=True):
        assert torch.isfinite(got).all(), name
        error = (got - wanted).abs().flatten() / wanted.abs().max().clamp(min=1e-12)
        assert float(error.quantile(0.99)) <= gradient_bound, f"{name}: {float(error.quantile(0.99)):.2e}"


@pytest.mark.parametrize("instruction_set", kernels.instruction_sets())
@pytest.mark.parametrize("size", [(61, 47), (16, 16), (1, 1), (33, 5), (3, 130)], ids=str)
def test_ordinary_scenes(instruction_set: str, size: tuple[int, int]) -> None:
    assert_close(scene(200), camera(*size), 3e-6, 1e-5, instruction_set=instruction_set)


@pytest.mark.parametrize("instruction_set", kernels.instruction_sets())
@pytest.mark.parametrize("case", HARD)
def test_hard_cases(case: str, instruction_set: str) -> None:
    assert_close(HARD[case](scene(60, seed=3)), camera(), 5e-6, 2e-5, instruction_set=instruction_set)


@pytest.mark.parametrize("case", HARD)
def test_hard_cases_without_dilation(case: str) -> None:
    """Nothing widens a needle then: one thinner than a pixel hits few centres, far out where alpha is steep."""
    assert_close(HARD[case](scene(60, seed=3)), camera(), 1e-4, 1e-3, dilation=0.0)


def test_thousands_over_one_pixel() -> None:
    crowd = scene(10_000, seed=4, scales=(1e-3, 2e-3), opacities=(0.005, 0.02))
    crowd[0][:, 1:] *= 1e-3
    assert_close(crowd, camera(13, 9), 3e-6, 2e-5)


def test_frames_wider_and_higher_than_what_is_looked_at_at_once() -> None:
    """Rows of blocks are cut 8 vectors at a time and tiles 16 across: a Gaussian over more of both."""
    wide = scene(6, seed=6, scales=(0.3, 0.9), opacities=(0.1, 0.3))
    for instruction_set in kernels.instruction_sets():
        assert_close(wide, camera(300, 40), 3e-6, 1e-5, instruction_set=instruction_set)
        assert_close(wide, camera(24, 560), 3e-6, 1e-5, instruction_set=instruction_set)


@pytest.mark.parametrize(
    "options", [{"dilation": 0.0}, {"dilation": 0.3}, {"alpha_floor": 1e-4}, {"alpha_cap": 0.5}, {"near": 2.9}], ids=str
)
def test_constants_mean_the_same_to_both(options: dict[str, float]) -> None:
    gaussians = snapped(scene(80, seed=5))
    color, alpha, _ = weighted(gaussians, camera(), backend="reference", **options)
    fast_color, fast_alpha, _ = weighted([t.float() for t in gaussians], camera(), **options)
    assert float((fast_color - color).abs().quantile(0.999)) < 2e-5
    assert float((fast_alpha - alpha).abs().quantile(0.999)) < 2e-5


def test_the_result_is_bitwise_the_same_for_any_number_of_threads_and_every_run() -> None:
    gaussians = [t.float() for t in scene(3000, seed=1)]  # enough for several portions
    first = weighted(gaussians, camera(130, 90), threads=1)
    for threads in (1, 2, 3, 7):
        again = weighted(gaussians, camera(130, 90), threads=threads)
        assert torch.equal(first[0], again[0])
        assert torch.equal(first[1], again[1])
        assert all(torch.equal(a, b) for a, b in zip(first[2], again[2], strict=True))


@pytest.mark.parametrize("count", [0, 1])
def test_almost_nothing_can_be_drawn(count: int) -> None:
    color, alpha, gradients = weighted([t.float() for t in scene(count)], camera())
    assert color.shape == (47, 61, 3)
    assert torch.isfinite(color).all()
    assert float(alpha.max()) <= 1.0
    assert [len(g) for g in gradients] == [count] * 5
    if count == 0:
        assert not color.any()


@pytest.mark.parametrize("index", range(5))
@pytest.mark.parametrize("value", [float("nan"), float("inf")])
def test_what_is_not_finite_is_named(index: int, value: float) -> None:
    gaussians = [t.float() for t in scene(20)]
    gaussians[index][7] = value
    with pytest.raises(ValueError, match=f"{NAMES[index]} of Gaussian 7"):
        render(*gaussians, camera(), **CONSTANTS)  # type: ignore[arg-type]


def test_wrong_shapes_and_names_are_refused() -> None:
    gaussians = [t.float() for t in scene(5)]
    with pytest.raises(ValueError, match="scales"):
        render(gaussians[0], gaussians[1][:4], *gaussians[2:], camera())
    with pytest.raises(ValueError, match="backend"):
        render(*gaussians, camera(), backend="gpu")
    with pytest.raises(ValueError, match="instruction set"):
        render(*gaussians, camera(), instruction_set="abacus")


def test_a_gradient_of_gaussians_that_have_changed_since_is_refused() -> None:
    leaves = [t.float().requires_grad_() for t in scene(5)]
    picture = render(*leaves, camera())
    with torch.no_grad():
        leaves[0].add_(0.1)
    with pytest.raises(RuntimeError, match="modified by an inplace operation"):
        picture.color.sum().backward()


@pytest.mark.parametrize("instruction_set", kernels.instruction_sets())
def test_a_picture_over_a_background_is_that_of_colour_and_alpha(instruction_set: str) -> None:
    background, view = (1.0, 0.25, 0.5), camera(37, 41)
    weights = torch.randn(41, 37, 4, generator=torch.Generator().manual_seed(2), dtype=torch.float64)
    slow = [t.requires_grad_() for t in snapped(scene(60))]
    apart = render(*slow, view, **CONSTANTS, backend="reference")  # type: ignore[arg-type]
    wanted = torch.cat([apart.over(background), apart.alpha[..., None]], dim=2)
    assert torch.equal(
        wanted, draw_over(Primitives(*slow), view, background, Constants(**CONSTANTS), backend="reference")
    )
    fast = [t.detach().float().requires_grad_() for t in slow]
    got = draw_over(Primitives(*fast), view, background, Constants(**CONSTANTS), instruction_set=instruction_set)
    assert float((got - wanted).detach().abs().max()) < 3e-6
    by_slow = torch.autograd.grad((wanted * weights).sum(), slow)
    by_fast = torch.autograd.grad((got * weights.float()).sum(), fast)
    for a, b in zip(by_fast, by_slow, strict=True):
        assert float((a - b).abs().max()) < 1e-5 * float(b.abs().max())


def test_the_twin_agrees_with_finite_differences() -> None:
    leaves = [t.requires_grad_() for t in scene(4, seed=8, scales=(0.15, 0.3), opacities=(0.3, 0.6))]
    view = camera(6, 5)

    def picture(*inputs: Tensor) -> tuple[Tensor, Tensor]:
        return render(*inputs, view, near=0.05, dilation=0.1, alpha_floor=1e-9, backend="reference")[:2]

    assert torch.autograd.gradcheck(picture, leaves, eps=1e-6, atol=1e-6)


def test_one_gaussian_is_what_the_formula_says() -> None:
    view = Camera.look_at((0, 0, -4.0), (0, 0, 0), vertical_fov_degrees=40.0, width=31, height=31)
    sigma, opacity = 0.3, 0.7
    inputs = [torch.zeros(1, 3), torch.full((1, 3), sigma), torch.tensor([[1.0, 0, 0, 0]]), torch.tensor([opacity])]
    picture = render(*inputs, torch.ones(1, 3), view, near=0.1, dilation=0.0, alpha_floor=1e-4)
    radius = np.hypot(*np.meshgrid(np.arange(31) - 15.0, np.arange(31) - 15.0))
    wanted = opacity * np.exp(-0.5 * (radius / (view.fx * sigma / 4.0)) ** 2)
    wanted[wanted < 1e-4] = 0.0
    assert np.abs(picture.alpha.numpy() - wanted).max() < 1e-5
    assert torch.equal(picture.color[..., 0], picture.color[..., 2])
    assert np.abs(picture.over((1.0, 0.0, 0.0))[..., 0].numpy() - 1.0).max() < 1e-6
