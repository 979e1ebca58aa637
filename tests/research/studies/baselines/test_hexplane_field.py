from dataclasses import replace
from itertools import combinations

import numpy as np
import pytest
import torch
from torch import Tensor
from torch.nn.functional import grid_sample

from research.studies.baselines import canonical
from research.studies.baselines.canonical import HarmonicGaussians
from research.studies.baselines.hexplane_field import (
    GEOMETRY,
    OUTPUTS,
    HexPlaneDeformation,
    PlaneLevel,
    box_of,
    hats,
    penalty,
    roughness,
)
from surrogate.randomness import generator
from tests.research.support.baseline_scenes import ball_pictures

UNIT_BOX = torch.tensor([[-1.0, -1.0, -1.0], [1.0, 1.0, 1.0]])


def created(parameters: int, box: Tensor = UNIT_BOX, seed: int = 0, **options: bool) -> HexPlaneDeformation:
    return HexPlaneDeformation.create(parameters, box, generator(seed, "latents"), **options)


def with_random_planes(parameters: int, box: Tensor = UNIT_BOX) -> HexPlaneDeformation:
    """All planes around 1, so that no product of many vanishes."""
    random = torch.Generator().manual_seed(parameters)
    deformation = created(parameters, box)
    levels = [PlaneLevel(*(0.5 + torch.rand(t.shape, generator=random) for t in level)) for level in deformation.levels]
    return replace(deformation, levels=[PlaneLevel(*(t.requires_grad_() for t in level)) for level in levels])


def plain_planes(level: PlaneLevel, parameters: int) -> dict[tuple[int, int], Tensor]:
    """Each plane by its two axes, (1, C, later, earlier): as the official code stores them."""
    planes = {axes: level.space[i] for i, axes in enumerate(combinations(range(3), 2))}
    planes |= {(axis, 3 + p): level.mixed[axis, :, :, p] for axis in range(3) for p in range(parameters)}
    planes |= {
        (3 + p, 3 + q): level.pairs[i] for i, (p, q) in enumerate(combinations(range(parameters), 2))
    }  # [later, earlier, C] each
    return {axes: plane.permute(2, 0, 1).unsqueeze(0) for axes, plane in planes.items()}


def plain_features(deformation: HexPlaneDeformation, means: Tensor, parameters: Tensor) -> Tensor:
    """Every plane at every Gaussian's place and parameters, as in the official code."""
    low, high = deformation.box
    places = (means - low) * (2.0 / (high - low)) - 1.0
    points = torch.cat([places, parameters.expand(len(means), -1)], dim=1)  # [N, 3 + P]
    found = []
    for level in deformation.levels:
        planes, product = plain_planes(level, len(parameters)), torch.ones(())
        assert sorted(planes) == list(combinations(range(points.shape[1]), 2))
        for axes, plane in planes.items():
            at = points[:, list(axes)][None, None]  # [1, 1, N, 2]
            product = product * grid_sample(plane, at, align_corners=True, padding_mode="border")[0, :, 0].T
        found.append(product)
    return torch.cat(found, dim=1)


@pytest.mark.parametrize("parameters", [0, 1, 3, 6])
def test_the_official_size(parameters: int) -> None:
    resolutions = [[size] * 3 + [25] * parameters for size in (64, 128)]
    planes = sum(32 * a * b for level in resolutions for a, b in combinations(level, 2))
    networks = 64 * 64 + 64 + 3 * (64 * 64 + 64) + (64 + 1) * (3 + 3 + 4)
    deformation = created(parameters)
    assert sum(tensor.numel() for tensor in deformation.planes().values()) == planes
    assert sum(tensor.numel() for tensor in deformation.networks.values()) == networks
    assert (parameters, planes + networks) in {(0, 1983370), (1, 2444170), (3, 3485770), (6, 5348170)}


