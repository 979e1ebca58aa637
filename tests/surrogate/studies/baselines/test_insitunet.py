import copy

import numpy as np
import pytest
import torch
from torch import Tensor, nn
from torch.nn.functional import avg_pool2d, conv2d, linear

from catalogs.cameras import Camera
from surrogate.studies.baselines import insitunet
from surrogate.studies.baselines.insitunet import (
    METHOD,
    RESOLUTIONS,
    Architecture,
    Discriminator,
    DiscriminatorBlock,
    Extent,
    Generator,
    GeneratorBlock,
    Subnets,
    Training,
    discriminator_loss,
    encoded_view,
    generator_loss,
    start,
)
from surrogate.studies.baselines.method import Pictures, Plan
from surrogate.studies.comparison.contestants import precision_here
from tests.support.baseline_scenes import ball_pictures, psnr_of_mean, psnr_over


@pytest.fixture
def narrow(monkeypatch: pytest.MonkeyPatch) -> None:
    """The small size with few channels: a step takes milliseconds."""
    monkeypatch.setitem(insitunet.EXTENTS, "small", Extent(2, 4))


def small(steps: int = 1, **others: object) -> Plan:
    return Plan(steps, size="small", **others)  # type: ignore[arg-type]


def begun(pictures: Pictures, plan: Plan) -> Training:
    fit = METHOD.begin(pictures, plan, {})
    assert isinstance(fit, Training)
    return fit


def trained(pictures: Pictures, steps: int, **others: object) -> tuple[Training, list[float]]:
    fit = begun(pictures, small(steps, **others))
    return fit, [fit.advance() for _ in range(steps)]


def picture(fit: Training, pictures: Pictures, number: int = 0) -> np.ndarray:
    return fit.at(pictures.parameters[number])(pictures.camera(number))


def psnr(fit: Training, pictures: Pictures) -> float:
    return float(np.mean([psnr_over(pictures, m, picture(fit, pictures, m)) for m in range(len(pictures))]))


def size(network: nn.Module) -> int:
    return sum(tensor.numel() for tensor in network.parameters())


def random_weights(network: nn.Module, seed: int = 0) -> nn.Module:
    """All weights and biases random, so that none can be left out or mistaken for another unseen."""
    random = torch.Generator().manual_seed(seed)
    with torch.no_grad():
        for tensor in network.parameters():
            tensor.copy_(torch.randn(tensor.shape, generator=random) / max(tensor[0].numel(), 4) ** 0.5)
    return network


def test_the_published_networks_have_the_published_sizes() -> None:
    """Three simulation parameters, three of the visualization, a view: the sizes that the official modules print."""
    with torch.device("meta"):
        architecture = Architecture(256, 6, visualization=3)
        assert size(Generator(architecture)) == 60_974_019
        assert size(Discriminator(architecture)) == 45_769_409


def test_other_resolutions_have_fewer_blocks_or_one_more() -> None:
    c = 64
    with torch.device("meta"):
        sizes = {r: size(Generator(Architecture(r, 6, visualization=3))) for r in RESOLUTIONS}
    assert sizes[512] - sizes[256] == 2 * 9 * c * c + c * c + 2 * 2 * c  # one more from c to c channels
    last = 9 * 2 * c * c + 9 * c * c + 2 * c * c + 2 * 2 * c + 2 * c  # from 2 c to c channels, dropped
    assert (
        sizes[256] - sizes[128] == last - 2 * c - 9 * 3 * c
    )  # after which one norm and the colours have c channels less


@pytest.mark.parametrize("resolution", RESOLUTIONS)
def test_both_networks_fit_pictures_of_every_resolution(resolution: int) -> None:
    with torch.device("meta"):
        architecture = Architecture(resolution, 2)
        drawn = Generator(architecture)(torch.zeros(5, 5))
        discriminator = Discriminator(architecture)
        assert drawn.shape == (5, 3, resolution, resolution)
        assert discriminator.blocks(drawn).shape == (5, 16 * 64, 4, 4)  # as small as where the generator starts
        assert discriminator(torch.zeros(5, 5), drawn).shape == (5,)


