from collections.abc import Mapping
from dataclasses import replace
from itertools import combinations

import numpy as np
import pytest
import torch
from torch import Tensor
from torch.nn.functional import grid_sample

from surrogate.randomness import generator
from surrogate.studies.baselines import canonical, hexplane_gaussians
from surrogate.studies.baselines.canonical import HarmonicGaussians
from surrogate.studies.baselines.hexplane_gaussians import (
    GEOMETRY,
    METHOD,
    MOVING_ALL,
    NAIVE,
    OUTPUTS,
    HexPlaneDeformation,
    HexPlaneFit,
    Level,
    box_of,
    penalty,
    roughness,
)
from surrogate.studies.baselines.method import Pictures, Plan
from tests.support.baseline_scenes import ball_pictures, psnr_of_mean, psnr_over

UNIT_BOX = torch.tensor([[-1.0, -1.0, -1.0], [1.0, 1.0, 1.0]])


@pytest.fixture
def small_planes(monkeypatch: pytest.MonkeyPatch) -> None:
    """Planes that train fast, with half as many members' places as nodes along a parameter."""
    monkeypatch.setattr(hexplane_gaussians, "RESOLUTIONS", (12, 24))
    monkeypatch.setattr(hexplane_gaussians, "PARAMETER_RESOLUTION", 7)


def created(parameters: int, box: Tensor = UNIT_BOX, seed: int = 0, **options: bool) -> HexPlaneDeformation:
    return HexPlaneDeformation.create(parameters, box, generator(seed, "latents"), **options)


def with_random_planes(parameters: int, box: Tensor = UNIT_BOX) -> HexPlaneDeformation:
    """All planes around 1, so that no product of many vanishes."""
    random = torch.Generator().manual_seed(parameters)
    deformation = created(parameters, box)
    levels = [Level(*(0.5 + torch.rand(t.shape, generator=random) for t in level)) for level in deformation.levels]
    return replace(deformation, levels=[Level(*(t.requires_grad_() for t in level)) for level in levels])


def plain_planes(level: Level, parameters: int) -> dict[tuple[int, int], Tensor]:
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
    nodes = hexplane_gaussians.hats(torch.tensor([-1.0, 1.0, 0.0, 1.0 / 24.0, -3.0, 2.0]))
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


def canonical_of(pictures: Pictures, steps: int = 150) -> Mapping[str, Tensor]:
    return canonical.prepare(pictures, 0, count=120, steps=steps)


def mean_psnr(pictures: Pictures, fit: HexPlaneFit) -> float:
    shown = [fit.at(pictures.parameters[i])(pictures.camera(i)) for i in range(len(pictures))]
    return float(np.mean([psnr_over(pictures, i, picture) for i, picture in enumerate(shown)]))


def trained(fit: HexPlaneFit, steps: int) -> HexPlaneFit:
    for _ in range(steps):
        fit.advance()
    return fit


@pytest.mark.usefixtures("small_planes")
def test_offsets_are_added_before_the_activation() -> None:
    gaussians = HarmonicGaussians.of_tensors(canonical_of(ball_pictures([[0.0]], views=1), steps=2))
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
@pytest.mark.parametrize("steps", [1, 2, 7])
def test_rates_are_those_of_3d_and_4d_gaussian_splatting(steps: int) -> None:
    pictures = ball_pictures([[0.0], [1.0]], views=3)
    extent = canonical.extent_of(pictures.cameras)
    start = canonical_of(pictures, steps=1)
    fit = HexPlaneFit(pictures, Plan(steps, rate=2.0), start)
    before = {name: tensor.clone() for name, tensor in fit.tensors().items()}
    fit.advance()
    after = fit.tensors()
    expected = {
        "means": 1.6e-4 * extent,
        "log_scales": 5e-3,
        "quats": 1e-3,
        "opacity_logits": 5e-2,
        "harmonics": 2.5e-3,
    }
    expected |= dict.fromkeys([name for name in before if name.startswith("planes")], 1.6e-3 * extent)
    expected |= dict.fromkeys([name for name in before if name.endswith(("weights", "biases"))], 1.6e-4 * extent)
    for name, rate in expected.items():  # Adam's first step is as long as its rate
        assert float((after[name] - before[name]).abs().max()) == pytest.approx(2.0 * rate, rel=0.01), name
    directional = (after["harmonics"] - before["harmonics"])[:, 1:].abs().max()
    assert float(directional) == pytest.approx(2.0 * 1.25e-4, rel=0.01)
    torch.testing.assert_close(after["box"], before["box"])
    trained(fit, steps - 1)
    falls = 0.01 ** ((steps - 1) / steps)
    lasts = sorted(group["lr"] / group["first_rate"] for group in fit._adam.param_groups)
    assert lasts == pytest.approx(sorted([falls] * 3 + [1.0] * 5))