@pytest.mark.parametrize("parameters", [0, 1, 3, 6])
@pytest.mark.usefixtures("small_planes")
def test_lines_and_constants_are_the_same_numbers_as_planes(parameters: int) -> None:
    random = torch.Generator().manual_seed(1)
    box = torch.tensor([[-0.5, -1.0, 0.1], [0.7, 0.3, 1.0]])
    deformation = with_random_planes(parameters, box)
    means = (2.4 * torch.rand(60, 3, generator=random) - 1.2).requires_grad_()  # some outside the box
    at = torch.tensor([0.3, -1.0, 1.0, 0.999, -0.71, 0.0])[:parameters]
    leaves = [means, *deformation.planes().values()]
    found, expected = deformation.features(means, at), plain_features(deformation, means, at)
    torch.testing.assert_close(found, expected, atol=1e-5, rtol=1e-4)
    weights = torch.rand(found.shape, generator=random)
    gradients = (torch.autograd.grad((f * weights).sum(), leaves) for f in (found, expected))
    for one, other in zip(*gradients, strict=True):
        torch.testing.assert_close(one, other, atol=1e-4, rtol=1e-3)


def test_parameters_use_the_whole_of_their_planes() -> None:
    """The lowest value is the first node, the highest the last; beyond them nothing changes."""
    nodes = hats(torch.tensor([-1.0, 1.0, 0.0, 1.0 / 24.0, -3.0, 2.0]))
    expected = torch.zeros(6, 25)
    expected[[0, 1, 2, 4, 5], [0, 24, 12, 0, 24]] = 1.0
    expected[3, [12, 13]] = 0.5
    torch.testing.assert_close(nodes, expected, atol=1e-5, rtol=0.0)


@pytest.mark.parametrize("parameters", [1, 3])
@pytest.mark.usefixtures("small_planes")
def test_planes_of_ones_know_nothing_of_the_parameters(parameters: int) -> None:
    means, deformation = torch.rand(20, 3), created(parameters)
    one, other = (deformation.features(means, torch.full((parameters,), p)) for p in (-0.8, 0.5))
    torch.testing.assert_close(one, other)
    deformation = with_random_planes(parameters)
    one, other = (deformation.features(means, torch.full((parameters,), p)) for p in (-0.8, 0.5))
    assert (one - other).abs().min(dim=1).values.max() > 0.01


def test_planes_and_networks_start_as_the_official_ones() -> None:
    deformation = created(2)
    for level in deformation.levels:
        assert 0.1 <= level.space.min() < 0.11
        assert 0.49 < level.space.max() <= 0.5
        assert (level.mixed == 1.0).all()
        assert (level.pairs == 1.0).all()
    for level in created(2, naive=True).levels:
        for planes in level:
            assert 0.1 <= planes.min() < 0.11
            assert 0.49 < planes.max() <= 0.5
    for name, tensor in deformation.networks.items():
        rows = len(tensor)
        bound = np.sqrt(6.0 / (rows + 64)) if name.endswith("weights") else 0.125
        assert 0.7 * bound < tensor.abs().max() <= bound, name


@pytest.mark.parametrize(("parameters", "most"), [(1, 0.1), (3, 1e-5), (6, 1e-15)])
@pytest.mark.usefixtures("small_planes")
def test_many_planes_that_start_alike_have_no_gradient(parameters: int, most: float) -> None:
    """Adam divides by the gradient plus 1e-15: with six parameters nothing is left to learn by."""
    means, found = 2.0 * torch.rand(200, 3) - 1.0, {}
    for naive in (False, True):
        deformation = created(parameters, naive=naive)
        for level in deformation.levels:
            level.space.requires_grad_()
        offsets = deformation.offsets(means, torch.full((parameters,), 0.4))
        sum(table.abs().mean() for table in offsets.values()).backward()
        gradients = torch.cat([level.space.grad.flatten() for level in deformation.levels])  # type: ignore[union-attr]
        found[naive] = float(gradients.abs().mean())
    assert found[False] > 1e-6
    assert found[True] < most * found[False]
    assert found[True] < 1e-20 or parameters < 6


