from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
import torch

from catalogs.vocabulary.cameras import Camera
from research.studies.baselines.method import Plan, TrainingImages
from research.studies.baselines.rays import PixelSampler, Rays, crossings
from research.studies.baselines.visnerf import (
    METHOD,
    RESETS,
    SIZES,
    Sizes,
    ViSNeRFTraining,
    crossing_pixels,
    marched,
    rate_factor,
    regularization,
    rendered,
    resets,
    sample_count,
    skipped_color,
    variation_weight,
)
from research.studies.baselines.visnerf_field import (
    ViSNeRFArchitecture,
    ViSNeRFField,
)
from tests.research.support.baseline_scenes import ball_pictures, psnr_of_mean, psnr_over
from tests.research.support.visnerf_formula import (
    UNEVEN,
    expected_outputs,
    field_of,
    in_float64,
)

TINY = Sizes(rays=128, first_samples=12, last_samples=24, stride=1.0, voxels=12**3 + 1)
QUICK = replace(TINY, rays=96, first_samples=8, last_samples=12, voxels=8**3 + 1)  # enough to learn a few pictures
BOX = torch.tensor([[-1.0, -1.0, -1.0], [1.0, 1.0, 1.0]])


def uniform(density: float, color: float, architecture: ViSNeRFArchitecture) -> ViSNeRFField:
    """A field of one density and one grey."""
    tensors = architecture.initial(np.random.default_rng(0))
    biases = {"density": 10.0 + math.log(math.expm1(density)), "color": math.log(color / (1.0 - color))}
    for quantity, bias in biases.items():
        tensors[f"{quantity}.layer_3.weights"].zero_()
        tensors[f"{quantity}.layer_3.biases"].fill_(bias)
    return ViSNeRFField(tensors, architecture)


def test_the_published_settings_for_nyx_have_3244964_parameters() -> None:
    """Vectors of 3, 3 and 5 entries: the released settings' `vecSize_params`."""
    values = [[a, b, c] for a in (-1, 0, 1) for b in (-1, 0, 1) for c in (-1.0, -0.5, 0.0, 0.5, 1.0)]
    pictures = ball_pictures(values, views=1, size=2)
    tensors = METHOD.begin(pictures, Plan(10), {}).tensors()
    assert sum(tensor.numel() for tensor in tensors.values()) == 3_244_964
    networks = {"density": 35_969, "color": 36_227}
    for name, count in networks.items():
        assert sum(t.numel() for key, t in tensors.items() if key.startswith(f"{name}.layer")) == count
    assert tensors["density.basis.weights"].shape == (27, 16 + 12)
    assert tensors["color.basis.weights"].shape == (27, 48 + 12)


def test_regularization_pulls_densities_to_zero_and_their_vectors_to_one() -> None:
    field = field_of(UNEVEN)
    tensors = in_float64(field)
    sparsity = sum(np.abs(tensors[f"density.{name}"]).mean() for name in ("plane_xy", "plane_xz", "plane_yz"))
    sparsity += sum(np.abs(tensors[f"density.line_{axis}"]).mean() for axis in "xyz")
    sparsity += sum(np.abs(tensors[f"density.vector_{j}"] - 1.0).mean() for j in (0, 1))
    smooth = {"plane_xy": 1e-2, "plane_xz": 1e-2, "plane_yz": 1e-2, "vector_0": 1e-3, "vector_1": 1e-3}
    rough = 0.0
    for name, weight in smooth.items():
        grid = tensors[f"color.{name}"]
        rough += weight * 2.0 * sum((np.diff(grid, axis=a) ** 2).mean() for a in (1, 2) if grid.shape[a] > 1)
    found = [float(regularization(field, weight)) for weight in (0.0, 1.0, 0.3)]
    np.testing.assert_allclose(found, 8e-5 * sparsity + np.array([0.0, 1.0, 0.3]) * rough, rtol=1e-5)


