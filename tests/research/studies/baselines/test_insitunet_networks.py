import pytest
import torch
from torch import Tensor, nn
from torch.nn.functional import avg_pool2d, conv2d, linear

from research.studies.baselines.insitunet_networks import (
    RESOLUTIONS,
    Discriminator,
    DiscriminatorBlock,
    Generator,
    GeneratorBlock,
    InSituNetArchitecture,
    Subnets,
    start,
)


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
        architecture = InSituNetArchitecture(256, 6, visualization=3)
        assert size(Generator(architecture)) == 60_974_019
        assert size(Discriminator(architecture)) == 45_769_409


def test_other_resolutions_have_fewer_blocks_or_one_more() -> None:
    c = 64
    with torch.device("meta"):
        sizes = {r: size(Generator(InSituNetArchitecture(r, 6, visualization=3))) for r in RESOLUTIONS}
    assert sizes[512] - sizes[256] == 2 * 9 * c * c + c * c + 2 * 2 * c  # one more from c to c channels
    last = 9 * 2 * c * c + 9 * c * c + 2 * c * c + 2 * 2 * c + 2 * c  # from 2 c to c channels, dropped
    assert (
        sizes[256] - sizes[128] == last - 2 * c - 9 * 3 * c
    )  # after which one norm and the colours have c channels less


@pytest.mark.parametrize("resolution", RESOLUTIONS)
def test_both_networks_fit_pictures_of_every_resolution(resolution: int) -> None:
    with torch.device("meta"):
        architecture = InSituNetArchitecture(resolution, 2)
        drawn = Generator(architecture)(torch.zeros(5, 5))
        discriminator = Discriminator(architecture)
        assert drawn.shape == (5, 3, resolution, resolution)
        assert discriminator.blocks(drawn).shape == (5, 16 * 64, 4, 4)  # as small as where the generator starts
        assert discriminator(torch.zeros(5, 5), drawn).shape == (5,)


@pytest.mark.parametrize("resolution", [4, 8, 24, 100, 1024])
def test_other_resolutions_are_an_error(resolution: int) -> None:
    with pytest.raises(ValueError, match="square pictures of"):
        InSituNetArchitecture(resolution, 1)


def test_there_are_no_more_visualization_parameters_than_parameters() -> None:
    assert InSituNetArchitecture(16, 2, visualization=2).kinds == [2, 3]
    for visualization in (-1, 3):
        with pytest.raises(ValueError, match="0 to 2"):
            InSituNetArchitecture(16, 2, visualization=visualization)


def test_each_kind_of_parameter_has_its_own_subnet() -> None:
    subnets = random_weights(Subnets(InSituNetArchitecture(16, 3, visualization=1, width=32)))
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
    discriminator = random_weights(Discriminator(InSituNetArchitecture(16, 1, channels=2, width=8)))
    assert isinstance(discriminator, Discriminator)
    random = torch.Generator().manual_seed(2)
    conditions, shown = torch.rand(3, 4, generator=random), torch.rand(3, 3, 16, 16, generator=random)
    features = discriminator.blocks(shown).clamp(min=0).sum((2, 3))  # [3, C]
    told = discriminator.projection(discriminator.subnets(conditions)).clamp(min=0)  # [3, C]
    expected = linear(features, discriminator.score.weight, discriminator.score.bias)[:, 0] + (told * features).sum(1)
    torch.testing.assert_close(discriminator(conditions, shown), expected)


def test_networks_start_orthogonal_without_biases() -> None:
    discriminator = random_weights(Discriminator(InSituNetArchitecture(16, 1, channels=2, width=8)))
    generator = random_weights(Generator(InSituNetArchitecture(16, 1, channels=2, width=8)))
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
