import copy
from functools import partial

import numpy as np
import pytest
import torch
from torch import Tensor, nn

from catalogs.vocabulary.cameras import Camera
from research.studies.baselines import insitunet
from research.studies.baselines.insitunet import (
    METHOD,
    InSituNetTraining,
    NetworkSize,
    discriminator_loss,
    encoded_view,
    generator_loss,
)
from research.studies.baselines.insitunet_networks import InSituNetArchitecture
from research.studies.baselines.method import Plan, TrainingImages
from research.studies.comparison.contestants import precision_here
from tests.research.support.baseline_scenes import ball_pictures, psnr_of_mean, psnr_over


@pytest.fixture
def narrow(monkeypatch: pytest.MonkeyPatch) -> None:
    """The small size with few channels, and narrow subnets: a step takes milliseconds."""
    monkeypatch.setitem(insitunet.EXTENTS, "small", NetworkSize(2, 4))
    monkeypatch.setattr(insitunet, "InSituNetArchitecture", partial(InSituNetArchitecture, width=32))


def small(steps: int = 1, **others: object) -> Plan:
    return Plan(steps, size="small", **others)  # type: ignore[arg-type]


def begun(pictures: TrainingImages, plan: Plan) -> InSituNetTraining:
    fit = METHOD.begin(pictures, plan, {})
    assert isinstance(fit, InSituNetTraining)
    return fit


def trained(pictures: TrainingImages, steps: int, **others: object) -> tuple[InSituNetTraining, list[float]]:
    fit = begun(pictures, small(steps, **others))
    return fit, [fit.advance() for _ in range(steps)]


def picture(fit: InSituNetTraining, pictures: TrainingImages, number: int = 0) -> np.ndarray:
    return fit.at(pictures.parameters[number])(pictures.camera(number))


def psnr(fit: InSituNetTraining, pictures: TrainingImages) -> float:
    return float(np.mean([psnr_over(pictures, m, picture(fit, pictures, m)) for m in range(len(pictures))]))


def test_losses_follow_their_formulas() -> None:
    real, fake = np.array([-3.0, 0.0, 40.0]), np.array([2.0, -50.0, 90.0])
    truths, drawn = np.full((3, 3, 2, 2), 0.5), np.full((3, 3, 2, 2), -0.25)
    expected = np.mean(np.log1p(np.exp(-real))) + np.mean(np.log1p(np.exp(fake)))
    assert float(discriminator_loss(torch.tensor(real), torch.tensor(fake))) == pytest.approx(expected)
    expected = 0.75**2 + 0.01 * np.mean(np.log1p(np.exp(-fake)))
    found = generator_loss(torch.tensor(drawn), torch.tensor(truths), torch.tensor(fake))
    assert float(found) == pytest.approx(expected)


@pytest.mark.parametrize(
    ("direction", "view"),
    [
        ((1, 0, 0), (1, 0, 0)),
        ((0, 1, 0), (0, 1, 0)),
        ((-1, 0, 0), (-1, 0, 0)),
        ((0, 0, 1), (1, 0, 1)),
        ((0, 0, -1), (1, 0, -1)),
        ((1, -1, 2**0.5), (0.5**0.5, -(0.5**0.5), 0.5)),
        ((0, 3**0.5, -1), (0, 1, -1 / 3)),
    ],
)
def test_a_view_is_where_the_camera_stands_around_the_boxs_middle(
    direction: tuple[float, ...], view: tuple[float, ...]
) -> None:
    box = torch.tensor([[-0.5, -1.0, -0.2], [0.7, 1.0, 0.8]])
    middle = np.array([0.1, 0.0, 0.3])
    camera = Camera.look_at(middle + 3.0 * np.array(direction), middle, vertical_fov_degrees=30, width=16, height=16)
    np.testing.assert_allclose(encoded_view(camera, box), view, atol=1e-6)


class WithoutMomentum:
    """Adam of Kingma & Ba 2015, algorithm 1, with beta_1 = 0 and beta_2 = 0.999."""

    def __init__(self, network: nn.Module, rate: float) -> None:
        self.tensors, self.rate, self.steps = list(network.parameters()), rate, 0
        self.squares = [torch.zeros_like(tensor) for tensor in self.tensors]

    def step(self, loss: Tensor) -> None:
        self.steps += 1
        with torch.no_grad():
            gradients = torch.autograd.grad(loss, self.tensors)
            for tensor, square, gradient in zip(self.tensors, self.squares, gradients, strict=True):
                square.mul_(0.999).add_(0.001 * gradient**2)
                tensor.sub_(self.rate * gradient / ((square / (1.0 - 0.999**self.steps)).sqrt() + 1e-8))