def test_rates_fall_to_a_tenth_and_start_anew_five_times() -> None:
    assert resets(90_000) == set(RESETS)
    steps = np.array([0, 5_999, 6_000, 20_999, 21_000, 66_000, 89_999])
    found = [rate_factor(int(step), 90_000) for step in steps]
    np.testing.assert_allclose(found, 0.1 ** (np.array([0, 5_999, 0, 4_499, 0, 45_000, 68_999]) / 90_000))


def test_samples_become_denser_until_two_thirds_of_the_steps() -> None:
    official, small = SIZES["official"], SIZES["small"]
    assert [sample_count(s, 90_000, official) for s in (0, 30_000, 60_000, 89_999)] == [64, 130, 196, 196]
    assert [sample_count(s, 90, small) for s in (0, 30, 60, 89)] == [32, 65, 98, 98]


@pytest.mark.parametrize("steps", [1, 2, 7])
def test_schedules_of_short_plans(steps: int) -> None:
    assert variation_weight(steps - 1, steps) == pytest.approx(0.1)
    assert sample_count(0, steps, TINY) == TINY.first_samples
    assert sample_count(steps - 1, steps, TINY) == {1: 12, 2: 21, 7: 24}[steps]
    assert resets(steps) == {1: set(), 2: set(), 7: {1, 2}}[steps]
    assert 0.1 < rate_factor(steps - 1, steps) <= 1.0
    training = ViSNeRFTraining(ball_pictures([[-1.0], [1.0]], 1, 8), Plan(steps), TINY)
    assert np.isfinite([training.advance() for _ in range(steps)]).all()


def test_samples_are_evenly_spaced_from_where_the_ray_enters() -> None:
    rays = Rays(torch.tensor([[-3.0, 0.0, 0.0], [0.0, -2.0, 0.0]]), torch.tensor([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]))
    near = crossings(rays, BOX)[0]
    samples = marched(rays, near, 0.5, 5, torch.tensor([[0.0], [0.4]]))
    np.testing.assert_allclose(samples.points[0, :, 0], [-1.0, -0.5, 0.0, 0.5, 1.0], atol=1e-6)
    np.testing.assert_allclose(samples.points[1, :, 1], [-0.8, -0.3, 0.2, 0.7, 1.2], atol=1e-6)
    np.testing.assert_allclose(samples.lengths, [[0.5, 0.5, 0.5, 0.5, 0.0]] * 2, atol=1e-6)


def test_rays_are_summed_up_sample_by_sample() -> None:
    """Each with its own parameters and direction, in a box of any size, in float64."""
    field = field_of(UNEVEN, spread=2.0)
    field.tensors["density.layer_3.biases"].fill_(6.0)
    low, high = np.array([-1.0, -2.0, 0.0]), np.array([3.0, 2.0, 1.0])
    origins = np.array([[-2.0, 0.5, 0.6], [1.0, 3.0, 0.2], [0.0, 0.0, -1.0]])
    directions = np.array([[0.96, 0.28, 0.0], [-0.28, -0.96, 0.0], [0.6, 0.0, 0.8]])
    parameters = np.array([[-0.5, 0.9], [0.7, -0.2], [0.1, 0.4]])
    distance, count, behind = 0.3, 14, 0.25

    expected = np.zeros((3, 4))
    for ray in range(3):
        through = 1.0
        for sample in range(count - 1):
            point = origins[ray] + directions[ray] * (0.9 + distance * sample)
            if (point < low).any() or (point > high).any():
                continue
            row = (field, (point - low) / (high - low) * 2.0 - 1.0, parameters[ray], directions[ray])
            density = np.log1p(np.exp(expected_outputs(row[0], "density", *row[1:])[0] - 10.0))
            weight = through * (1.0 - math.exp(-density * 25.0 * distance))
            color = 1.0 / (1.0 + np.exp(-expected_outputs(row[0], "color", *row[1:])))
            expected[ray] += weight * np.append(color if weight > 1e-4 else np.full(3, behind), 1.0)
            through -= weight

    rays = Rays(*(torch.from_numpy(part).float() for part in (origins, directions)))
    samples = marched(rays, torch.full((3,), 0.9), distance, count)
    box, asked = torch.from_numpy(np.stack([low, high])).float(), torch.from_numpy(parameters).float()
    found = rendered(field, box, rays, asked, samples, torch.full((3,), behind))
    np.testing.assert_allclose(found, expected, atol=2e-4)
    assert (expected[:, 3] > 0.2).all()