@pytest.mark.usefixtures("small_planes")
def test_several_members_are_learnt() -> None:
    pictures = ball_pictures([[-1.0], [0.0], [1.0]], views=4)
    start = canonical_of(pictures)
    still = HarmonicGaussians.of_tensors(start)
    of_still = np.mean([psnr_over(pictures, i, still.picture(pictures.camera(i), None)) for i in range(len(pictures))])
    found = mean_psnr(pictures, trained(HexPlaneFit(pictures, Plan(200), start), 200))
    assert found > of_still + 5.0
    assert found > psnr_of_mean(pictures) + 10.0


@pytest.mark.usefixtures("small_planes")
def test_one_member_is_learnt() -> None:
    pictures = ball_pictures([[0.4, -0.7, 0.1]], views=4)
    fit = trained(HexPlaneFit(pictures, Plan(100), canonical_of(pictures, steps=30)), 100)
    assert mean_psnr(pictures, fit) > psnr_of_mean(pictures) + 12.0


@pytest.mark.slow
@pytest.mark.usefixtures("small_planes")
def test_with_six_parameters_only_planes_of_ones_learn_to_move() -> None:
    members = np.random.default_rng(0).uniform(-1.0, 1.0, (8, 6))
    pictures = ball_pictures(members, views=2)
    start = canonical_of(pictures)
    usual, naive = (trained(HexPlaneFit(pictures, Plan(200), start, naive=naive), 200) for naive in (False, True))
    assert mean_psnr(pictures, usual) > mean_psnr(pictures, naive) + 6.0
    one, other = (naive.at(pictures.parameters[i])(pictures.camera(0)) for i in (0, -1))
    np.testing.assert_allclose(one, other, atol=1e-4)


@pytest.mark.usefixtures("small_planes")
@pytest.mark.parametrize("background", [None, (0.1, 0.5, 0.2)])
@pytest.mark.parametrize("parameters", [0, 1, 3, 6])
def test_pictures(parameters: int, background: tuple[float, float, float] | None) -> None:
    pictures = ball_pictures([[0.5] * parameters], views=1, background=background)
    fit = HexPlaneFit(pictures, Plan(2, precision="bfloat16"), canonical_of(pictures, steps=3))
    assert all(np.isfinite(fit.advance()) for _ in range(2))
    picture = fit.at(pictures.parameters[0])(pictures.camera(0))
    assert picture.shape == (16, 16, 4)
    assert picture.dtype == np.float32
    assert np.isfinite(picture).all()
    assert (picture[..., :3] <= picture[..., 3:]).all()
    assert (picture >= 0.0).all()
    if background is None:
        assert picture[..., 3].min() < 0.1
        assert picture[..., 3].max() > 0.5
    else:
        assert (picture[..., 3] == 1.0).all()
        np.testing.assert_allclose(picture[0, 0, :3], background, atol=0.1)
    assert all(not tensor.requires_grad for tensor in fit.tensors().values())


@pytest.mark.usefixtures("small_planes")
def test_pictures_follow_the_training_the_parameters_and_the_camera() -> None:
    pictures = ball_pictures([[-1.0], [1.0]], views=2)
    fit = trained(HexPlaneFit(pictures, Plan(40), canonical_of(pictures, steps=30)), 39)
    low, high = pictures.parameters[0], pictures.parameters[2]
    first = fit.at(low)(pictures.camera(0))
    np.testing.assert_array_equal(fit.at(low)(pictures.camera(0)), first)
    assert np.abs(fit.at(low)(pictures.camera(1)) - first).max() > 0.1
    assert np.abs(fit.at(high)(pictures.camera(0)) - first).max() > 0.02
    np.testing.assert_array_equal(fit.at(low)(pictures.camera(0)), first)
    fit.advance()
    later = fit.at(low)(pictures.camera(0))
    assert np.abs(later - first).max() > 1e-4
    fit.at(high)(pictures.camera(0))
    np.testing.assert_array_equal(fit.at(low)(pictures.camera(0)), later)


