from collections.abc import Sequence

import numpy as np
import pytest
import torch

from research.studies.baselines.kplanes_field import (
    KPlanesArchitecture,
    Planes,
    ProposalField,
    RadianceField,
    SamplePoints,
    density_of,
    perceptron,
)
from research.studies.baselines.spherical_harmonics import harmonics

TINY = KPlanesArchitecture(4, (6, 8), (6,), (8, 6), 16, parameter_resolution=5, proposal_channels=3)


def some_points(parameters: int, rays: int = 5, samples: int = 7, reach: float = 1.0) -> SamplePoints:
    random = torch.Generator().manual_seed(parameters)
    places = reach * (2.0 * torch.rand(3, rays, samples, generator=random) - 1.0)
    return SamplePoints(places, reach * (2.0 * torch.rand(parameters, rays, generator=random) - 1.0))


def coordinates(points: SamplePoints) -> np.ndarray:
    """All coordinates (3 + P, R S) of points in float64."""
    samples = points.places.shape[2]
    of_rays = points.parameters.double().numpy().repeat(samples, axis=1)
    return np.concatenate([points.places.double().numpy().reshape(3, -1), of_rays])


def all_planes(planes: Planes, parameters: int) -> list[tuple[tuple[int, int], torch.Tensor]]:
    """Every plane with the two coordinates that it sees: across, then down."""
    among = [(3 + a, 3 + b) for a, b in planes.parameter_pairs]
    pairs = [*planes.spatial_pairs, *planes.mixed_pairs, *among]
    assert sorted(pairs) == [(a, b) for a in range(3 + parameters) for b in range(a + 1, 3 + parameters)]
    return list(zip(pairs, [*planes.spatial, *planes.mixed, *planes.among], strict=True))


def drawn(parameters: int, channels: int = 4, resolution: int = 6, along: int = 5) -> Planes:
    planes = Planes(parameters, channels, resolution, along)
    planes.start(torch.Generator().manual_seed(1), 0.5, parameters_at_one=False)
    return planes


@pytest.mark.parametrize("parameters", [0, 1, 3, 6])
def test_products_of_separable_planes_are_exact(parameters: int) -> None:
    """Bilinear interpolation knows (1 + a x) (1 + b y) exactly; every plane and channel has its own a and b."""
    planes, points = drawn(parameters), some_points(parameters)
    at = coordinates(points)
    expected = np.ones((4, at.shape[1]))
    random = np.random.default_rng(0)
    for (across, down), plane in all_planes(planes, parameters):
        slopes = random.uniform(-0.3, 0.3, (2, 4, 1))
        height, width = plane.shape[1:]
        rows = 1.0 + slopes[1] * np.linspace(-1.0, 1.0, height)  # [C, height]
        columns = 1.0 + slopes[0] * np.linspace(-1.0, 1.0, width)  # [C, width]
        plane.data.copy_(torch.from_numpy(rows[:, :, None] * columns[:, None]))
        expected *= (1.0 + slopes[0] * at[across]) * (1.0 + slopes[1] * at[down])
    np.testing.assert_allclose(planes(points).detach(), expected, rtol=2e-5)