def test_a_uniform_fog_absorbs_as_beer_and_lambert_say() -> None:
    sizes = Sizes(voxels=64**3 + 1)
    pictures = ball_pictures([[0.0]], 1, 9)
    training = ViSNeRFTraining(pictures, Plan(1), sizes)
    training.field = uniform(0.02, 0.3, training.field.architecture)
    camera = Camera.look_at((4.0, 0.0, 0.0), (0.0, 0.0, 0.0), vertical_fov_degrees=50.0, width=9, height=9)
    picture = training.at(torch.zeros(1))(camera)
    assert picture[4, 4, 3] == pytest.approx(1.0 - math.exp(-25.0 * 0.02 * 2.0), rel=0.01)  # 2 units of length
    np.testing.assert_allclose(picture[4, 4, :3], 0.3 * picture[4, 4, 3], rtol=1e-4)
    assert (picture[0, 0] == 0.0).all()  # its ray passes beside the box


def test_training_samples_see_the_same_fog() -> None:
    field = uniform(0.02, 0.3, ViSNeRFArchitecture((8, 8, 8), ()))
    rays = Rays(torch.tensor([[-3.0, 0.2, 0.1]]), torch.tensor([[1.0, 0.0, 0.0]]))
    near, far = crossings(rays, BOX)
    samples = marched(rays, near, (far - near).max() / 196, 196, torch.tensor([[0.7]]))
    found = rendered(field, BOX, rays, torch.zeros(1, 0), samples, torch.zeros(3))
    assert float(found[0, 3]) == pytest.approx(1.0 - math.exp(-1.0), rel=0.01)


def test_what_has_too_little_weight_is_not_asked_for_its_colour() -> None:
    """As published it is then black; before a black background that would have no gradient, and so it is white there."""
    assert skipped_color((1.0, 1.0, 1.0)) == (0.0, 0.0, 0.0)
    assert skipped_color((0.0, 0.2, 0.8)) == (1.0, 1.0, 0.0)
    rays = Rays(torch.tensor([[-3.0, 0.2, 0.1]]), torch.tensor([[1.0, 0.0, 0.0]]))
    near, far = crossings(rays, BOX)
    samples = marched(rays, near, (far - near).max() / 64, 64)
    gradients = []
    for behind in ((1.0, 1.0, 1.0), (0.0, 0.0, 0.0)):
        tensors = ViSNeRFArchitecture((8, 8, 8), ()).initial(np.random.default_rng(0))
        bias = tensors["density.layer_3.biases"].requires_grad_()
        field = ViSNeRFField(tensors, ViSNeRFArchitecture((8, 8, 8), ()))
        for skipped in (skipped_color(behind), behind):
            found = rendered(field, BOX, rays, torch.zeros(1, 0), samples, torch.tensor(skipped))
            assert 0.0 < found[0, 3].item() < 64 * 1e-4
            shown = found[:, :3] + (1.0 - found[:, 3:]) * torch.tensor(behind)
            gradients.append(float(torch.autograd.grad(shown.sum(), bias)[0]))
    assert gradients[0] < -1e-4
    assert gradients[2] > 1e-4
    assert gradients[1] == pytest.approx(0.0, abs=1e-8)
    assert gradients[3] == 0.0


def test_only_rays_that_cross_the_box_are_learnt_from() -> None:
    pictures = ball_pictures([[0.0]], 2, 16)
    small = 0.2 * BOX
    batch = crossing_pixels(PixelSampler(pictures), small, 100, torch.Generator().manual_seed(0))
    near, far = crossings(batch.rays, small)
    assert len(batch.pixels) == len(batch.parameters) == len(far) == 100
    assert bool((far > near).all())
    with pytest.raises(ValueError, match="crosses the box"):
        crossing_pixels(PixelSampler(pictures), small + 100.0, 8, torch.Generator().manual_seed(0))


