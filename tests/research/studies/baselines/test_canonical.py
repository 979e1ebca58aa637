from collections.abc import Mapping

import numpy as np
import pytest
import torch
from torch import Tensor

from catalogs.vocabulary.cameras import Camera
from research.studies.baselines import canonical
from research.studies.baselines.canonical import HarmonicGaussians
from research.studies.baselines.method import TrainingImages
from research.studies.baselines.spherical_harmonics import C0
from surrogate.gaussians import Gaussians
from surrogate.rasterizer import Rasterizer
from surrogate.training.loop import Diverged
from tests.research.support.baseline_scenes import BOX, COLORS, ball_pictures, cameras_around, psnr_of_mean, psnr_over

CAMERA = cameras_around(3, 20)[1]


def some_gaussians(count: int = 30, seed: int = 0) -> HarmonicGaussians:
    random = torch.Generator().manual_seed(seed)

    def normal(*shape: int) -> Tensor:
        return torch.randn(*shape, generator=random)

    return HarmonicGaussians(
        0.4 * normal(count, 3),
        -1.5 + 0.2 * normal(count, 3),
        normal(count, 4),
        normal(count),
        0.2 * normal(count, 16, 3),
    )


def without_points(pictures: TrainingImages) -> TrainingImages:
    return TrainingImages(
        pictures.pixels, pictures.cameras, pictures.views, pictures.parameters, pictures.box, pictures.background
    )


def mean_psnr(pictures: TrainingImages, gaussians: HarmonicGaussians) -> float:
    pairs = [(i, gaussians.picture(pictures.camera(i), pictures.background)) for i in range(len(pictures))]
    return float(np.mean([psnr_over(pictures, i, picture) for i, picture in pairs]))


def test_up_to_degree_one_they_are_drawn_as_the_surrogates_own_gaussians() -> None:
    ours = some_gaussians()
    ours.harmonics[:, :4] *= 0.5  # colours are not negative: those would be cut here alone
    colors = ours.harmonics[:, :4].clone()  # [N, 4, 3]
    colors[:, 0] = colors[:, 0] * C0 + 0.5
    theirs = Gaussians(ours.means, ours.log_scales, ours.quats, ours.opacity_logits, colors.flatten(1))
    background = (0.2, 0.9, 0.4)
    expected = Rasterizer().draw_over(theirs, CAMERA, background)
    torch.testing.assert_close(ours.draw_over(CAMERA, background, degree=1), expected, atol=2e-6, rtol=0.0)
    for degree in (0, 2, 3):
        assert (ours.draw_over(CAMERA, background, degree=degree) - expected).abs().max() > 0.01


def test_colors_differ_by_direction_as_the_harmonics_say() -> None:
    """The last coefficient is that of x (x^2 - 3 y^2), negative: seen from +x, light goes along -x."""
    coefficients = torch.zeros(1, 16, 3)
    coefficients[0, 15] = torch.tensor([0.3, -0.3, 3.0])
    gaussian = HarmonicGaussians(torch.zeros(1, 3), torch.zeros(1, 3), torch.ones(1, 4), torch.zeros(1), coefficients)
    size = 0.5900435899266435
    shown = gaussian.colors_from(torch.tensor([4.0, 0.0, 0.0]))
    torch.testing.assert_close(shown, torch.tensor([[0.5 + 0.3 * size, 0.5 - 0.3 * size, 0.5 + 3.0 * size]]))
    shown = gaussian.colors_from(torch.tensor([-4.0, 0.0, 0.0]))
    torch.testing.assert_close(shown, torch.tensor([[0.5 - 0.3 * size, 0.5 + 0.3 * size, 0.0]]))  # none is negative
    torch.testing.assert_close(gaussian.colors_from(torch.tensor([4.0, 0.0, 0.0]), 2), torch.full((1, 3), 0.5))


def test_every_tensor_gets_a_gradient() -> None:
    tensors = {name: tensor.requires_grad_() for name, tensor in some_gaussians().tensors().items()}
    picture = HarmonicGaussians.of_tensors(tensors).draw_over(CAMERA, (1.0, 1.0, 1.0))
    (picture * torch.rand(picture.shape)).sum().backward()
    for name, tensor in tensors.items():
        assert tensor.grad is not None, name
        assert (tensor.grad.flatten(1).abs().amax(0) > 0).all() if tensor.ndim > 1 else tensor.grad.any(), name