@pytest.mark.parametrize("resolution", [4, 8, 24, 100, 1024])
def test_other_resolutions_are_an_error(resolution: int) -> None:
    with pytest.raises(ValueError, match="square pictures of"):
        Architecture(resolution, 1)


def test_there_are_no_more_visualization_parameters_than_parameters() -> None:
    assert Architecture(16, 2, visualization=2).kinds == [2, 3]
    for visualization in (-1, 3):
        with pytest.raises(ValueError, match="0 to 2"):
            Architecture(16, 2, visualization=visualization)


def test_each_kind_of_parameter_has_its_own_subnet() -> None:
    subnets = random_weights(Subnets(Architecture(16, 3, visualization=1, width=32)))
    conditions = torch.zeros(1, 6)
    before = subnets(conditions)
    for place, kind in enumerate([0, 0, 1, 2, 2, 2]):
        moved = conditions.clone()
        moved[0, place] = 1.0
        changed = (subnets(moved) != before)[0].reshape(3, 32).any(dim=1)  # [3]
        assert changed.tolist() == [kind == subnet for subnet in range(3)]


def normalized(maps: Tensor, norm: nn.BatchNorm2d) -> Tensor:
    """With the batch's own mean and variance."""
    mean, variance = maps.mean((0, 2, 3), keepdim=True), maps.var((0, 2, 3), correction=0, keepdim=True)
    shape = (1, -1, 1, 1)
    return (maps - mean) / (variance + 1e-5) ** 0.5 * norm.weight.reshape(shape) + norm.bias.reshape(shape)


def test_a_generator_block_follows_the_published_order() -> None:
    block = random_weights(GeneratorBlock(3, 5)).double()
    assert isinstance(block, GeneratorBlock)
    maps = torch.randn(2, 3, 4, 4, generator=torch.Generator().manual_seed(1), dtype=torch.float64)
    doubled = normalized(maps, block.first_norm).clamp(min=0).repeat_interleave(2, 2).repeat_interleave(2, 3)
    inner = normalized(conv2d(doubled, block.first.weight, padding=1), block.second_norm).clamp(min=0)
    shortcut = conv2d(maps.repeat_interleave(2, 2).repeat_interleave(2, 3), block.shortcut.weight)
    torch.testing.assert_close(block(maps), conv2d(inner, block.second.weight, padding=1) + shortcut)


@pytest.mark.parametrize(
    ("before", "after", "halved", "pixels"),
    [(3, 5, True, True), (3, 5, True, False), (3, 3, True, False), (4, 4, False, False)],
)
def test_a_discriminator_block_follows_the_published_order(before: int, after: int, halved: bool, pixels: bool) -> None:
    block = random_weights(DiscriminatorBlock(before, after, halved=halved, pixels=pixels)).double()
    maps = torch.randn(2, before, 4, 4, generator=torch.Generator().manual_seed(1), dtype=torch.float64)
    weights = dict(block.named_parameters())
    inner = conv2d(maps if pixels else maps.clamp(min=0), weights["first.weight"], weights["first.bias"], padding=1)
    expected = conv2d(inner.clamp(min=0), weights["second.weight"], weights["second.bias"], padding=1)
    shortcut = conv2d(maps, weights["shortcut.weight"], weights["shortcut.bias"]) if halved else maps
    torch.testing.assert_close(block(maps), avg_pool2d(expected + shortcut, 2) if halved else expected + shortcut)


def test_a_score_is_a_linear_map_and_a_projection() -> None:
    discriminator = random_weights(Discriminator(Architecture(16, 1, channels=2, width=8)))
    assert isinstance(discriminator, Discriminator)
    random = torch.Generator().manual_seed(2)
    conditions, shown = torch.rand(3, 4, generator=random), torch.rand(3, 3, 16, 16, generator=random)
    features = discriminator.blocks(shown).clamp(min=0).sum((2, 3))  # [3, C]
    told = discriminator.projection(discriminator.subnets(conditions)).clamp(min=0)  # [3, C]
    expected = linear(features, discriminator.score.weight, discriminator.score.bias)[:, 0] + (told * features).sum(1)
    torch.testing.assert_close(discriminator(conditions, shown), expected)


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


