from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
import torch
from numpy.typing import NDArray

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
    Quantity,
    ViSNeRFArchitecture,
    ViSNeRFField,
    encoded,
    grid_of,
    variation,
    vector_lengths,
)
from tests.research.support.baseline_scenes import ball_pictures, psnr_of_mean, psnr_over

TINY = Sizes(rays=128, first_samples=12, last_samples=24, stride=1.0, voxels=12**3 + 1)
QUICK = replace(TINY, rays=96, first_samples=8, last_samples=12, voxels=8**3 + 1)  # enough to learn a few pictures
BOX = torch.tensor([[-1.0, -1.0, -1.0], [1.0, 1.0, 1.0]])
UNEVEN = ViSNeRFArchitecture((5, 4, 3), (3, 6))
QUANTITIES: tuple[Quantity, ...] = ("density", "color")


def field_of(architecture: ViSNeRFArchitecture, seed: int = 0, spread: float = 1.0) -> ViSNeRFField:
    """A field of normal numbers, whose densities and colours vary strongly."""
    random = np.random.default_rng(seed)
    first = architecture.initial(random)
    tensors = {name: torch.from_numpy(random.normal(size=t.shape)).float() for name, t in first.items()}
    networks = {name: t * spread / math.sqrt(t.shape[-1]) for name, t in tensors.items() if ".weights" in name}
    return ViSNeRFField(tensors | networks, architecture)


def uniform(density: float, color: float, architecture: ViSNeRFArchitecture) -> ViSNeRFField:
    """A field of one density and one grey."""
    tensors = architecture.initial(np.random.default_rng(0))
    biases = {"density": 10.0 + math.log(math.expm1(density)), "color": math.log(color / (1.0 - color))}
    for quantity, bias in biases.items():
        tensors[f"{quantity}.layer_3.weights"].zero_()
        tensors[f"{quantity}.layer_3.biases"].fill_(bias)
    return ViSNeRFField(tensors, architecture)


def in_float64(field: ViSNeRFField) -> dict[str, NDArray[np.float64]]:
    return {name: tensor.double().numpy() for name, tensor in field.tensors.items()}


def lerp(values: NDArray[np.float64], at: float) -> NDArray[np.float64]:
    """Values (C, L) between -1 and 1, linearly interpolated: (C,)."""
    return np.array([np.interp(at, np.linspace(-1.0, 1.0, values.shape[1]), row) for row in values])


def bilerp(plane: NDArray[np.float64], column: float, row: float) -> NDArray[np.float64]:
    return lerp(np.stack([lerp(rows, column) for rows in plane.transpose(1, 0, 2)], axis=1), row)


def expected_components(
    tensors: dict[str, NDArray[np.float64]], kind: str, point: NDArray[np.float64]
) -> NDArray[np.float64]:
    x, y, z = point
    return (
        bilerp(tensors[f"{kind}.plane_xy"], x, y) * lerp(tensors[f"{kind}.line_z"][..., 0], z)
        + bilerp(tensors[f"{kind}.plane_xz"], x, z) * lerp(tensors[f"{kind}.line_y"][..., 0], y)
        + bilerp(tensors[f"{kind}.plane_yz"], y, z) * lerp(tensors[f"{kind}.line_x"][..., 0], x)
    )


def expected_outputs(
    field: ViSNeRFField,
    kind: str,
    point: NDArray[np.float64],
    parameters: NDArray[np.float64],
    direction: NDArray[np.float64],
) -> NDArray[np.float64]:
    """A network's output before its activation, written out in float64."""
    tensors = in_float64(field)
    vectors = [lerp(tensors[f"{kind}.vector_{j}"][..., 0], p) for j, p in enumerate(parameters)]
    known = np.concatenate([expected_components(tensors, kind, point), *vectors])
    features = tensors[f"{kind}.basis.weights"] @ known

    def waves(values: NDArray[np.float64]) -> list[float]:
        both = [factor * value for value in values for factor in (1, 2)]
        return [math.sin(v) for v in both] + [math.cos(v) for v in both]

    if kind == "density":
        inputs = [*point, *features, *waves(point), *waves(features)]
    else:
        inputs = [*features, *direction, *waves(features), *waves(direction)]
    hidden = np.array(inputs)
    for layer in (1, 2, 3):
        weights, biases = tensors[f"{kind}.layer_{layer}.weights"], tensors[f"{kind}.layer_{layer}.biases"]
        hidden = weights @ (np.maximum(hidden, 0.0) if layer > 1 else hidden) + biases
    return hidden


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


@pytest.mark.parametrize(
    ("sides", "grid"),
    [((0.36, 0.36, 0.36), (128, 128, 128)), ((4.0, 2.0, 2.0), (203, 101, 101)), ((1.0, 1.0, 1e-3), (1279, 1279, 2))],
)
def test_voxels_are_cubes(sides: tuple[float, ...], grid: tuple[int, ...]) -> None:
    low = torch.tensor([-0.18, 3.0, 0.0])
    high = low + torch.tensor(sides)
    if sides[0] == 0.36:
        low, high = torch.full((3,), -0.18), torch.full((3,), 0.18)
    found = grid_of(torch.stack([low, high]), SIZES["official"].voxels)
    assert found == pytest.approx(grid, rel=0.05)
    assert found[2] == grid[2]


def test_vectors_have_an_entry_for_each_value_but_not_many() -> None:
    random = np.random.default_rng(0)
    columns = [np.zeros(60), np.arange(60) % 2, np.arange(60) % 7, np.arange(60) % 16, random.uniform(-1, 1, 60)]
    assert vector_lengths(torch.from_numpy(np.stack(columns, axis=1)).float()) == (3, 3, 7, 16, 16)
    assert vector_lengths(torch.zeros(5, 0)) == ()