def test_gaussians_that_are_no_numbers_say_that_training_diverged() -> None:
    gaussians = some_gaussians()
    gaussians.log_scales[3, 1] = 100.0
    with pytest.raises(Diverged, match=r"training diverged: scales of Gaussian 3 is inf"):
        gaussians.draw_over(CAMERA, (1.0, 1.0, 1.0))


@pytest.mark.parametrize("background", [None, (0.0, 0.3, 1.0)])
def test_pictures_hold_no_more_than_an_rgba_picture_can(background: tuple[float, float, float] | None) -> None:
    gaussians = some_gaussians()
    gaussians.harmonics[:, 0] += 4.0  # brighter than white
    picture = gaussians.picture(CAMERA, background)
    assert picture.shape == (20, 20, 4)
    assert picture.dtype == np.float32
    drawn = gaussians.draw_over(CAMERA, background or (0.0, 0.0, 0.0)).numpy()
    assert (drawn[..., :3] > drawn[..., 3:] + 0.1).any()
    assert (picture[..., :3] <= picture[..., 3:]).all()
    assert (picture >= 0).all()
    if background is None:
        np.testing.assert_array_equal(picture[..., 3], drawn[..., 3])
        judged, expected = picture[..., :3] + 1.0 - picture[..., 3:], drawn[..., :3] + 1.0 - drawn[..., 3:]
        np.testing.assert_allclose(judged, expected.clip(0.0, 1.0), atol=1e-6)  # nothing is lost over white
    else:
        assert (picture[..., 3] == 1.0).all()
        np.testing.assert_array_equal(picture[..., :3], drawn[..., :3].clip(0.0, 1.0))


def test_tensors_make_the_same_gaussians_again() -> None:
    gaussians = some_gaussians()
    again = HarmonicGaussians.of_tensors(gaussians.tensors() | {"another": torch.zeros(1)})
    for name, tensor in gaussians.tensors().items():
        assert again.tensors()[name] is tensor
    with pytest.raises(KeyError, match="harmonics"):
        HarmonicGaussians.of_tensors({name: t for name, t in gaussians.tensors().items() if name != "harmonics"})


def test_leaves_are_the_same_numbers_in_memory_of_their_own() -> None:
    gaussians = some_gaussians()
    leaves = canonical.leaves_of(gaussians)
    for name, tensor in canonical.of_leaves(leaves).tensors().items():
        torch.testing.assert_close(tensor.detach(), gaussians.tensors()[name], atol=0.0, rtol=0.0)
    with torch.no_grad():
        for leaf in leaves.values():
            leaf += 1.0
    for name, tensor in canonical.of_leaves(leaves).tensors().items():
        torch.testing.assert_close(tensor.detach(), gaussians.tensors()[name] + 1.0, msg=name)


def test_first_steps_are_as_long_as_those_of_3d_gaussian_splatting() -> None:
    """Adam's first step is as long as its rate, whatever the gradient."""
    gaussians = some_gaussians()
    leaves = canonical.leaves_of(gaussians)
    adam = canonical.optimizer(leaves, extent=5.0, rate=2.0)
    for leaf in leaves.values():
        leaf.grad = torch.rand(leaf.shape) + 0.1
    adam.step(1.0)
    rates = {"means": 5.0 * 1.6e-4, "log_scales": 5e-3, "quats": 1e-3, "opacity_logits": 5e-2, "harmonics": 1.25e-4}
    for name, tensor in canonical.of_leaves(leaves).tensors().items():
        moved = (gaussians.tensors()[name] - tensor.detach()).reshape(len(gaussians), -1)
        expected = torch.full_like(moved, 2.0 * rates[name])
        if name == "harmonics":
            expected[:, :3] = 2.0 * 2.5e-3
        torch.testing.assert_close(moved, expected, atol=1e-6, rtol=0.0, msg=name)