def test_networks_start_orthogonal_without_biases() -> None:
    discriminator = random_weights(Discriminator(Architecture(16, 1, channels=2, width=8)))
    generator = random_weights(Generator(Architecture(16, 1, channels=2, width=8)))
    before = torch.random.get_rng_state()
    for network in (generator, discriminator):
        start(network, torch.Generator().manual_seed(0))
        for part in network.modules():
            if isinstance(part, nn.Linear | nn.Conv2d):
                weights = part.weight.detach().flatten(1)  # [rows, columns]
                gram = weights @ weights.T if len(weights) <= weights.shape[1] else weights.T @ weights
                torch.testing.assert_close(gram, torch.eye(len(gram)), atol=1e-5, rtol=0.0)
                assert part.bias is None or not part.bias.any()
            elif isinstance(part, nn.BatchNorm2d):
                assert (part.weight == 1).all()
                assert not part.bias.any()
    assert torch.equal(torch.random.get_rng_state(), before)


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
            assert off < 0.02 * size(expected)  # gradients that are only rounding have any sign


@pytest.mark.usefixtures("narrow")
def test_it_overfits_one_member() -> None:
    pictures = ball_pictures([[0.3]], views=3)
    fit, losses = trained(pictures, 100)
    assert psnr(fit, pictures) > psnr_of_mean(pictures) + 4.0
    assert np.mean(losses[-10:]) < 0.3 * np.mean(losses[:10])


@pytest.mark.slow
def test_members_are_learnt_and_those_between(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(insitunet.EXTENTS, "small", Extent(8, 4))  # half of the channels and pictures
    pictures = ball_pictures([[-1.0], [-0.4], [0.4], [1.0]], views=2)
    fit, _ = trained(pictures, 90, precision=precision_here("bfloat16", "cpu"))
    between = ball_pictures([[-0.7], [0.0], [0.7]], views=2)
    assert psnr(fit, pictures) > psnr_of_mean(pictures) + 6.0
    assert psnr(fit, between) > psnr_of_mean(between) + 4.0


@pytest.mark.usefixtures("narrow")
def test_a_single_opaque_picture_is_learnt_with_its_background() -> None:
    background = (0.1, 0.2, 0.6)
    pictures = ball_pictures([[0.0]], views=1, background=background)
    fit, _ = trained(pictures, 65)
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
    over = Pictures.over

    def noted(pictures: Pictures, chosen: list[int]) -> Tensor:
        seen.extend(chosen)
        return over(pictures, chosen)

    monkeypatch.setattr(Pictures, "over", noted)
    for seed in (0, 1):
        trained(ball_pictures([[-1.0], [1.0]], views=3), 3, seed=seed)  # batches of 4
    assert sorted(seen[:6]) == sorted(seen[6:12]) == sorted(seen[12:18]) == list(range(6))
    assert seen[:12] != seen[12:]


@pytest.mark.usefixtures("narrow")
def test_a_model_file_holds_all_that_pictures_need() -> None:
    pictures = ball_pictures([[-1.0], [1.0]], views=2)
    fit, _ = trained(pictures, 3)
    tensors = fit.tensors()
    assert sum(t.numel() for name, t in tensors.items() if "running" not in name) == size(fit.generator)
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
    monkeypatch.setitem(insitunet.EXTENTS, "official", Extent(3, 3))
    pictures = ball_pictures([[0.5]], views=2)
    assert begun(pictures, Plan(1)).architecture == Architecture(16, 1, channels=3)
    assert begun(pictures, small()).architecture == Architecture(16, 1, channels=2)


@pytest.mark.usefixtures("narrow")
def test_pictures_of_other_shapes_are_an_error() -> None:
    pictures = ball_pictures([[0.5]], views=2)
    fit = begun(pictures, small())
    with pytest.raises(ValueError, match="16 x 16 pixels, the camera 32 x 16"):
        fit.at(pictures.parameters[0])(pictures.camera(0).resized(16, 32))
    wide = Pictures(
        np.zeros((1, 16, 32, 4), np.uint8),
        [pictures.camera(0).resized(32, 16)],
        torch.zeros(1).long(),
        torch.zeros(1, 1),
        pictures.box,
    )
    with pytest.raises(ValueError, match="square pictures, got 16 x 32"):
        METHOD.begin(wide, small(), {})