@pytest.mark.usefixtures("narrow")
def test_steps_teach_the_discriminator_first_and_then_the_generator() -> None:
    pictures = ball_pictures([[0.5]], views=3)
    fit = begun(pictures, small(rate=0.5))
    generator, discriminator = copy.deepcopy(fit.generator), copy.deepcopy(fit.discriminator)
    views = torch.stack([encoded_view(camera, pictures.box) for camera in pictures.cameras])  # [3, 3]
    conditions = torch.cat([torch.full((3, 1), 0.5), views], dim=1)  # [3, 4]
    truths = (2.0 * pictures.over(range(3)) - 1.0).permute(0, 3, 1, 2)  # [3, 3, 16, 16]
    generator_steps, discriminator_steps = (WithoutMomentum(n, 0.5e-3) for n in (generator, discriminator))
    for _ in range(2):
        drawn = generator(conditions)
        scores = discriminator(conditions, truths), discriminator(conditions, drawn.detach())
        discriminator_steps.step(discriminator_loss(*scores))
        loss = generator_loss(drawn, truths, discriminator(conditions, drawn))
        generator_steps.step(loss)
        assert fit.advance() == pytest.approx(float(loss.detach()), rel=1e-4)
        for found, expected in ((fit.generator, generator), (fit.discriminator, discriminator)):
            pairs = list(zip(found.parameters(), expected.parameters(), strict=True))
            off = sum(int(((a - b).abs() > 5e-5).sum()) for a, b in pairs)  # a tenth of a step
            assert off < 0.02 * sum(
                tensor.numel() for tensor in expected.parameters()
            )  # gradients that are only rounding have any sign


@pytest.mark.usefixtures("narrow")
def test_it_overfits_one_member() -> None:
    pictures = ball_pictures([[0.3]], views=3)
    fit, losses = trained(pictures, 110)
    assert psnr(fit, pictures) > psnr_of_mean(pictures) + 4.0
    assert np.mean(losses[-10:]) < 0.3 * np.mean(losses[:10])