@pytest.mark.parametrize("quantity", QUANTITIES)
def test_components_are_sums_of_planes_times_lines(quantity: Quantity) -> None:
    """With sides of different lengths, so that no two axes can be confused."""
    field = field_of(UNEVEN)
    points = np.random.default_rng(1).uniform(-1.0, 1.0, (20, 3))
    points[:4] = [[-1, -1, -1], [1, 1, 1], [1, -1, 0], [-1, 1, 1]]
    expected = np.stack([expected_components(in_float64(field), quantity, point) for point in points])
    found = field.components(quantity, torch.from_numpy(points).float())
    np.testing.assert_allclose(found.numpy(), expected, atol=2e-5)


@pytest.mark.parametrize("quantity", QUANTITIES)
def test_parameters_read_their_vectors_from_end_to_end(quantity: Quantity) -> None:
    field = field_of(UNEVEN)
    first, second = (in_float64(field)[f"{quantity}.vector_{j}"][..., 0] for j in (0, 1))  # [4, 3], [4, 6]
    asked = torch.tensor([[-1.0, -1.0], [1.0, 1.0], [0.0, -0.6], [0.5, 0.0], [-1.4, 1.4]])
    expected = [
        np.append(first[:, 0], second[:, 0]),
        np.append(first[:, 2], second[:, 5]),
        np.append(first[:, 1], second[:, 1]),
        np.append((first[:, 1] + first[:, 2]) / 2, (second[:, 2] + second[:, 3]) / 2),
        np.append(first[:, 0], second[:, 5]),
    ]
    np.testing.assert_allclose(field.vectors_at(quantity, asked).numpy(), expected, atol=1e-5)


def test_without_parameters_there_are_no_vectors() -> None:
    field = field_of(ViSNeRFArchitecture((4, 4, 4), ()))
    assert field.vectors_at("density", torch.zeros(7, 0)).shape == (7, 0)
    assert field.densities(torch.zeros(7, 3), torch.zeros(7, 0)).shape == (7,)


def test_values_are_encoded_by_sines_and_cosines_without_pi() -> None:
    found = encoded(torch.tensor([[0.3, -0.7]]))[0]
    sines = [math.sin(v) for v in (0.3, 0.6, -0.7, -1.4)]
    np.testing.assert_allclose(found, sines + [math.cos(v) for v in (0.3, 0.6, -0.7, -1.4)], atol=1e-6)


def test_densities_and_colours_are_those_of_the_formula() -> None:
    field, random = field_of(UNEVEN, spread=3.0), np.random.default_rng(2)
    points, parameters = random.uniform(-1, 1, (12, 3)), random.uniform(-1, 1, (12, 2))
    directions = random.normal(size=(12, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    rows = list(zip(points, parameters, directions, strict=True))
    at, ways, asked = (torch.from_numpy(values).float() for values in (points, directions, parameters))

    logits = np.array([expected_outputs(field, "density", *row)[0] for row in rows])
    densities = field.densities(at, field.vectors_at("density", asked))
    np.testing.assert_allclose(densities, np.log1p(np.exp(logits - 10.0)), rtol=1e-3)
    assert np.ptp(logits) > 1.0

    logits = np.array([expected_outputs(field, "color", *row) for row in rows])
    colors = field.colors(at, field.vectors_at("color", asked), ways)
    np.testing.assert_allclose(colors, 1.0 / (1.0 + np.exp(-logits)), atol=1e-4)
    assert np.ptp(logits) > 1.0


def test_it_begins_almost_empty() -> None:
    first = ViSNeRFArchitecture((40, 40, 40), (3,)).initial(np.random.default_rng(0))
    for quantity in QUANTITIES:
        assert (first[f"{quantity}.vector_0"] == 0.1).all()
        assert (first[f"{quantity}.layer_3.biases"] == 0.0).all()
        assert float(first[f"{quantity}.plane_xz"].std()) == pytest.approx(0.1, rel=0.02)
        assert float(first[f"{quantity}.line_y"].std()) == pytest.approx(0.1, rel=0.1)
        bound = 1.0 / math.sqrt(150.0)
        assert float(first[f"{quantity}.layer_1.weights"].abs().max()) == pytest.approx(bound, rel=1e-3)
    field = ViSNeRFField(first, ViSNeRFArchitecture((40, 40, 40), (3,)))
    points = torch.rand(200, 3, generator=torch.Generator().manual_seed(0)) * 2.0 - 1.0
    densities = field.densities(points, field.vectors_at("density", torch.zeros(200, 1)))
    assert float(densities.max()) < 2.0 * math.log1p(math.exp(-10.0))


def test_total_variation_is_that_of_neighbours() -> None:
    grid = np.random.default_rng(0).normal(size=(3, 4, 5))
    across = [(grid[c, i, j + 1] - grid[c, i, j]) ** 2 for c in range(3) for i in range(4) for j in range(4)]
    down = [(grid[c, i + 1, j] - grid[c, i, j]) ** 2 for c in range(3) for i in range(3) for j in range(5)]
    assert float(variation(torch.from_numpy(grid))) == pytest.approx(2.0 * (np.mean(across) + np.mean(down)))
    narrow = torch.from_numpy(grid[:, :, :1])
    assert float(variation(narrow)) == pytest.approx(2.0 * np.mean(np.diff(grid[:, :, 0], axis=1) ** 2))
    assert float(variation(narrow[:, :1])) == 0.0


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