@pytest.mark.usefixtures("small_planes")
def test_the_seed_decides_everything() -> None:
    pictures = ball_pictures([[-1.0], [1.0]], views=2)
    start = canonical_of(pictures, steps=10)
    one, again, other = (trained(HexPlaneFit(pictures, Plan(5, seed), start), 5).tensors() for seed in (1, 1, 2))
    for name, tensor in one.items():
        torch.testing.assert_close(tensor, again[name], atol=0.0, rtol=0.0)
        assert name == "box" or not torch.equal(tensor, other[name]), name
    assert not start["means"].requires_grad
    torch.testing.assert_close(start["means"], canonical_of(pictures, steps=10)["means"], atol=0.0, rtol=0.0)


@pytest.mark.usefixtures("small_planes")
def test_every_picture_is_drawn_once_an_epoch_in_an_order_of_the_seed(monkeypatch: pytest.MonkeyPatch) -> None:
    pictures, compared, orders = ball_pictures([[-1.0], [1.0]], views=3), canonical.compared, []
    start = canonical_of(pictures, steps=2)
    for seed in (0, 1):
        order: list[int] = []
        orders.append(order)
        monkeypatch.setattr(canonical, "compared", lambda p, i, order=order: order.append(i) or compared(p, i))
        trained(HexPlaneFit(pictures, Plan(6, seed), start), 6)
    assert sorted(orders[0]) == sorted(orders[1]) == list(range(6))
    assert orders[0] != orders[1]


@pytest.mark.usefixtures("small_planes")
def test_the_seed_decides_the_start() -> None:
    pictures = ball_pictures([[-1.0], [1.0]], views=2)
    start = canonical_of(pictures, steps=2)
    one, other = (HexPlaneFit(pictures, Plan(1, seed), start).tensors() for seed in (0, 1))
    equal = {name for name, tensor in one.items() if torch.equal(tensor, other[name])}
    assert equal == {*start, "box", "planes.0.mixed", "planes.1.mixed"}


@pytest.mark.usefixtures("small_planes")
@pytest.mark.parametrize("background", [None, (0.1, 0.5, 0.2)])
def test_the_loss_is_the_mean_difference_and_the_penalty(background: tuple[float, float, float] | None) -> None:
    pictures = ball_pictures([[-1.0, 0.5]], views=1, background=background)
    fit = HexPlaneFit(pictures, Plan(1), canonical_of(pictures, steps=2), naive=True)
    picture, tensors = fit.at(pictures.parameters[0])(pictures.camera(0)), fit.tensors()
    levels = [Level(*(tensors[f"planes.{i}.{kind}"] for kind in Level._fields)) for i in range(2)]
    difference = np.abs(picture[..., :3] + (1.0 - picture[..., 3:]) * pictures.behind - pictures.over([0])[0].numpy())
    if background is None:
        alpha = np.abs(picture[..., 3:] - pictures.pixels[0, ..., 3:] / 255.0)
        difference = np.concatenate([difference, alpha], axis=2)
    of_planes = float(penalty(levels))
    assert of_planes > 1e-3
    assert fit.advance() == pytest.approx(difference.mean() + of_planes, rel=1e-4)


@pytest.mark.usefixtures("small_planes")
def test_the_plan_says_the_precision() -> None:
    pictures = ball_pictures([[0.5]], views=1)
    start = canonical_of(pictures, steps=2)
    full, narrow = (
        HexPlaneFit(pictures, Plan(1, precision=precision), start).at(pictures.parameters[0])(pictures.camera(0))
        for precision in ("float32", "bfloat16")
    )
    assert 0.0 < np.abs(full - narrow).max() < 0.1


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


@pytest.mark.usefixtures("small_planes")
def test_variants_differ_in_what_they_say() -> None:
    pictures = ball_pictures([[-1.0, 0.0], [1.0, 0.0]], views=1)
    start = canonical_of(pictures, steps=2)
    usual, everything, naive = (m.begin(pictures, Plan(1), start).tensors() for m in (METHOD, MOVING_ALL, NAIVE))
    assert set(everything) - set(usual) == {
        f"{name}_{layer}.{part}"
        for name in ("opacity_logits", "harmonics")
        for layer in ("in", "out")
        for part in ("weights", "biases")
    }
    assert set(naive) == set(usual)
    assert (usual["planes.0.mixed"] == 1.0).all()
    assert (naive["planes.0.mixed"] <= 0.5).all()
    assert len({m.name for m in (METHOD, MOVING_ALL, NAIVE)}) == 3
    assert METHOD.prepare is canonical.prepare