def test_the_extent_is_that_of_the_cameras() -> None:
    def camera(x: float) -> Camera:
        return Camera.look_at((x, 1.0, 0.0), (0.0, 0.0, 0.0), vertical_fov_degrees=40, width=4, height=4)

    assert canonical.extent_of([camera(2.0), camera(8.0)]) == pytest.approx(3.3)
    assert canonical.extent_of([camera(2.0), camera(2.0), camera(8.0)]) == pytest.approx(4.4)
    assert canonical.extent_of([camera(2.0)]) == 1.0


@pytest.mark.parametrize("steps", [1, 2, 7, 30_000])
def test_schedules_reach_their_ends(steps: int) -> None:
    assert canonical.decay(0.0) == 1.0
    assert canonical.decay(0.5) == pytest.approx(0.1)
    assert canonical.decay(1.0) == pytest.approx(0.01)
    degrees = [canonical.degree_at(step / steps) for step in range(steps + 1)]
    assert degrees[0] == 0
    assert degrees[-1] == 3
    if steps == 30_000:
        assert [degrees.index(degree) for degree in (1, 2, 3)] == [1000, 2000, 3000]


def everything(gaussians: HarmonicGaussians, *_: object, **__: object) -> Tensor:
    return torch.cat([tensor.flatten() for tensor in gaussians.tensors().values()])


@pytest.mark.parametrize(("steps", "expected"), [(99, []), (300, [100, 200]), (480, [100, 200, 300])])
def test_gaussians_are_revived_in_most_of_the_training(
    steps: int, expected: list[int], monkeypatch: pytest.MonkeyPatch
) -> None:
    found: list[int] = []
    monkeypatch.setattr(canonical, "revive", lambda leaves, adam, seed, step: found.append(step))
    monkeypatch.setattr(canonical, "image_loss", lambda drawn, target: drawn.sum())
    monkeypatch.setattr(HarmonicGaussians, "draw_over", everything)
    canonical.prepare(ball_pictures([[0.0]], views=1, size=4), 0, count=3, steps=steps)
    assert found == expected


def test_the_rate_of_the_means_falls(monkeypatch: pytest.MonkeyPatch) -> None:
    found: list[Mapping[str, float]] = []
    monkeypatch.setattr(canonical.Adam, "step", lambda adam, factor, factors: found.append({"all": factor, **factors}))
    canonical.prepare(ball_pictures([[0.0]], views=1, size=4), 0, count=3, steps=4)
    assert found == [{"all": 1.0, "means": pytest.approx(0.01 ** (step / 4))} for step in range(4)]


def test_invisible_gaussians_go_where_others_are() -> None:
    gaussians = some_gaussians(40)
    gaussians.opacity_logits[10:] = -9.0
    before = gaussians.picture(CAMERA, None)
    leaves = canonical.leaves_of(gaussians)
    canonical.revive(leaves, canonical.optimizer(leaves, 1.0), 0, 100)
    after = canonical.of_leaves(leaves)
    moved = (after.means[10:, None] == gaussians.means[:10]).all(2).any(1)  # [30]
    assert moved.sum() >= 20
    assert ((after.opacity_logits[10:] > -4.6) == moved).all()
    assert np.abs(after.picture(CAMERA, None) - before).mean() < 0.02
    for seed, step in ((1, 100), (0, 200)):
        leaves = canonical.leaves_of(gaussians)
        canonical.revive(leaves, canonical.optimizer(leaves, 1.0), seed, step)
        assert not torch.equal(leaves["means"], after.means)


def test_what_is_compared_is_as_it_is_judged() -> None:
    pictures = ball_pictures([[0.3]], views=2)
    found = canonical.compared(pictures, 1)
    assert found.dtype == torch.uint8
    torch.testing.assert_close(found[..., :3] / 255.0, pictures.over([1])[0], atol=1e-6, rtol=0.0)
    np.testing.assert_array_equal(found[..., 3].numpy(), pictures.pixels[1, ..., 3])
    opaque = ball_pictures([[0.3]], views=2, background=(0.1, 0.2, 0.3))
    np.testing.assert_array_equal(canonical.compared(opaque, 1).numpy(), opaque.pixels[1, ..., :3])