@pytest.mark.parametrize("parameters", [0, 1, 3, 6])
@pytest.mark.parametrize("background", [None, (0.2, 0.5, 0.9)], ids=["alpha", "opaque"])
def test_pictures_are_premultiplied(parameters: int, background: tuple[float, float, float] | None) -> None:
    pictures = ball_pictures(np.eye(2, parameters), 2, 8, background=background)
    training = ViSNeRFTraining(pictures, Plan(20), TINY)
    for _ in range(4):
        assert math.isfinite(training.advance())
    picture = training.at(pictures.parameters[0])(pictures.camera(1))
    assert picture.shape == (8, 8, 4)
    assert picture.dtype == np.float32
    assert np.isfinite(picture).all()
    assert (picture[..., :3] <= picture[..., 3:] + 1e-5).all()
    assert (picture >= 0.0).all()
    assert 0.0 < picture[..., 3].max() <= 1.0 + 1e-5


def test_a_single_picture_is_enough() -> None:
    pictures = ball_pictures([[0.3, -0.2]], 1, 8)
    training = ViSNeRFTraining(pictures, Plan(3), TINY)
    assert np.isfinite([training.advance() for _ in range(3)]).all()


def trained(pictures: TrainingImages, plan: Plan, sizes: Sizes = QUICK) -> ViSNeRFTraining:
    training = ViSNeRFTraining(pictures, plan, sizes)
    for _ in range(plan.steps):
        training.advance()
    return training


def test_the_seed_decides_everything() -> None:
    pictures = ball_pictures([[-1.0], [1.0]], 2, 8)
    first, again, other = (trained(pictures, Plan(3, seed=seed)).tensors() for seed in (4, 4, 5))
    assert all(torch.equal(first[name], again[name]) for name in first)
    assert not torch.equal(first["density.plane_xy"], other["density.plane_xy"])
    untrained = [ViSNeRFTraining(pictures, Plan(3, seed=seed), TINY) for seed in (4, 5)]
    for name in untrained[1].field.tensors:  # the same start, but other pixels
        untrained[1].field.tensors[name].data.copy_(untrained[0].field.tensors[name])
    assert untrained[0].advance() != untrained[1].advance()


def moves(training: ViSNeRFTraining) -> dict[str, torch.Tensor]:
    """The change of every number in a step."""
    before = {name: tensor.clone() for name, tensor in training.tensors().items()}
    training.advance()
    return {name: (tensor - before[name]).abs() for name, tensor in training.tensors().items()}


@pytest.mark.parametrize("rate", [1.0, 0.5])
def test_rates_are_those_published_times_that_of_the_plan(rate: float) -> None:
    """Adam's first step is as long as the rate, and so are the next while a gradient stays as it is."""
    training = ViSNeRFTraining(ball_pictures([[-1.0], [1.0]], 2, 8), Plan(7, rate=rate), TINY)
    moved = moves(training)
    for name in ("density.vector_0", "color.plane_xz"):
        assert float(moved[name].max()) == pytest.approx(0.02 * rate, rel=0.01)
    for name in ("density.basis.weights", "density.layer_1.weights", "density.layer_3.biases", "color.layer_2.weights"):
        assert float(moved[name].max()) == pytest.approx(1e-3 * rate, rel=0.02)
    later = [float(moves(training)["density.vector_0"].max()) for _ in range(3)]  # the resets are before 1 and 2
    np.testing.assert_allclose(later, 0.02 * rate * np.array([1.0, 1.0, 0.1 ** (1.0 / 7.0)]), rtol=0.01)


