"""The planes of 4DGS-HD: features of places and parameters, and networks that make offsets of Gaussians from them.

Wu et al. 2024, "4D Gaussian Splatting for Real-Time Dynamic Scene Rendering" (settings of its synthetic scenes). A
plane lies over every two of the axes x, y, z and time, here the parameters of an ensemble. Time is one axis there and
takes [0, 1], half of a grid on [-1, 1]; here each of any number of axes takes all of [-1, 1].
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import reduce
from typing import Any, NamedTuple

import numpy as np
import torch
from numpy.random import Generator
from torch import Tensor
from torch.nn.functional import linear

from research.studies.baselines.canonical import HarmonicGaussians
from research.studies.baselines.method import Precision

CHANNELS = 32  # of every plane
RESOLUTIONS = (64, 128)  # of each level along x, y and z
PARAMETER_RESOLUTION = 25  # along a parameter, at every level
EARLIER, LATER = (0, 0, 1), (1, 2, 2)  # axes of the planes without a parameter
WIDTH = 64  # of the networks
OUTPUTS = {"means": 3, "log_scales": 3, "quats": 4, "opacity_logits": 1, "harmonics": 48}
GEOMETRY = ("means", "log_scales", "quats")
SPACE_WEIGHT, PARAMETER_WEIGHT, ONE_WEIGHT = 1e-4, 1e-2, 1e-4  # of the planes' penalties


class PlaneLevel(NamedTuple):
    """All planes of one resolution R along space and r along each of P parameters, of which Q are pairs; C channels."""

    space: Tensor  # [3, R, R, C], over yx, zx, zy
    mixed: Tensor  # [3, r, R, P, C], over each parameter and x, y or z
    pairs: Tensor  # [Q, r, r, C], over two parameters, the later one first


@dataclass(frozen=True, eq=False)
class HexPlaneDeformation:
    """Offsets of some attributes of the Gaussians, from features that planes have at their means and the parameters.

    Attributes
    ----------
    levels : the planes.
    networks : weights and biases by name.
    box : (2, 3), the extent of the planes; beyond it features are as at its border.
    precision : of the networks.
    """

    levels: Sequence[PlaneLevel]
    networks: Mapping[str, Tensor]
    box: Tensor  # [2, 3]
    precision: Precision = "float32"

    @classmethod
    def create(
        cls, parameters: int, box: Tensor, random: Generator, *, moved: Sequence[str] = GEOMETRY, naive: bool = False
    ) -> HexPlaneDeformation:
        """Initial planes and networks for `parameters` parameters: planes of space from U(0.1, 0.5), those with a
        parameter 1; networks as Xavier's.

        With `naive` all planes start as those of space, as the official code's do unless there is one parameter: features, products
        of all planes, then vanish.  `moved` are names of `OUTPUTS`.
        """
        levels = [initial_level(size, parameters, random, naive=naive) for size in RESOLUTIONS]
        networks = initial_networks(moved, random)
        levels = [PlaneLevel(*(t.to(box.device) for t in level)) for level in levels]
        return cls(levels, {name: t.to(box.device) for name, t in networks.items()}, box)

    def features(self, means: Tensor, parameters: Tensor) -> Tensor:
        """Products of all planes at `means` (N, 3) and `parameters` (P,), of all levels side by side, (N, 2 C)."""
        low, high = self.box
        places = (means - low) / (high - low) * 2.0 - 1.0  # [N, 3]
        return torch.cat([level_features(level, places, parameters) for level in self.levels], dim=1)

    def offsets(self, means: Tensor, parameters: Tensor) -> dict[str, Tensor]:
        """Offsets (N, columns) of each attribute that moves."""
        features = self.features(means, parameters)  # [N, 2 C]
        moved = [name for name in OUTPUTS if f"{name}_in.weights" in self.networks]
        with torch.autocast(means.device.type, dtype=torch.bfloat16, enabled=self.precision == "bfloat16"):
            shared = self._layer("shared", features).relu()  # [N, W]
            moves = {name: self._layer(f"{name}_out", self._layer(f"{name}_in", shared).relu()) for name in moved}
        return {name: offsets.to(torch.float32) for name, offsets in moves.items()}

    def deformed(self, gaussians: HarmonicGaussians, parameters: Tensor) -> HarmonicGaussians:
        """The Gaussians with their offsets at normalized `parameters` (P,)."""
        tensors = gaussians.tensors()
        for name, offsets in self.offsets(gaussians.means, parameters).items():
            tensors[name] = tensors[name] + offsets.reshape(tensors[name].shape)
        return HarmonicGaussians(**tensors)

    def planes(self) -> dict[str, Tensor]:
        """All planes by name; empty kinds are left out."""
        named = {f"planes.{i}.{kind}": t for i, level in enumerate(self.levels) for kind, t in level._asdict().items()}
        return {name: planes for name, planes in named.items() if planes.numel()}

    def _layer(self, name: str, inputs: Tensor) -> Tensor:
        return linear(inputs, self.networks[f"{name}.weights"], self.networks[f"{name}.biases"])


def initial_level(size: int, parameters: int, random: Generator, *, naive: bool = False) -> PlaneLevel:
    """Initial planes of resolution `size`."""
    few, pairs = PARAMETER_RESOLUTION, parameters * (parameters - 1) // 2

    def with_parameter(*shape: int) -> Tensor:
        return _uniform(random, 0.1, 0.5, shape) if naive else torch.ones(shape)

    return PlaneLevel(
        _uniform(random, 0.1, 0.5, (3, size, size, CHANNELS)),
        with_parameter(3, few, size, parameters, CHANNELS),
        with_parameter(pairs, few, few, CHANNELS),
    )


def initial_networks(moved: Sequence[str], random: Generator) -> dict[str, Tensor]:
    """Weights of Glorot & Bengio 2010, equation 16, not zero in the last layers; biases as in `torch.nn.Linear` (official code)."""
    shapes = {"shared": (WIDTH, CHANNELS * len(RESOLUTIONS))}
    for name in moved:
        shapes |= {f"{name}_in": (WIDTH, WIDTH), f"{name}_out": (OUTPUTS[name], WIDTH)}
    networks = {}
    for name, (rows, columns) in shapes.items():
        bound, small = (6.0 / (rows + columns)) ** 0.5, columns**-0.5
        networks[f"{name}.weights"] = _uniform(random, -bound, bound, (rows, columns))
        networks[f"{name}.biases"] = _uniform(random, -small, small, (rows,))
    return networks


def level_features(level: PlaneLevel, places: Tensor, parameters: Tensor) -> Tensor:
    """Products (N, C) of a level's planes, each bilinear, at `places` (N, 3) and `parameters` (P,) in [-1, 1].

    All Gaussians have the same parameters: a plane over one of them is a line there, and one over two a constant.  Beyond the box
    features are as at its border.
    """
    size, count, nodes = level.space.shape[1], len(parameters), hats(parameters)
    at = (places.clamp(-1.0, 1.0) + 1.0) / 2.0 * (size - 1)  # [N, 3]
    first = at.detach().floor().clamp(max=size - 2)  # [N, 3]
    rows, shares = first.int(), at - first  # [N, 3] each; int32, which the gradient sorts faster
    factors = [_on_planes(level.space, rows, shares)]
    if count:
        lines = torch.einsum("pr,arxpc->axpc", nodes, level.mixed)  # [3, R, P, C]
        factors += _on_lines(lines.flatten(2), rows, shares).unflatten(2, (count, -1)).unbind(2)
    one, other, another = reduce(torch.mul, factors)  # [N, C] each
    before, after = torch.triu_indices(count, count, offset=1, device=places.device)  # [Q] each
    constants = torch.einsum("qs,qr,qsrc->qc", nodes[after], nodes[before], level.pairs)  # [Q, C]
    return one * other * another * constants.prod(dim=0)


def hats(parameters: Tensor) -> Tensor:
    """Weights (P, r) of a linear interpolation between r nodes on [-1, 1] at `parameters` (P,); constant beyond the ends."""
    last = PARAMETER_RESOLUTION - 1
    at = (parameters.clamp(-1.0, 1.0) + 1.0) / 2.0 * last  # [P]
    nodes = torch.arange(last + 1, device=at.device, dtype=at.dtype)  # [r]
    return (1.0 - (at[:, None] - nodes).abs()).clamp(min=0.0)


def _on_planes(planes: Tensor, rows: Tensor, shares: Tensor) -> Tensor:
    """Values (3, N, C) of `planes` (3, R, R, C), from nodes (N, 3) along each axis and how far the next ones are near (N, 3)."""
    size = planes.shape[1]
    x, y = shares[:, EARLIER].T, shares[:, LATER].T  # [3, N] each
    corner = rows[:, LATER].T * size + rows[:, EARLIER].T + _starts(planes)  # [3, N]
    corners = torch.stack([corner, corner + 1, corner + size, corner + size + 1], dim=2)  # [3, N, 4]
    weights = torch.stack([(1.0 - x) * (1.0 - y), x * (1.0 - y), (1.0 - x) * y, x * y], dim=2)  # [3, N, 4]
    return _gathered(planes.flatten(0, 2), corners, weights)


def _on_lines(lines: Tensor, rows: Tensor, shares: Tensor) -> Tensor:
    """Values (3, N, K) of `lines` (3, R, K) along each axis."""
    start = rows.T + _starts(lines)  # [3, N]
    weights = torch.stack([1.0 - shares.T, shares.T], dim=2)  # [3, N, 2]
    return _gathered(lines.flatten(0, 1), torch.stack([start, start + 1], dim=2), weights)


def _starts(tables: Tensor) -> Tensor:
    """First row of each of the tables (3, ..., C) among the rows of all, (3, 1)."""
    return torch.arange(3, device=tables.device, dtype=torch.int32).unsqueeze(1) * (
        tables[0].numel() // tables.shape[-1]
    )


def _gathered(table: Tensor, rows: Tensor, weights: Tensor) -> Tensor:
    """Weighted sums (3, N, C) of a few rows (3, N, K) of a table (M, C)."""
    flat = rows.flatten(0, 1), weights.flatten(0, 1)
    sums = torch.nn.functional.embedding_bag(flat[0], table, mode="sum", per_sample_weights=flat[1])  # [3 N, C]
    return sums.unflatten(0, rows.shape[:2])


def penalty(levels: Sequence[PlaneLevel]) -> Tensor:
    """Penalty that keeps planes smooth and those with a parameter near 1, each plane's mean added up (official code).

    Second differences of planes of space are along their rows only, those of others along each parameter.
    """
    total = levels[0].space.new_zeros(())
    for space, mixed, pairs in levels:
        total = total + SPACE_WEIGHT * len(space) * roughness(space, 1)
        for planes, count, axes in ((mixed, 3 * mixed.shape[3], (1,)), (pairs, len(pairs), (1, 2))):
            if count:
                rough = torch.stack([roughness(planes, axis) for axis in axes]).sum()
                total = total + count * (PARAMETER_WEIGHT * rough + ONE_WEIGHT * (planes - 1.0).abs().mean())
    return total


def roughness(planes: Tensor, axis: int) -> Tensor:
    """The mean square of second differences along an axis; differentiable once."""
    return _Roughness.apply(planes, axis)


class _Roughness(torch.autograd.Function):
    """Four times as fast as torch's own gradient of differences, which copies all planes for each."""

    @staticmethod
    def forward(ctx: Any, *inputs: Any) -> Tensor:
        planes, axis = inputs
        count = planes.shape[axis] - 2
        before, here, after = (planes.narrow(axis, start, count) for start in range(3))
        second = torch.add(before, after).sub_(here, alpha=2.0)
        factor, gradient = 2.0 / second.numel(), torch.zeros_like(planes)
        for start, times in enumerate((1.0, -2.0, 1.0)):
            gradient.narrow(axis, start, count).add_(second, alpha=times * factor)
        ctx.gradient = gradient
        return second.square_().mean()

    @staticmethod
    def backward(ctx: Any, *gradients: Tensor) -> tuple[Tensor | None, ...]:
        return ctx.gradient * gradients[0], None


def box_of(means: Tensor, volume: Tensor) -> Tensor:
    """The box (2, 3) of `means` (N, 3) within that of the volume, so that a straggler does not stretch the planes."""
    low = torch.maximum(means.amin(dim=0), volume[0])  # [3]
    high = torch.minimum(means.amax(dim=0), volume[1])  # [3]
    is_wide = (high - low > 1e-3).all()
    return torch.stack([low, high]) if is_wide else volume


def _uniform(random: Generator, low: float, high: float, shape: tuple[int, ...]) -> Tensor:
    return torch.from_numpy(random.uniform(low, high, shape).astype(np.float32))