@pytest.mark.parametrize("parameters", [0, 1, 3])
@pytest.mark.usefixtures("small_planes")
def test_the_penalty_is_the_mean_of_every_plane_added_up(parameters: int) -> None:
    deformation, expected = with_random_planes(parameters), 0.0
    for level in deformation.levels:
        for (_, later), plane in plain_planes(level, parameters).items():
            values = plane[0].detach().numpy().astype(np.float64)  # [C, later, earlier]
            rough = np.square(np.diff(values, n=2, axis=1)).mean()
            if later < 3:
                expected += 1e-4 * rough
                continue
            expected += 0.01 * rough + 1e-4 * np.abs(1.0 - values).mean()
        for i in range(len(level.pairs)):  # the earlier axis is a parameter too
            expected += (
                0.01 * np.square(np.diff(level.pairs[i].detach().numpy().astype(np.float64), n=2, axis=1)).mean()
            )
    assert float(penalty(deformation.levels).detach()) == pytest.approx(expected, rel=1e-4)


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_the_gradient_of_roughness(axis: int) -> None:
    planes = torch.rand(4, 5, 6, 2, dtype=torch.float64, requires_grad=True)
    torch.testing.assert_close(roughness(planes, axis), planes.diff(n=2, dim=axis).square().mean())
    assert torch.autograd.gradcheck(lambda p: 3.0 * roughness(p, axis), (planes,))


@pytest.mark.usefixtures("small_planes")
def test_offsets_are_added_before_the_activation() -> None:
    gaussians = HarmonicGaussians.of_tensors(canonical.prepare(ball_pictures([[0.0]], views=1), 0, count=120, steps=2))
    for moved in (GEOMETRY, tuple(OUTPUTS)):
        deformation = HexPlaneDeformation.create(1, UNIT_BOX, generator(0, "latents"), moved=moved)
        networks = {name: torch.zeros_like(tensor) for name, tensor in deformation.networks.items()}
        shifts = {name: torch.arange(1.0, OUTPUTS[name] + 1.0) for name in moved}
        networks |= {f"{name}_out.biases": shift for name, shift in shifts.items()}
        found = replace(deformation, networks=networks).deformed(gaussians, torch.zeros(1)).tensors()
        for name, tensor in gaussians.tensors().items():
            shift = shifts.get(name, torch.zeros(OUTPUTS[name])).reshape(tensor.shape[1:])
            torch.testing.assert_close(found[name], tensor + shift, msg=name)


@pytest.mark.usefixtures("small_planes")
def test_relu_stands_before_both_layers_of_a_head() -> None:
    deformation, at = created(1), torch.zeros(1)
    means = torch.rand(9, 3)
    features, networks = deformation.features(means, at).double().numpy(), deformation.networks
    weights = {name: tensor.double().numpy() for name, tensor in networks.items()}
    shared = features @ weights["shared.weights"].T + weights["shared.biases"]
    for name, found in deformation.offsets(means, at).items():
        hidden = np.maximum(shared, 0.0) @ weights[f"{name}_in.weights"].T + weights[f"{name}_in.biases"]
        expected = np.maximum(hidden, 0.0) @ weights[f"{name}_out.weights"].T + weights[f"{name}_out.biases"]
        np.testing.assert_allclose(found.numpy(), expected, atol=1e-5)
        assert not np.allclose(found.numpy(), hidden @ weights[f"{name}_out.weights"].T + weights[f"{name}_out.biases"])


@pytest.mark.usefixtures("small_planes")
def test_bfloat16_is_for_the_networks_alone() -> None:
    deformation, means, at = with_random_planes(1), torch.rand(30, 3), torch.tensor([0.2])
    narrow = replace(deformation, precision="bfloat16")
    assert torch.equal(narrow.features(means, at), deformation.features(means, at))
    for name, offsets in narrow.offsets(means, at).items():
        full = deformation.offsets(means, at)[name]
        assert offsets.dtype == torch.float32
        assert 0.0 < (offsets - full).abs().max() < 0.05 * full.abs().max()


def test_planes_span_the_means_within_the_volume() -> None:
    means = torch.tensor([[-0.5, 0.2, 0.1], [0.5, 0.4, 0.9], [0.0, -7.0, 0.3]])
    torch.testing.assert_close(box_of(means, UNIT_BOX), torch.tensor([[-0.5, -1.0, 0.1], [0.5, 0.4, 0.9]]))
    for flat in (means[:1], means + 9.0):
        torch.testing.assert_close(box_of(flat, UNIT_BOX), UNIT_BOX)