def test_adam_forgets_at_resets() -> None:
    """Only its first step moves by the rate whatever has a gradient."""
    training = ViSNeRFTraining(ball_pictures([[-1.0], [1.0]], 2, 8), Plan(90), TINY)
    medians = [float(moves(training)["density.vector_0"].median()) for _ in range(24)]
    assert [step for step, median in enumerate(medians) if median > 0.0199] == [0, 6, 9, 12, 16, 21]
    assert medians[20] < 0.01


def test_the_weight_of_total_variation_falls_throughout() -> None:
    training, random = ViSNeRFTraining(ball_pictures([[0.0]], 1, 8), Plan(7), TINY), torch.Generator().manual_seed(0)
    for step in range(5):
        with torch.no_grad():  # the variation of this plane is nearly all of the loss
            training.field.tensors["color.plane_xy"].normal_(0.0, 30.0, generator=random)
            rough = float(regularization(training.field, 1.0))
        assert training.advance() == pytest.approx(rough * 0.1 ** ((step + 1) / 7), rel=0.05)


def test_bfloat16_is_of_the_networks_alone() -> None:
    exact = field_of(UNEVEN, spread=1.5)
    rounded = ViSNeRFField(exact.tensors, exact.architecture, bfloat16=True)
    points = torch.rand(50, 3, generator=torch.Generator().manual_seed(0)) * 2.0 - 1.0
    vectors = exact.vectors_at("color", points[:, :2])
    assert torch.equal(vectors, rounded.vectors_at("color", points[:, :2]))
    assert torch.equal(exact.components("color", points), rounded.components("color", points))
    ways = torch.nn.functional.normalize(points, dim=1)
    one, two = (field.colors(points, vectors, ways) for field in (exact, rounded))
    assert two.dtype == torch.float32
    assert 1e-4 < float((one - two).abs().max()) < 0.1
    pictures = ball_pictures([[0.0]], 2, 8)
    training = ViSNeRFTraining(pictures, Plan(3, precision="bfloat16"), TINY)
    assert training.field.bfloat16
    assert np.isfinite([training.advance() for _ in range(3)]).all()


def test_small_is_begun_by_its_method() -> None:
    pictures = ball_pictures([[-1.0], [0.0], [1.0]], 2, 12)
    assert (METHOD.name, METHOD.title, METHOD.official_steps) == ("visnerf", "ViSNeRF", 90_000)
    fit = METHOD.begin(pictures, Plan(2, size="small"), {})
    assert math.isfinite(fit.advance())
    assert fit.at(pictures.parameters[0])(pictures.camera(0)).shape == (12, 12, 4)
    assert fit.tensors()["color.plane_xy"].shape == (48, 128, 128)


def test_it_learns_the_pictures_of_one_member() -> None:
    pictures = ball_pictures([[]], 6, 12)
    training = trained(pictures, Plan(120, rate=2.0))
    found = [psnr_over(pictures, n, training.at(pictures.parameters[n])(pictures.camera(n))) for n in range(6)]
    assert np.mean(found) > psnr_of_mean(pictures) + 3.0


@pytest.mark.slow
def test_it_learns_what_a_parameter_moves_over_a_background() -> None:
    """Shown are the pictures that were asked for, not those of the other member."""
    pictures = ball_pictures([[-1.0], [1.0]], 3, 12, background=(0.2, 0.6, 0.5))
    training = trained(pictures, Plan(180, rate=2.0))
    for number in range(6):
        shown = training.at(pictures.parameters[number])(pictures.camera(number))
        assert psnr_over(pictures, number, shown) > psnr_of_mean(pictures) + 5.0
        assert psnr_over(pictures, (number + 3) % 6, shown) < psnr_of_mean(pictures) + 1.0


@pytest.mark.slow
def test_it_learns_opaque_pictures_over_black() -> None:
    pictures = ball_pictures([[]], 3, 12, background=(0.0, 0.0, 0.0))
    training = trained(pictures, Plan(140, rate=2.0))
    found = [psnr_over(pictures, n, training.at(pictures.parameters[n])(pictures.camera(n))) for n in range(3)]
    assert np.mean(found) > psnr_of_mean(pictures) + 2.5
