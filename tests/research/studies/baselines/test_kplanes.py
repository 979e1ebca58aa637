from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
import pytest
import torch
from numpy.typing import NDArray
from torch import Tensor, nn
from torch.nn.functional import mse_loss

from catalogs.vocabulary.cameras import Camera
from research.studies.baselines import kplanes
from research.studies.baselines.kplanes import METHOD, NAIVE, KPlanes, KPlanesTraining, rate_at
from research.studies.baselines.kplanes_field import OFFICIAL, SMALL, KPlanesArchitecture, SamplePoints
from research.studies.baselines.kplanes_proposals import WeightedSamples, interlevel_loss
from research.studies.baselines.method import Method, Plan, TrainingImages
from research.studies.baselines.rays import Rays
from tests.research.support.baseline_scenes import ball_pictures, cameras_around, psnr_of_mean, psnr_over

TINY = KPlanesArchitecture(
    8, (8, 16), (16,), samples=(16, 12), rays=96, parameter_resolution=5, proposal_parameter_resolution=5
)
MEMBERS = {0: [[]], 1: [[-1.0], [1.0]], 3: [[-1.0, 1.0, 0.5]], 6: [[-1.0, 1.0, 0.5, 0.0, 0.3, -0.2]]}


@pytest.fixture(autouse=True)
def tiny(monkeypatch: pytest.MonkeyPatch) -> None:
    """Small means tiny here."""
    monkeypatch.setattr(kplanes, "SMALL", TINY)


def training(pictures: TrainingImages, steps: int = 100, method: Method = METHOD, **options: object) -> KPlanesTraining:
    fit = method.begin(pictures, Plan(steps, **{"size": "small", **options}), {})
    assert isinstance(fit, KPlanesTraining)
    return fit


def trained(pictures: TrainingImages, steps: int, **options: object) -> KPlanesTraining:
    fit = training(pictures, steps, **options)
    for _ in range(steps):
        fit.advance()
    return fit


def size_of(parameters: int, architecture: KPlanesArchitecture) -> int:
    with torch.device("meta"):
        return sum(tensor.numel() for tensor in KPlanes(parameters, architecture).parameters())


def test_official_size_with_one_parameter_is_the_published_one() -> None:
    assert size_of(1, OFFICIAL) == 36_465_920
    assert OFFICIAL.samples == (256, 128, 48)
    assert METHOD.official_steps == 30_001


def test_every_parameter_adds_its_planes() -> None:
    networks = 128 * 64 + 64 * 16 + 31 * 64 + 64 * 64 + 64 * 3 + 2 * (8 * 64 + 64)
    for parameters in (0, 2, 6):
        pairs = parameters * (parameters - 1) // 2
        levels = [(32, r, 25) for r in (64, 128, 256, 512)] + [(8, 64, 50), (8, 128, 50)]
        planes = sum(c * (3 * r**2 + 3 * parameters * r * along + pairs * along**2) for c, r, along in levels)
        assert size_of(parameters, OFFICIAL) == planes + networks


def test_small_size() -> None:
    assert (SMALL.channels, SMALL.resolutions, SMALL.samples, SMALL.rays) == (16, (32, 64, 128), (64, 32), 256)
    assert 4 * size_of(1, SMALL) < 12e6


def test_planes_and_weights_start_as_published() -> None:
    model = training(ball_pictures([[0.0]])).model
    for name, tensor in model.state_dict().items():
        if name.endswith(("mixed", "among")):
            assert (tensor == 1.0).all()
        elif name.endswith("spatial"):
            highest = 0.15 if name.startswith("proposals") else 0.5
            assert 0.1 <= tensor.min() < 0.1 + 0.01 * highest
            assert 0.99 * highest < tensor.max() <= highest
        else:
            bound = (6.0 / sum(tensor.shape)) ** 0.5  # Glorot & Bengio 2010
            assert 0.8 * bound < tensor.abs().max() <= bound