@pytest.mark.slow
@pytest.mark.usefixtures("narrow")
def test_members_are_learnt_and_those_between(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(insitunet.EXTENTS, "small", NetworkSize(3, 4))
    monkeypatch.setattr(insitunet, "InSituNetArchitecture", partial(InSituNetArchitecture, width=64))
    pictures = ball_pictures([[-1.0], [-0.4], [0.4], [1.0]], views=2)
    fit, _ = trained(pictures, 90, precision=precision_here("bfloat16", "cpu"))
    between = ball_pictures([[-0.7], [0.0], [0.7]], views=2)
    assert psnr(fit, pictures) > psnr_of_mean(pictures) + 6.0
    assert psnr(fit, between) > psnr_of_mean(between) + 4.0


@pytest.mark.usefixtures("narrow")
def test_a_single_opaque_picture_is_learnt_with_its_background() -> None:
    background = (0.1, 0.2, 0.6)
    pictures = ball_pictures([[0.0]], views=1, background=background)
    fit, _ = trained(pictures, 85)
    found = picture(fit, pictures)
    np.testing.assert_allclose(found[[0, 0, -1, -1], [0, -1, 0, -1], :3].mean(axis=0), background, atol=0.15)
    assert psnr(fit, pictures) > 20.0


@pytest.mark.usefixtures("narrow")
@pytest.mark.parametrize("parameters", [0, 1, 3, 6])
def test_pictures_are_opaque_for_any_number_of_parameters(parameters: int) -> None:
    pictures = ball_pictures(np.linspace(-1.0, 1.0, 2 * parameters).reshape(2, parameters), views=3)
    fit, losses = trained(pictures, 2)
    found = picture(fit, pictures, 5)
    assert np.isfinite(losses).all()
    assert found.shape == (16, 16, 4)
    assert found.dtype == np.float32
    assert (found[..., 3] == 1.0).all()
    assert (found >= 0.0).all()
    assert (found <= 1.0).all()
    assert np.ptp(found[..., :3]) > 0.0
    assert (found != picture(fit, pictures, 4)).any()  # another view
    if parameters:
        assert (found != picture(fit, pictures, 2)).any()  # another member


@pytest.mark.usefixtures("narrow")
def test_a_seed_decides_everything() -> None:
    pictures = ball_pictures([[-1.0], [1.0]], views=3)
    first, again, other = (trained(pictures, 3, seed=seed) for seed in (1, 1, 2))
    assert first[1] == again[1]
    assert (picture(first[0], pictures) == picture(again[0], pictures)).all()
    assert first[1] != other[1]


@pytest.mark.usefixtures("narrow")
def test_a_seed_decides_the_start() -> None:
    pictures = ball_pictures([[0.0]], views=1)
    first, other = (begun(pictures, small(seed=seed)) for seed in (1, 2))
    for name in ("generator", "discriminator"):
        for a, b in zip(getattr(first, name).parameters(), getattr(other, name).parameters(), strict=True):
            assert a.dim() == 1 or not torch.equal(a, b)


@pytest.mark.usefixtures("narrow")
def test_rates_are_constant_however_many_steps_are_planned() -> None:
    pictures = ball_pictures([[-1.0], [1.0]], views=2)
    whole = trained(pictures, 7)[1]
    assert trained(pictures, 1)[1] == whole[:1]
    assert trained(pictures, 2)[1] == whole[:2]
    assert trained(pictures, 2, rate=2.0)[1] != whole[:2]


@pytest.mark.usefixtures("narrow")
def test_every_picture_is_seen_once_an_epoch(monkeypatch: pytest.MonkeyPatch) -> None:
    seen: list[int] = []
    over = TrainingImages.over

    def noted(pictures: TrainingImages, chosen: list[int]) -> Tensor:
        seen.extend(chosen)
        return over(pictures, chosen)

    monkeypatch.setattr(TrainingImages, "over", noted)
    for seed in (0, 1):
        trained(ball_pictures([[-1.0], [1.0]], views=3), 3, seed=seed)  # batches of 4
    assert sorted(seen[:6]) == sorted(seen[6:12]) == sorted(seen[12:18]) == list(range(6))
    assert seen[:12] != seen[12:]


@pytest.mark.usefixtures("narrow")
def test_a_model_file_holds_all_that_pictures_need() -> None:
    pictures = ball_pictures([[-1.0], [1.0]], views=2)
    fit, _ = trained(pictures, 3)
    tensors = fit.tensors()
    weights = {name: tensor.shape for name, tensor in fit.generator.named_parameters()}
    assert {name: tensor.shape for name, tensor in tensors.items() if "running" not in name} == weights
    other = begun(pictures, small(seed=5))
    other.generator.load_state_dict(dict(tensors), strict=False)
    expected = picture(fit, pictures)
    np.testing.assert_allclose(picture(other, pictures), expected, atol=1e-6)
    assert all(torch.equal(tensor, tensors[name]) for name, tensor in fit.tensors().items())  # drawing changes nothing
    fit.advance()  # which leaves what was taken as it was
    other.generator.load_state_dict(dict(tensors), strict=False)
    np.testing.assert_allclose(picture(other, pictures), expected, atol=1e-6)
    assert all(tensor.is_contiguous() for tensor in tensors.values())


@pytest.mark.usefixtures("narrow")
def test_bfloat16_changes_little_and_no_weight() -> None:
    pictures = ball_pictures([[0.5]], views=2)
    exact, rounded = (begun(pictures, small(precision=p)) for p in ("float32", "bfloat16"))
    difference = picture(exact, pictures) - picture(rounded, pictures)
    assert 0.0 < np.abs(difference).max() < 0.03
    assert exact.advance() == pytest.approx(rounded.advance(), rel=0.02)
    assert {tensor.dtype for tensor in rounded.generator.state_dict().values()} == {torch.float32, torch.int64}


@pytest.mark.usefixtures("narrow")
def test_sizes_have_their_own_channels(monkeypatch: pytest.MonkeyPatch) -> None:
    assert insitunet.EXTENTS["official"] == (64, 50)
    monkeypatch.setitem(insitunet.EXTENTS, "official", NetworkSize(3, 3))
    pictures = ball_pictures([[0.5]], views=2)
    assert begun(pictures, Plan(1)).architecture == InSituNetArchitecture(16, 1, channels=3, width=32)
    assert begun(pictures, small()).architecture == InSituNetArchitecture(16, 1, channels=2, width=32)


@pytest.mark.usefixtures("narrow")
def test_pictures_of_other_shapes_are_an_error() -> None:
    pictures = ball_pictures([[0.5]], views=2)
    fit = begun(pictures, small())
    with pytest.raises(ValueError, match="16 x 16 pixels, the camera 32 x 16"):
        fit.at(pictures.parameters[0])(pictures.camera(0).resized(16, 32))
    wide = TrainingImages(
        np.zeros((1, 16, 32, 4), np.uint8),
        [pictures.camera(0).resized(32, 16)],
        torch.zeros(1).long(),
        torch.zeros(1, 1),
        pictures.box,
    )
    with pytest.raises(ValueError, match="square pictures, got 16 x 32"):
        METHOD.begin(wide, small(), {})