def bilinear(plane: np.ndarray, x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """A plane (C, height, width) at (N,) coordinates in float64, with the border's values beyond it."""
    height, width = plane.shape[1:]
    column, row = (np.clip((c + 1.0) / 2.0, 0.0, 1.0) * (n - 1) for c, n in ((x, width), (y, height)))
    left, top = np.minimum(column.astype(int), width - 2), np.minimum(row.astype(int), height - 2)
    right_part, low_part = column - left, row - top
    upper = plane[:, top, left] * (1.0 - right_part) + plane[:, top, left + 1] * right_part
    lower = plane[:, top + 1, left] * (1.0 - right_part) + plane[:, top + 1, left + 1] * right_part
    return upper * (1.0 - low_part) + lower * low_part


@pytest.mark.parametrize("parameters", [0, 1, 3, 6])
def test_products_of_any_planes_agree_with_float64_also_beyond_their_borders(parameters: int) -> None:
    planes, points = drawn(parameters), some_points(parameters, reach=1.3)
    at = coordinates(points)
    expected = np.ones((4, at.shape[1]))
    for (across, down), plane in all_planes(planes, parameters):
        expected *= bilinear(plane.detach().double().numpy(), at[across], at[down])
    np.testing.assert_allclose(planes(points).detach(), expected, rtol=1e-4)


@pytest.mark.parametrize("parameters", [0, 1, 6])
def test_planes_of_parameters_start_at_one_and_others_are_drawn(parameters: int) -> None:
    planes = Planes(parameters, 8, 32, 5)
    planes.start(torch.Generator().manual_seed(0), 0.5, parameters_at_one=True)
    for (_, down), plane in all_planes(planes, parameters):
        if down < 3:
            assert 0.1 <= plane.min() < 0.11
            assert 0.49 < plane.max() <= 0.5
            assert plane.mean().item() == pytest.approx(0.3, abs=0.01)
        else:
            assert (plane == 1.0).all()


def regularization(planes: Planes, parameters: int, smoothness: float) -> float:
    """The official sums in float64, plane by plane."""
    total = 0.0
    for (across, down), parameter in all_planes(planes, parameters):
        plane = parameter.detach().double().numpy()
        variation = 2.0 * sum(np.mean(np.diff(plane, axis=axis) ** 2) for axis in (1, 2))
        total += 1e-4 * variation * (2.0 if down < 3 else 1.0)
        if down >= 3:
            total += 1e-4 * np.mean(np.abs(1.0 - plane)) + smoothness * np.mean(np.diff(plane, n=2, axis=1) ** 2)
        if across >= 3:
            total += smoothness * np.mean(np.diff(plane, n=2, axis=2) ** 2)
    return total


@pytest.mark.parametrize("smoothness", [0.0, 0.01, 7.0])
@pytest.mark.parametrize("parameters", [0, 1, 2, 4])
def test_regularization_agrees_with_sums_over_single_planes(parameters: int, smoothness: float) -> None:
    planes = drawn(parameters)
    expected = regularization(planes, parameters, smoothness)
    assert planes.regularization(smoothness).item() == pytest.approx(expected, rel=1e-5)


def test_straight_lines_along_a_parameter_do_not_bend_and_curves_in_space_are_free() -> None:
    planes = drawn(1, resolution=9, along=6)
    along, across = torch.linspace(-1.0, 1.0, 6)[:, None], torch.linspace(-1.0, 1.0, 9)
    planes.mixed.data.copy_((1.0 + 0.5 * along * across**2).expand_as(planes.mixed))
    straight = (planes.regularization(1e6) - planes.regularization(0.0)).item()
    planes.mixed.data.copy_((1.0 + 0.5 * along**2).expand_as(planes.mixed))
    bent = (planes.regularization(1e6) - planes.regularization(0.0)).item()
    assert straight < 1e-6 * bent


@pytest.mark.parametrize("along", [1, 2])
def test_so_few_values_along_a_parameter_have_no_second_difference(along: int) -> None:
    planes = drawn(2, along=along)
    assert planes.regularization(1.0).item() == pytest.approx(planes.regularization(0.0).item())
    planes.regularization(1.0).backward()
    assert all(torch.isfinite(plane.grad).all() for plane in planes.parameters())


def test_densities_are_exponentials_whose_gradients_are_cut() -> None:
    outputs = torch.tensor([-30.0, -2.0, 1.0, 3.0, 20.0], requires_grad=True)
    densities = density_of(outputs)
    np.testing.assert_allclose(densities.detach(), np.exp(outputs.detach().numpy() - 1.0), rtol=1e-6)
    densities.sum().backward()
    np.testing.assert_allclose(outputs.grad, np.exp([-15.0, -3.0, 0.0, 2.0, 15.0]), rtol=1e-6)


def test_networks_are_relu_layers_without_biases() -> None:
    network = perceptron(5, 7, 6, 2)
    assert [tuple(weights.shape) for weights in network.parameters()] == [(7, 5), (6, 7), (2, 6)]
    inputs = torch.randn(10, 5, generator=torch.Generator().manual_seed(0))
    hidden: torch.Tensor = inputs
    *inner, last = [weights.detach() for weights in network.parameters()]
    for weights in inner:
        hidden = (hidden @ weights.T).clamp(min=0.0)
    torch.testing.assert_close(network(inputs), hidden @ last.T)


def unit_directions(rays: int, seed: int = 0) -> torch.Tensor:
    return torch.nn.functional.normalize(torch.randn(rays, 3, generator=torch.Generator().manual_seed(seed)), dim=1)


def started(field: torch.nn.Module, highest: float = 1.7) -> torch.nn.Module:
    """A field of large planes: after the published start outputs are too small to tell anything apart."""
    random = torch.Generator().manual_seed(4)
    for part in field.modules():
        if isinstance(part, Planes):
            part.start(random, highest, parameters_at_one=False)
        elif isinstance(part, torch.nn.Linear):
            torch.nn.init.xavier_uniform_(part.weight, generator=random)
    return field


def test_colours_depend_on_the_direction_and_densities_do_not() -> None:
    field, points = started(RadianceField(2, TINY)), some_points(2)
    (densities, colors), (others, other_colors) = (field(points, unit_directions(5, seed), False) for seed in (0, 1))
    torch.testing.assert_close(densities, others)
    assert (colors - other_colors).abs().amax(dim=(1, 2)).min() > 1e-2
    assert (densities.shape, colors.shape) == ((5, 7), (5, 7, 3))
    assert 0.0 < colors.min() < colors.max() < 1.0


def shown_by_hand(
    field: RadianceField, points: SamplePoints, directions: torch.Tensor
) -> tuple[torch.Tensor, torch.Tensor]:
    """Densities (N,) and colours (N, 3) point by point from the weights, in the published order of what each network sees."""
    features = torch.cat([level(points) for level in field.levels]).T
    first, second = (weights.T for weights in field.geometry.parameters())
    known = (features @ first).relu() @ second
    hidden = torch.cat([harmonics(directions).repeat_interleave(points.places.shape[2], dim=0), known[:, :15]], dim=1)
    a, b, c = (weights.T for weights in field.color.parameters())
    return torch.exp(known[:, 15] - 1.0), torch.sigmoid(((hidden @ a).relu() @ b).relu() @ c)


def test_networks_see_what_they_should() -> None:
    field, points, directions = started(RadianceField(1, TINY)), some_points(1), unit_directions(5)
    densities, colors = field(points, directions, False)
    expected = shown_by_hand(field, points, directions)
    torch.testing.assert_close(densities.flatten(), expected[0])
    torch.testing.assert_close(colors.flatten(0, 1), expected[1])


def field_outputs(field: torch.nn.Module, points: SamplePoints, bfloat16: bool) -> Sequence[torch.Tensor]:
    if isinstance(field, RadianceField):
        return field(points, unit_directions(points.places.shape[1]), bfloat16)
    return [field(points, bfloat16)]


@pytest.mark.parametrize("field", [RadianceField(1, TINY), ProposalField(1, 8, TINY)], ids=["radiance", "proposal"])
def test_networks_in_bfloat16_are_nearly_those_in_float32(field: torch.nn.Module) -> None:
    started(field)
    points = some_points(1)
    for exact, rounded in zip(field_outputs(field, points, False), field_outputs(field, points, True), strict=True):
        assert rounded.dtype == torch.float32
        torch.testing.assert_close(rounded, exact, rtol=0.1, atol=0.01)
        assert not torch.equal(rounded, exact)


@pytest.mark.parametrize("bfloat16", [False, True])
def test_no_points_are_no_error(bfloat16: bool) -> None:
    for field in (RadianceField(2, TINY), ProposalField(2, 8, TINY)):
        outputs = field_outputs(field, some_points(2, rays=0), bfloat16)
        assert all(len(output) == 0 for output in outputs)