@pytest.mark.parametrize("parameters", [1, 3, 6])
def test_at_first_pictures_do_not_depend_on_parameters(parameters: int) -> None:
    pictures = ball_pictures(MEMBERS[parameters])
    low, high = (torch.full((parameters,), value) for value in (-0.7, 0.9))
    for method, scale in ((METHOD, 10.0), (NAIVE, 10.0 * 3.0 ** (3 * parameters + parameters * (parameters - 1) // 2))):
        fit = training(pictures, method=method)
        with torch.no_grad():
            fit.model.radiance.geometry[0].weight.mul_(scale)  # which makes up for products of many planes
        found = [fit.at(values)(pictures.camera(0)) for values in (low, high)]
        assert all(np.isfinite(picture).all() and picture[..., 3].std() > 0.01 for picture in found)
        assert np.allclose(*found, atol=1e-5) == (method is METHOD)


def spatial_gradients(parameters: int, method: Method) -> float:
    """Mean absolute gradient at the radiance field's spatial planes of the mean squared error, before the first step."""
    pictures = ball_pictures(np.zeros((1, parameters)))
    fit = training(pictures, method=method)
    rays = Rays(*(tensor.reshape(1, 3).repeat(200, 1) for tensor in (torch.tensor([0.0, 0.0, 4.0]), -torch.eye(3)[2])))
    values = 2.0 * torch.rand(200, parameters, generator=torch.Generator().manual_seed(0)) - 1.0
    origins = rays.origins + 0.8 * torch.rand(200, 3, generator=torch.Generator().manual_seed(1))
    seen = fit.model(Rays(origins, rays.directions), values, pictures.box)
    (seen.pixels[:, :3] - 0.9).square().mean().backward()
    gradients = [level.spatial.grad.double().abs().mean() for level in fit.model.radiance.levels]
    return float(torch.stack(gradients).mean())


def test_the_naive_start_loses_its_gradients_to_the_number_of_parameters() -> None:
    """Its gradients are products of all planes but one, of some 0.3 each: 14 with three parameters, 35 with six."""
    naive = [spatial_gradients(parameters, NAIVE) for parameters in (1, 3, 6)]
    ours = [spatial_gradients(parameters, METHOD) for parameters in (1, 3, 6)]
    assert naive[1] < 1e-3 * naive[0]
    assert naive[2] < 1e-8 * naive[1]
    assert min(ours) > 0.3 * max(ours)
    assert ours[2] > 1e12 * naive[2]


@pytest.mark.parametrize("background", [None, (0.1, 0.2, 0.3)], ids=["alpha", "opaque"])
@pytest.mark.parametrize("parameters", [0, 1, 3, 6])
def test_pictures_are_premultiplied_and_finite(parameters: int, background: tuple[float, float, float] | None) -> None:
    pictures = ball_pictures(MEMBERS[parameters], background=background)
    fit = trained(pictures, 3)
    camera = replace(pictures.camera(0).resized(11, 9))
    picture = fit.at(pictures.parameters[0])(camera)
    assert (picture.shape, picture.dtype) == ((9, 11, 4), np.float32)
    assert np.isfinite(picture).all()
    assert (picture >= 0.0).all()
    assert (picture[..., :3] <= picture[..., 3:] + 1e-6).all()
    assert 0.05 < picture[..., 3].max() <= 1.0 + 1e-6


Field = Callable[[Tensor, Tensor, Tensor], tuple[Tensor, Tensor]]


class Analytic(nn.Module):
    """A radiance field that is known: densities and colours from places (3, R, S), parameters (P, R), directions (R, 3)."""

    def __init__(self, field: Field) -> None:
        super().__init__()
        self.levels = nn.ModuleList()  # nothing to regularize
        self.field = field

    def forward(self, points: SamplePoints, directions: Tensor, bfloat16: bool) -> tuple[Tensor, Tensor]:
        density, color = self.field(points.places, points.parameters, directions)
        return density.expand(points.places.shape[1:]), color.expand(*points.places.shape[1:], 3)


def lengths_through(camera: Camera, low: Sequence[float], high: Sequence[float]) -> NDArray[np.float64]:
    """The length of every pixel's ray (H, W) in a box, in float64."""
    origin, directions = camera.rays()
    with np.errstate(divide="ignore"):
        to_planes = (np.array([low, high])[:, None, None] - origin) / directions  # [2, H, W, 3]
    return np.maximum(0.0, to_planes.max(axis=0).min(axis=-1) - to_planes.min(axis=0).max(axis=-1))


def test_a_constant_field_is_as_opaque_as_rays_are_long() -> None:
    """With outputs of zero the density is exp(-1) and the colour 0.5; pixels beside the box are empty."""
    pictures = ball_pictures([[0.0]])
    fit = training(pictures)
    with torch.no_grad():
        for weights in [*fit.model.radiance.geometry.parameters(), *fit.model.radiance.color.parameters()]:
            weights.zero_()
    camera = pictures.camera(1).resized(40, 40)
    alphas = 1.0 - np.exp(-np.exp(-1.0) * lengths_through(camera, [-1.0] * 3, [1.0] * 3))
    picture = fit.at(pictures.parameters[0])(camera)
    np.testing.assert_allclose(picture[..., 3], alphas, atol=1e-5)
    np.testing.assert_allclose(picture[..., :3], 0.5 * np.repeat(alphas[..., None], 3, axis=2), atol=1e-5)
    assert 100 < (picture[..., 3] == 0.0).sum() < 1200


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_places_are_scaled_to_the_box(axis: int) -> None:
    """Only the quarter of an odd box where one scaled coordinate is above 0.5 is dense."""
    low, high = [0.5, -1.0, 2.0], [2.5, 3.0, 2.5]
    camera = Camera.look_at((6.0, 7.0, 8.0), (1.5, 1.0, 2.25), vertical_fov_degrees=30, width=20, height=20)
    drawn = replace(ball_pictures([[]], size=20), cameras=[camera] * 4, box=torch.tensor([low, high]))
    fit = training(drawn)
    fit.model.counts = (64, 500)
    fit.model.radiance = Analytic(lambda places, *_: (torch.where(places[axis] > 0.5, 0.8, 0.0), torch.tensor(1.0)))
    quarter = [0.75 * h + 0.25 * lo if i == axis else lo for i, (lo, h) in enumerate(zip(low, high, strict=True))]
    expected = 1.0 - np.exp(-0.8 * lengths_through(camera, quarter, high))
    assert expected.max() > 0.1
    np.testing.assert_allclose(fit.at(torch.zeros(0))(camera)[..., 3], expected, atol=0.01)


def test_every_ray_has_its_direction_and_the_picture_s_parameters(monkeypatch: pytest.MonkeyPatch) -> None:
    pictures = ball_pictures([[0.3, -0.8]])
    fit, camera = training(pictures), pictures.camera(2).resized(30, 50)

    def field(places: Tensor, parameters: Tensor, directions: Tensor) -> tuple[Tensor, Tensor]:
        density = (1.0 + parameters[0] - 0.5 * parameters[1])[:, None]  # [R, 1]
        return density, (0.5 + 0.5 * directions)[:, None]

    fit.model.radiance = Analytic(field)
    picture = fit.at(pictures.parameters[0])(camera)
    _, directions = camera.rays()
    expected = 1.0 - np.exp(-1.7 * lengths_through(camera, [-1.0] * 3, [1.0] * 3))
    np.testing.assert_allclose(picture[..., 3], expected, atol=1e-5)
    np.testing.assert_allclose(picture[..., :3], (0.5 + 0.5 * directions) * expected[..., None], atol=1e-5)
    monkeypatch.setattr(kplanes, "CHUNK", 71)
    np.testing.assert_array_equal(fit.at(pictures.parameters[0])(camera), picture)


def test_a_picture_of_nothing_but_misses_is_empty() -> None:
    pictures = ball_pictures([[0.0]])
    away = Camera.look_at((4.0, 0.0, 0.0), (8.0, 0.0, 0.0), vertical_fov_degrees=30, width=6, height=5)
    fit = training(replace(pictures, cameras=[away.resized(16, 16)] * 4))
    assert (fit.at(pictures.parameters[0])(away) == 0.0).all()
    assert np.isfinite(fit.advance())


def squared_errors(pictures: TrainingImages, steps: int) -> NDArray[np.float64]:
    """The losses of a field that is and stays perfectly transparent, without those of its planes."""
    fit = training(pictures, steps, rate=1e-30)
    with torch.no_grad():
        first, last = fit.model.radiance.geometry.parameters()
        first.fill_(1.0)
        last.fill_(-1e5)
    planes = float(fit.model.regularization().detach())
    return np.array([fit.advance() for _ in range(steps)]) - planes


def whole(pictures: TrainingImages, value: int, alpha: int) -> TrainingImages:
    pixels = np.full_like(pictures.pixels, value)
    pixels[..., 3] = alpha
    return replace(pictures, pixels=pixels)


def test_pictures_with_alpha_are_learnt_over_a_random_colour_in_each_step() -> None:
    scene = ball_pictures([[0.0]])
    np.testing.assert_allclose(squared_errors(whole(scene, 0, 0), 5), 0.0, atol=1e-6)
    white = squared_errors(whole(scene, 255, 255), 40)  # the mean over channels of (1 - background)^2
    assert white.mean() == pytest.approx(1.0 / 3.0, abs=0.08)
    assert white.min() < 0.2 < 0.5 < white.max()


def test_opaque_pictures_are_learnt_over_their_background() -> None:
    scene = ball_pictures([[0.0]], background=(1.0, 1.0, 1.0))
    np.testing.assert_allclose(squared_errors(whole(scene, 255, 255), 5), 0.0, atol=1e-6)
    np.testing.assert_allclose(squared_errors(whole(scene, 0, 255), 5), 1.0, atol=1e-6)
    grey = replace(whole(scene, 255, 255), background=(1.0, 0.5, 0.0))
    np.testing.assert_allclose(squared_errors(grey, 5), (0.0 + 0.25 + 1.0) / 3.0, atol=1e-6)


def test_rays_of_a_step_keep_their_own_parameters_and_pixels(monkeypatch: pytest.MonkeyPatch) -> None:
    """Pictures of a box that is black or not there, as the first parameter says, and a field that shows just that."""
    pictures = ball_pictures([[1.0, 0.0], [-1.0, 0.0]])
    pixels = np.zeros_like(pictures.pixels)
    for number in range(len(pictures)):
        inside = lengths_through(pictures.camera(number), [-1.0] * 3, [1.0] * 3) > 0.0
        pixels[number, ..., 3] = 255 * (inside & (pictures.parameters[number, 0].item() > 0.0))
    fit = training(replace(pictures, pixels=pixels))
    fit.model.radiance = Analytic(lambda _, parameters, __: (1e4 * (parameters[0, :, None] > 0.0), torch.tensor(0.0)))
    errors: list[float] = []
    monkeypatch.setattr(kplanes, "mse_loss", lambda *pair: errors.append(mse_loss(*pair).item()) or mse_loss(*pair))
    for _ in range(5):
        fit.advance()
    assert len(errors) == 5
    assert max(errors) < 1e-3


def test_the_loss_is_the_sum_of_its_parts(monkeypatch: pytest.MonkeyPatch) -> None:
    """The interlevel loss is a mean over all samples of all rays, of which those beside the box have none."""
    fit = training(ball_pictures([[0.5]]), rate=1e-30)
    parts: list[float] = [float(fit.model.regularization().detach())]

    def recorded(*pair: WeightedSamples) -> Tensor:
        losses = interlevel_loss(*pair)
        assert 10 < len(losses) < TINY.rays
        parts.append(losses.sum().item() / (TINY.rays * TINY.samples[-1]))
        return losses

    monkeypatch.setattr(kplanes, "interlevel_loss", recorded)
    monkeypatch.setattr(kplanes, "mse_loss", lambda *pair: parts.append(mse_loss(*pair).item()) or mse_loss(*pair))
    with torch.no_grad():  # so that the proposal falls short of a dense field
        fit.model.radiance.geometry[0].weight.mul_(60.0)
    loss = fit.advance()
    assert len(parts) == 3
    assert parts[1] > 1e-4
    assert loss == pytest.approx(sum(parts), rel=1e-5)


def test_the_proposals_network_learns_every_other_step_at_first() -> None:
    fit = training(ball_pictures([[0.5]]), 10_000)
    weights = fit.tensors()["proposals.0.network.0.weight"]
    moved = []
    for step in range(10):
        before = weights.clone()
        fit.advance()
        moved += [step] * (not torch.equal(weights, before))
    assert moved == [1, 2, 3, 5, 7, 9]  # the rate of step 0 is 0, and the first 10 of 30,001 steps are 3.3 of 10,000


def mean_psnr(fit: KPlanesTraining, pictures: TrainingImages) -> float:
    chosen = range(len(pictures))
    return float(np.mean([psnr_over(pictures, i, fit.at(pictures.parameters[i])(pictures.camera(i))) for i in chosen]))


def test_one_member_is_learnt() -> None:
    pictures = ball_pictures([[]], views=3, size=12)
    assert mean_psnr(trained(pictures, 150, rate=3.0), pictures) > psnr_of_mean(pictures) + 5.0


def test_a_single_opaque_picture_is_learnt() -> None:
    pictures = ball_pictures([[0.2, 0.4, -0.3]], views=1, size=12, background=(0.1, 0.2, 0.4))
    before = mean_psnr(training(pictures), pictures)
    assert mean_psnr(trained(pictures, 40, rate=3.0), pictures) > before + 6.0


@pytest.mark.slow
def test_members_are_told_apart_and_the_naive_start_learns_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(kplanes, "SMALL", replace(TINY, resolutions=(12,)))
    members = [[-1.0, 1.0, -1.0, 0.0, 0.0, 0.0], [1.0, -1.0, 1.0, 0.0, 0.0, 0.0]]
    pictures = ball_pictures(members, views=2, size=12)
    fit = trained(pictures, 150, rate=3.0)
    assert mean_psnr(fit, pictures) > psnr_of_mean(pictures) + 5.0
    swapped = replace(pictures, parameters=pictures.parameters.flip(0))
    assert mean_psnr(fit, swapped) < mean_psnr(fit, pictures) - 6.0
    naive = trained(pictures, 50, rate=3.0, method=NAIVE)
    assert mean_psnr(naive, pictures) < psnr_of_mean(pictures)


def test_the_same_seed_gives_the_same_numbers() -> None:
    pictures = ball_pictures([[-1.0], [1.0]])

    def found(seed: int) -> tuple[list[float], NDArray[np.float32], list[Tensor]]:
        torch.manual_seed(np.random.default_rng().integers(1000))  # nothing is drawn from torch's own generator
        fit = training(pictures, 5, seed=seed)
        starts.append(fit.tensors()["radiance.levels.0.spatial"].clone())
        losses = [fit.advance() for _ in range(5)]
        return losses, fit.at(pictures.parameters[0])(pictures.camera(0)), list(fit.tensors().values())

    starts: list[Tensor] = []
    (losses, picture, tensors), (again, same, kept), (others, other, _) = found(3), found(3), found(4)
    assert losses == again
    np.testing.assert_array_equal(picture, same)
    assert all(torch.equal(a, b) for a, b in zip(tensors, kept, strict=True))
    assert not set(losses) & set(others)
    assert torch.equal(starts[0], starts[1])
    assert not torch.equal(starts[0], starts[2])
    assert not np.allclose(picture, other, atol=1e-4)


def test_rates_grow_then_fall_like_a_cosine() -> None:
    """Of the official steps, as its lambda computes them from a step's number."""
    assert rate_at(0.0) == 0.0
    assert rate_at(256 / 30_001) == pytest.approx(0.5)
    assert rate_at(512 / 30_001) == pytest.approx(1.0)
    assert rate_at(15_256.5 / 30_001) == pytest.approx(0.5 * (1.0 + np.cos(np.pi * 0.999 * 0.5)))
    assert 0.0 < rate_at(1.0) < 1e-5


@pytest.mark.parametrize("steps", [1, 2, 7])
def test_short_plans_are_learnt_to_their_end(steps: int, monkeypatch: pytest.MonkeyPatch) -> None:
    fractions: list[float] = []
    monkeypatch.setattr(kplanes, "rate_at", lambda fraction: fractions.append(fraction) or rate_at(fraction))
    pictures = ball_pictures([[0.5]])
    fit = trained(pictures, steps, rate=3.0)
    np.testing.assert_allclose(fractions, np.arange(steps) / steps)
    assert all(torch.isfinite(tensor).all() for tensor in fit.tensors().values())
    assert np.isfinite(fit.at(pictures.parameters[0])(pictures.camera(0))).all()


def test_the_plan_s_rate_multiplies_adam_s() -> None:
    """Adam's first steps are as long as its rate, whatever the gradients are."""
    pictures = ball_pictures([[0.5]])
    moved = []
    for rate in (0.5, 2.0):
        fit = training(pictures, 1000, rate=rate)
        before = {name: tensor.clone() for name, tensor in fit.tensors().items()}
        for _ in range(3):
            fit.advance()
        name = "radiance.geometry.2.weight"
        moved.append((fit.tensors()[name] - before[name]).abs().max().item())
    places = np.array([1.0, 2.0]) / 1000
    expected = 0.01 * sum(rate_at(place) for place in places)
    np.testing.assert_allclose(moved, [0.5 * expected, 2.0 * expected], rtol=0.05)


def test_networks_in_bfloat16_learn_too() -> None:
    pictures = ball_pictures([[0.5]])
    fit = trained(pictures, 5, precision="bfloat16")
    exact = trained(pictures, 5)
    cameras = cameras_around(1, 16)
    rounded, picture = (f.at(pictures.parameters[0])(cameras[0]) for f in (fit, exact))
    assert rounded.dtype == np.float32
    assert all(tensor.dtype == torch.float32 for tensor in fit.tensors().values())
    np.testing.assert_allclose(rounded, picture, atol=0.02)
    assert not np.array_equal(rounded, picture)


def test_model_files_hold_all_planes_and_weights() -> None:
    fit = training(ball_pictures([[]]))
    assert sum(tensor.numel() for tensor in fit.tensors().values()) == size_of(0, TINY)
    assert all(tensor.numel() for tensor in fit.tensors().values())
