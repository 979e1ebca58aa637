"""The fields of K-Planes: planes between all pairs of coordinates, multiplied, and the small networks that read the products.

Fridovich-Keil et al. 2023, "K-Planes: Explicit Radiance Fields in Space, Time, and Appearance", section 3, and its official code.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import reduce
from itertools import combinations, pairwise
from typing import Any, NamedTuple

import torch
from torch import Tensor, nn

from research.studies.baselines.lookup import bilinear
from research.studies.baselines.spherical_harmonics import COUNT, harmonics

LOWEST = 0.1  # bounds of the planes' uniform initial values
HIGHEST, HIGHEST_OF_PROPOSALS = 0.5, 0.15
WIDTH, GEOMETRY = 64, 15  # of the networks' hidden layers, and of the features that the colour network sees
STEEPEST = 15.0  # log density beyond which gradients of densities grow no more
VARIATION, ONES = 1e-4, 1e-4  # weights of losses: total variation, distance from 1
SMOOTHNESS, SMOOTHNESS_OF_PROPOSALS = 1e-2, 1e-3  # and second differences along parameters


@dataclass(frozen=True)
class KPlanesArchitecture:
    """Sizes of planes, networks and samples.

    Attributes
    ----------
    channels, resolutions : of the planes; one level for each spatial resolution.
    proposals : spatial resolution of each proposal field.
    samples : samples along a ray, for each proposal and finally for the radiance field.
    rays : rays in a step.
    parameter_resolution : of the planes along a parameter, at all levels.
    proposal_channels, proposal_parameter_resolution : the same for the proposals.
    """

    channels: int = 32
    resolutions: Sequence[int] = (64, 128, 256, 512)
    proposals: Sequence[int] = (64, 128)
    samples: Sequence[int] = (256, 128, 48)
    rays: int = 4096
    parameter_resolution: int = 25
    proposal_channels: int = 8
    proposal_parameter_resolution: int = 50


OFFICIAL = KPlanesArchitecture()
# Not published: trains on one processor core in minutes.
SMALL = KPlanesArchitecture(16, resolutions=(32, 64, 128), proposals=(64,), samples=(64, 32), rays=256)


class SamplePoints(NamedTuple):
    """S points along each of R rays: `places` (3, R, S) in [-1, 1] over the box, and `parameters` (P, R) of the rays."""

    places: Tensor  # [3, R, S]
    parameters: Tensor  # [P, R]


class Planes(nn.Module):
    """All planes of one resolution: 3 of spatial coordinates, 3 P of one with a parameter each, P (P - 1) / 2 of two parameters."""

    def __init__(self, parameters: int, channels: int, resolution: int, parameter_resolution: int) -> None:
        super().__init__()
        across, along = resolution, parameter_resolution
        self.spatial_pairs = list(combinations(range(3), 2))
        self.mixed_pairs = [(axis, 3 + p) for axis in range(3) for p in range(parameters)]
        self.parameter_pairs = list(combinations(range(parameters), 2))
        self.spatial = nn.Parameter(torch.empty(3, channels, across, across))
        self.mixed = nn.Parameter(torch.empty(3 * parameters, channels, along, across))
        self.among = nn.Parameter(torch.empty(len(self.parameter_pairs), channels, along, along))

    def start(self, random: torch.Generator, highest: float, parameters_at_one: bool) -> None:
        """Initialize the planes, those that involve parameters optionally to 1."""
        nn.init.uniform_(self.spatial, LOWEST, highest, generator=random)
        for planes in (self.mixed, self.among):
            if parameters_at_one:
                nn.init.ones_(planes)
            else:
                nn.init.uniform_(planes, LOWEST, highest, generator=random)

    def forward(self, points: SamplePoints) -> Tensor:
        """The product of all planes at R S points, (C, R S): bilinear, with the first and the last value at -1 and 1."""
        places, parameters = points
        everywhere = parameters[:, :, None].expand(-1, -1, places.shape[2])  # [P, R, S]
        coordinates = torch.cat([places, everywhere]).flatten(1)  # [3 + P, R S]
        product = _product(self.spatial, coordinates, self.spatial_pairs)  # [C, R S]
        if self.mixed_pairs:
            product = product * _product(self.mixed, coordinates, self.mixed_pairs)
        if self.parameter_pairs:  # the same for all points of a ray
            of_rays = _product(self.among, parameters, self.parameter_pairs)[:, :, None]  # [C, R, 1]
            product = (product.view(len(product), *places.shape[1:]) * of_rays).flatten(1)
        return product

    def regularization(self, smoothness: float) -> Tensor:
        """Total variation, with spatial planes counted twice, L1 distance from 1, and second differences along parameters."""
        parametric = [planes for planes in (self.mixed, self.among) if len(planes)]
        variation = sum((_variation(planes) for planes in parametric), 2.0 * _variation(self.spatial))
        ones = [len(planes) * (1.0 - planes).abs().mean() for planes in parametric]
        bends = [_bending(self.mixed, 2), _bending(self.among, 2), _bending(self.among, 3)]
        return VARIATION * variation + ONES * sum(ones) + smoothness * sum(bends)


def _product(planes: Tensor, coordinates: Tensor, pairs: Sequence[tuple[int, int]]) -> Tensor:
    """The product (C, N) of planes (B, C, height, width) at coordinates (D, N), of which each plane sees its pair: across, down."""
    at = torch.stack([coordinates[list(side)] for side in zip(*pairs, strict=True)], dim=-1)  # [B, N, 2]
    return reduce(torch.mul, bilinear(planes, at).unbind())


def _variation(planes: Tensor) -> Tensor:
    """Twice the mean squared difference of neighbours, down and across, summed over planes (B, C, height, width)."""
    down, across = (_mean_square(planes.diff(dim=dim)) for dim in (2, 3))
    return 2.0 * len(planes) * (down + across)


def _bending(planes: Tensor, dim: int) -> Tensor:
    """The mean squared second difference along a dimension, summed over planes (B, C, height, width)."""
    return len(planes) * _mean_square(planes.diff(n=2, dim=dim))


def _mean_square(differences: Tensor) -> Tensor:
    return differences.square().sum() / max(differences.numel(), 1)


def perceptron(*widths: int) -> nn.Sequential:
    """Linear layers without biases, ReLU between them."""
    linear = [nn.Linear(before, after, bias=False) for before, after in pairwise(widths)]
    return nn.Sequential(linear[0], *(part for layer in linear[1:] for part in (nn.ReLU(), layer)))


class _Density(torch.autograd.Function):
    """exp with a gradient limited to that at `STEEPEST`."""

    @staticmethod
    def forward(ctx: Any, logarithms: Tensor) -> Tensor:
        ctx.save_for_backward(logarithms)
        return logarithms.exp()

    @staticmethod
    def backward(ctx: Any, gradients: Tensor) -> Tensor:
        (logarithms,) = ctx.saved_tensors
        return gradients * logarithms.clamp(-STEEPEST, STEEPEST).exp()


def density_of(outputs: Tensor) -> Tensor:
    """Densities exp(x - 1), float32, of a network's outputs."""
    density: Tensor = _Density.apply(outputs.float() - 1.0)
    return density


