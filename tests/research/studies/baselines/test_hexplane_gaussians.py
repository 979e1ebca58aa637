from collections.abc import Mapping

import numpy as np
import pytest
import torch
from torch import Tensor

from research.studies.baselines import canonical
from research.studies.baselines.canonical import HarmonicGaussians
from research.studies.baselines.hexplane_field import PlaneLevel, penalty
from research.studies.baselines.hexplane_gaussians import METHOD, MOVING_ALL, NAIVE, HexPlaneFit
from research.studies.baselines.method import Plan, TrainingImages
from tests.research.support.baseline_scenes import ball_pictures, psnr_of_mean, psnr_over


def canonical_of(pictures: TrainingImages, steps: int = 60) -> Mapping[str, Tensor]:
    return canonical.prepare(pictures, 0, count=60, steps=steps)


def mean_psnr(pictures: TrainingImages, fit: HexPlaneFit) -> float:
    shown = [fit.at(pictures.parameters[i])(pictures.camera(i)) for i in range(len(pictures))]
    return float(np.mean([psnr_over(pictures, i, picture) for i, picture in enumerate(shown)]))


def trained(fit: HexPlaneFit, steps: int) -> HexPlaneFit:
    for _ in range(steps):
        fit.advance()
    return fit


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
    pictures = ball_pictures([[-1.0], [0.0], [1.0]], views=3, size=12)
    start = canonical_of(pictures)
    still = HarmonicGaussians.of_tensors(start)
    of_still = np.mean([psnr_over(pictures, i, still.picture(pictures.camera(i), None)) for i in range(len(pictures))])
    found = mean_psnr(pictures, trained(HexPlaneFit(pictures, Plan(90, rate=2.5), start), 90))
    assert found > of_still + 5.0
    assert found > psnr_of_mean(pictures) + 9.0


@pytest.mark.usefixtures("small_planes")
def test_one_member_is_learnt() -> None:
    pictures = ball_pictures([[0.4, -0.7, 0.1]], views=3, size=12)
    fit = trained(HexPlaneFit(pictures, Plan(40), canonical_of(pictures, steps=30)), 40)
    assert mean_psnr(pictures, fit) > psnr_of_mean(pictures) + 12.0


@pytest.mark.slow
@pytest.mark.usefixtures("small_planes")
def test_with_six_parameters_only_planes_of_ones_learn_to_move() -> None:
    members = np.random.default_rng(0).uniform(-1.0, 1.0, (4, 6))
    pictures, plan = ball_pictures(members, views=2, size=12), Plan(60, rate=2.0)
    start = canonical_of(pictures)
    usual, naive = (trained(HexPlaneFit(pictures, plan, start, naive=naive), plan.steps) for naive in (False, True))
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
    levels = [PlaneLevel(*(tensors[f"planes.{i}.{kind}"] for kind in PlaneLevel._fields)) for i in range(2)]
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