def test_gaussians_start_on_the_points_in_their_colors() -> None:
    pictures = ball_pictures([[0.3]], views=2)
    start = canonical.initial(pictures, 0, 200)
    assert pictures.points is not None
    spacing = (8.0 / 200) ** (1 / 3)
    assert torch.cdist(start.means, pictures.points).amin(1).max() < 1.5 * spacing
    seen = start.colors_from(torch.tensor([3.0, 1.0, 0.0]))
    torch.testing.assert_close(seen, start.colors_from(torch.tensor([0.0, -2.0, 4.0])))
    assert torch.cdist(seen, torch.tensor(COLORS, dtype=torch.float32)).amin(1).max() < 1e-6


def test_without_points_they_start_anywhere_in_the_box_in_the_mean_color() -> None:
    pictures = without_points(ball_pictures([[0.3]], views=2))
    start = canonical.initial(pictures, 0, 500)
    low, high = torch.tensor(BOX)
    assert ((start.means >= low) & (start.means <= high)).all()
    assert (start.means.amin(0) < -0.9).all()
    assert (start.means.amax(0) > 0.9).all()
    sums = pictures.pixels.reshape(-1, 4).astype(np.float64).sum(0)
    seen = start.colors_from(torch.tensor([3.0, 1.0, 0.0]))
    torch.testing.assert_close(seen, torch.from_numpy(sums[:3] / sums[3]).float().expand(500, 3))


def test_the_same_seed_prepares_the_same() -> None:
    pictures = ball_pictures([[-1.0], [1.0]], views=2)
    one, again, other = (canonical.prepare(pictures, seed, count=50, steps=30) for seed in (3, 3, 4))
    shapes = {
        "means": (50, 3),
        "log_scales": (50, 3),
        "quats": (50, 4),
        "opacity_logits": (50,),
        "harmonics": (50, 16, 3),
    }
    assert {name: tuple(tensor.shape) for name, tensor in one.items()} == shapes
    for name, tensor in one.items():
        assert tensor.isfinite().all()
        assert not tensor.requires_grad
        torch.testing.assert_close(tensor, again[name], atol=0.0, rtol=0.0)
        assert not torch.equal(tensor, other[name])


@pytest.mark.parametrize("background", [None, (0.1, 0.5, 0.2)])
@pytest.mark.parametrize("members", [[[]], [[0.4, -0.7, 0.1]]], ids=["no parameters", "three"])
def test_one_member_is_learnt(background: tuple[float, float, float] | None, members: list[list[float]]) -> None:
    pictures = ball_pictures(members, views=4, size=12, background=background)
    found = canonical.prepare(pictures, 0, count=100, steps=130)
    assert mean_psnr(pictures, HarmonicGaussians.of_tensors(found)) > max(40.0, psnr_of_mean(pictures) + 15.0)


def test_one_member_is_learnt_from_anywhere() -> None:
    pictures = without_points(ball_pictures([[0.5]], views=3, size=12))
    start, found = (canonical.prepare(pictures, 0, count=200, steps=steps) for steps in (0, 200))
    assert mean_psnr(pictures, HarmonicGaussians(**start)) < psnr_of_mean(pictures)
    assert mean_psnr(pictures, HarmonicGaussians(**found)) > psnr_of_mean(pictures) + 3.0


def test_what_stays_still_does_not_hold_several_members() -> None:
    one, two = (ball_pictures(members, views=3, size=12) for members in ([[1.0]], [[-1.0], [1.0]]))
    psnrs = [mean_psnr(p, HarmonicGaussians(**canonical.prepare(p, 0, count=80, steps=80))) for p in (one, two)]
    assert psnrs[1] < psnrs[0] - 10.0


@pytest.mark.parametrize("steps", [0, 1, 2, 7])
def test_short_preparations(steps: int) -> None:
    pictures = ball_pictures([[0.0]], views=1, size=8)
    found = canonical.prepare(pictures, 0, count=4, steps=steps)
    assert all(tensor.isfinite().all() for tensor in found.values())
    assert len(found["means"]) == 4