class ProposalField(nn.Module):
    """A density field of one resolution. Its network has a ReLU, as in the official hybrid model but not in the explicit one."""

    def __init__(self, parameters: int, resolution: int, architecture: KPlanesArchitecture) -> None:
        super().__init__()
        channels = architecture.proposal_channels
        self.planes = Planes(parameters, channels, resolution, architecture.proposal_parameter_resolution)
        self.network = perceptron(channels, WIDTH, 1)

    def forward(self, points: SamplePoints, bfloat16: bool) -> Tensor:
        """Densities (R, S)."""
        features = self.planes(points).T  # [R S, C]
        with _cast(features, bfloat16):
            outputs = self.network(features)  # [R S, 1]
        return density_of(outputs).view(points.places.shape[1:])


class RadianceField(nn.Module):
    """Densities and colours from planes of several resolutions."""

    def __init__(self, parameters: int, architecture: KPlanesArchitecture) -> None:
        super().__init__()
        channels, along = architecture.channels, architecture.parameter_resolution
        self.levels = nn.ModuleList(Planes(parameters, channels, r, along) for r in architecture.resolutions)
        self.geometry = perceptron(channels * len(self.levels), WIDTH, GEOMETRY + 1)
        self.color = perceptron(COUNT + GEOMETRY, WIDTH, WIDTH, 3)

    def forward(self, points: SamplePoints, directions: Tensor, bfloat16: bool) -> tuple[Tensor, Tensor]:
        """Densities (R, S) and colours (R, S, 3) seen along unit `directions` (R, 3)."""
        count, samples = points.places.shape[1:]
        features = torch.cat([level(points) for level in self.levels]).T  # [R S, C L]
        encoded = harmonics(directions).repeat_interleave(samples, dim=0)  # [R S, 16]
        with _cast(features, bfloat16):
            geometry = self.geometry(features)  # [R S, 16]
            colors = self.color(torch.cat([encoded.to(geometry), geometry[:, :-1]], dim=1))  # [R S, 3]
        return density_of(geometry[:, -1]).view(count, samples), colors.float().sigmoid().view(count, samples, 3)


def _cast(tensor: Tensor, bfloat16: bool) -> torch.autocast:
    return torch.autocast(tensor.device.type, dtype=torch.bfloat16, enabled=bfloat16)
