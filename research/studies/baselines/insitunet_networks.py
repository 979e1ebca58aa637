"""The networks of InSituNet (He et al. 2019, as in the official code): a generator of pictures, and a discriminator of them.

    subnets: Linear-ReLU-Linear-ReLU, one each for simulation parameters, visualization parameters and the view, concatenated
    generator: linear map of the subnets' features to 4x4 pixels, then residual blocks that double the resolution each

As by default there, without spectral normalization.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import torch
from torch import Tensor, nn
from torch.nn.functional import avg_pool2d, interpolate, relu

VIEW = 3  # numbers that a viewpoint is encoded by
FIRST_RESOLUTION = 4  # of the generator's first maps
MAPS = (16, 16, 8, 8, 4, 2, 1, 1)  # channels at 4, 8, 16, ... 512 pixels, in units of `InSituNetArchitecture.channels`
RESOLUTIONS = tuple(FIRST_RESOLUTION << doublings for doublings in range(2, len(MAPS)))


@dataclass(frozen=True)
class InSituNetArchitecture:
    """Sizes of both networks.

    Attributes
    ----------
    resolution : side of an image in pixels, one of `RESOLUTIONS`.
    parameters : number of the ensemble's parameters.
    visualization : number of the last parameters that belong to the visualization and have a subnet of their own.
    channels : the unit of the channels of all maps.
    width : width of the subnets' layers.

    Published for 256 pixels; fewer drop the generator's last blocks, 512 add one, and the discriminator mirrors them.  With 6
    parameters, 3 of them of the visualization, the published networks have 60,974,019 and 45,769,409 parameters.
    """

    resolution: int
    parameters: int
    visualization: int = 0
    channels: int = 64
    width: int = 512

    def __post_init__(self) -> None:
        if self.resolution not in RESOLUTIONS:
            raise ValueError(f"InSituNet draws square pictures of {RESOLUTIONS} pixels, got {self.resolution}")
        if not 0 <= self.visualization <= self.parameters:
            raise ValueError(f"visualization must be 0 to {self.parameters}, all parameters, got {self.visualization}")

    @property
    def kinds(self) -> list[int]:
        """Input sizes of the subnets: simulation parameters, visualization parameters, view; empty kinds are left out."""
        sizes = [self.parameters - self.visualization, self.visualization, VIEW]
        return [size for size in sizes if size]

    @property
    def maps(self) -> list[int]:
        """Channels at 4 pixels, at 8, and so on up to the resolution."""
        doublings = (self.resolution // FIRST_RESOLUTION).bit_length() - 1
        return [self.channels * units for units in MAPS[: doublings + 1]]


class Subnets(nn.Module):
    """Features of an image's conditions: each kind's from its own two layers, side by side."""

    def __init__(self, architecture: InSituNetArchitecture) -> None:
        super().__init__()
        self.kinds, width = architecture.kinds, architecture.width
        self.columns = len(self.kinds) * width
        self.subnets = nn.ModuleList(
            nn.Sequential(nn.Linear(size, width), nn.ReLU(), nn.Linear(width, width), nn.ReLU()) for size in self.kinds
        )

    def forward(self, conditions: Tensor) -> Tensor:
        """Features (B, `columns`) of conditions (B, P + 3)."""
        parts = conditions.split(self.kinds, dim=1)
        return torch.cat([subnet(part) for subnet, part in zip(self.subnets, parts, strict=True)], dim=1)


class GeneratorBlock(nn.Module):
    """Doubles the resolution: BN-ReLU-up-conv3-BN-ReLU-conv3, plus a 1x1 convolution of the input, all without biases."""

    def __init__(self, before: int, after: int) -> None:
        super().__init__()
        self.shortcut = nn.Conv2d(before, after, 1, bias=False)
        self.first_norm = nn.BatchNorm2d(before)
        self.first = nn.Conv2d(before, after, 3, padding=1, bias=False)
        self.second_norm = nn.BatchNorm2d(after)
        self.second = nn.Conv2d(after, after, 3, padding=1, bias=False)

    def forward(self, maps: Tensor) -> Tensor:
        """(B, before, S, S) to (B, after, 2 S, 2 S)."""
        inner = self.first(_doubled(relu(self.first_norm(maps))))  # [B, after, 2 S, 2 S]
        inner = self.second(relu(self.second_norm(inner)))
        # the shortcut's 1x1 convolution gives the same before the doubling as after it, at a quarter of the cost
        return inner + _doubled(self.shortcut(maps))


class Generator(nn.Module):
    """Draws pictures."""

    def __init__(self, architecture: InSituNetArchitecture) -> None:
        super().__init__()
        maps = architecture.maps
        self.subnets = Subnets(architecture)
        self.start = nn.Linear(self.subnets.columns, maps[0] * FIRST_RESOLUTION**2, bias=False)
        self.blocks = nn.Sequential(*(GeneratorBlock(before, after) for before, after in pairwise(maps)))
        self.norm = nn.BatchNorm2d(maps[-1])
        self.colors = nn.Conv2d(maps[-1], 3, 3, padding=1)

    def forward(self, conditions: Tensor) -> Tensor:
        """Pictures (B, 3, S, S) in [-1, 1] for conditions (B, P + 3)."""
        start = self.start(self.subnets(conditions))
        maps = start.reshape(len(start), -1, FIRST_RESOLUTION, FIRST_RESOLUTION)  # [B, C, 4, 4]
        return torch.tanh(self.colors(relu(self.norm(self.blocks(maps)))).float())


class DiscriminatorBlock(nn.Module):
    """Halves the resolution, or keeps it: ReLU-conv3-ReLU-conv3-pool, plus a pooled 1x1 convolution where anything changes.

    The one that sees `pixels` has no ReLU before its first convolution.
    """

    def __init__(self, before: int, after: int, *, halved: bool = True, pixels: bool = False) -> None:
        super().__init__()
        self.halved, self.pixels = halved, pixels
        self.shortcut = nn.Conv2d(before, after, 1) if halved or before != after else nn.Identity()
        self.first = nn.Conv2d(before, after, 3, padding=1)
        self.second = nn.Conv2d(after, after, 3, padding=1)

    def forward(self, maps: Tensor) -> Tensor:
        """(B, before, S, S) to (B, after, S / 2, S / 2), or S where it is not halved."""
        inner = self.second(relu(self.first(maps if self.pixels else relu(maps))))
        if not self.halved:
            return inner + self.shortcut(maps)
        # the shortcut's 1x1 convolution gives the same after the mean as before it, at a quarter of the cost
        return avg_pool2d(inner, 2) + self.shortcut(avg_pool2d(maps, 2))


class Discriminator(nn.Module):
    """Scores of how real images look for their conditions: a linear map of their features plus a projection on the conditions'.

    Miyato & Koyama 2018, "cGANs with Projection Discriminator".
    """

    def __init__(self, architecture: InSituNetArchitecture) -> None:
        super().__init__()
        maps = architecture.maps[::-1]
        self.subnets = Subnets(architecture)
        self.projection = nn.Linear(self.subnets.columns, maps[-1])
        self.blocks = nn.Sequential(
            DiscriminatorBlock(3, maps[0], pixels=True),
            *(DiscriminatorBlock(before, after) for before, after in pairwise(maps[:-1])),
            DiscriminatorBlock(maps[-2], maps[-1], halved=False),
        )
        self.score = nn.Linear(maps[-1], 1)

    def forward(self, conditions: Tensor, pictures: Tensor) -> Tensor:
        """Scores (B,) of conditions (B, P + 3) and pictures (B, 3, S, S): large where they look real."""
        features = relu(self.blocks(pictures)).float().sum(dim=(2, 3))  # [B, C]
        projected = relu(self.projection(self.subnets(conditions))).float()  # [B, C]
        return (features * (projected + self.score.weight)).sum(dim=1) + self.score.bias


def start(network: nn.Module, random: torch.Generator) -> None:
    """Set weights to random orthogonal matrices, biases to zero, and normalizations to the identity, as the official code does."""
    for part in network.modules():
        if isinstance(part, nn.Linear | nn.Conv2d):
            nn.init.orthogonal_(part.weight, generator=random)
            if part.bias is not None:
                nn.init.zeros_(part.bias)
        elif isinstance(part, nn.BatchNorm2d):
            part.reset_parameters()


def _doubled(maps: Tensor) -> Tensor:
    """(B, C, S, S) to (B, C, 2 S, 2 S), each value four times."""
    return interpolate(maps, scale_factor=2)
