"""The radiance field of ViSNeRF: a decomposed grid and a vector for each parameter, read by two small networks.

Yao et al. 2025, "ViSNeRF: Efficient Multidimensional Neural Radiance Field Representation for Visualization Synthesis of Dynamic
Volumetric Scenes", IEEE PacificVis, with the sizes of the released code and its settings for Nyx (github.com/JCBreath/ViSNeRF).

    c(x) = sum over {xy|z, xz|y, yz|x} of plane * line,    one of 16 components for the density, another of 48 for the colour
    f(x, p) = basis [c(x), v_1(p_1), ..., v_P(p_P)],       27 features; v_j interpolates a vector of 4 channels
    density = softplus(network [x, f, E(x), E(f)] - 10),   colour = sigmoid(network [f, d, E(f), E(d)])

E(u) = [sin u, sin 2u, cos u, cos 2u] component by component.  The planes and lines are the VM decomposition of Chen et al. 2022,
"TensoRF: Tensorial Radiance Fields", with its three products added instead of concatenated.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
import torch
from torch import Tensor
from torch.nn.functional import linear, relu, softplus

from research.studies.baselines.lookup import bilinear

Quantity = Literal["density", "color"]
QUANTITIES: tuple[Quantity, Quantity] = ("density", "color")
COMPONENTS: Mapping[Quantity, int] = {"density": 16, "color": 48}
OUTPUTS: Mapping[Quantity, int] = {"density": 1, "color": 3}
AXES = ((0, 1, 2), (0, 2, 1), (1, 2, 0))  # along a plane's columns, along its rows, along its line
LETTERS = "xyz"
CHANNELS = 4  # of a parameter's vector
FEATURES = 27
WIDTH = 128  # of both hidden layers of both networks
FREQUENCIES = (1.0, 2.0)
# A parameter's vector has as many entries as the parameter has values in the training images, between these bounds:
SHORTEST, LONGEST = 3, 16
GRID_DEVIATION = 0.1  # of the planes' and lines' first values
FIRST_VECTOR = 0.1  # all of a vector's first values
DENSITY_SHIFT = -10.0  # so that the volume is almost empty at first


def grid_of(box: Tensor, voxels: int) -> tuple[int, int, int]:
    """The numbers of cubic voxels along the three sides of a box (2, 3) that has about `voxels`; at least two each."""
    sides = (box[1] - box[0]).double().cpu()  # [3]
    voxel = float((sides.prod() / voxels) ** (1.0 / 3.0))
    x, y, z = (max(2, int(side / voxel)) for side in sides.tolist())
    return x, y, z


def vector_lengths(parameters: Tensor) -> tuple[int, ...]:
    """Length of each parameter's vector, from all training images' parameters (M, P)."""
    distinct = [len(torch.unique(values)) for values in parameters.unbind(1)]
    return tuple(min(LONGEST, max(SHORTEST, count)) for count in distinct)


def plane_name(quantity: Quantity, axes: Sequence[int]) -> str:
    return f"{quantity}.plane_{LETTERS[axes[0]]}{LETTERS[axes[1]]}"


def line_name(quantity: Quantity, axes: Sequence[int]) -> str:
    return f"{quantity}.line_{LETTERS[axes[2]]}"


def vector_name(quantity: Quantity, parameter: int) -> str:
    return f"{quantity}.vector_{parameter}"


@dataclass(frozen=True)
class ViSNeRFArchitecture:
    """Sizes of the field.

    Attributes
    ----------
    grid : numbers of entries along x, y and z.
    vectors : the length of each parameter's vector.
    """

    grid: tuple[int, int, int]
    vectors: tuple[int, ...]

    def grids(self, quantity: Quantity) -> dict[str, tuple[int, int, int]]:
        """The shapes of planes, lines and vectors by name: channels, rows, columns."""
        components, shapes = COMPONENTS[quantity], {}
        for axes in AXES:
            columns, rows, length = (self.grid[axis] for axis in axes)
            shapes[plane_name(quantity, axes)] = (components, rows, columns)
            shapes[line_name(quantity, axes)] = (components, length, 1)
        return shapes | {vector_name(quantity, j): (CHANNELS, length, 1) for j, length in enumerate(self.vectors)}

    def layers(self, quantity: Quantity) -> dict[str, tuple[int, int]]:
        """The shapes of the linear maps by name: the bias-free basis, then the network's three layers."""
        seen = (FEATURES + 3) * (1 + 2 * len(FREQUENCIES))  # features, and the position or the direction
        widths = (seen, WIDTH, WIDTH, OUTPUTS[quantity])
        shapes = {f"{quantity}.basis": (FEATURES, COMPONENTS[quantity] + CHANNELS * len(self.vectors))}
        return shapes | {f"{quantity}.layer_{i}": (widths[i], widths[i - 1]) for i in (1, 2, 3)}

    def initial(self, random: np.random.Generator) -> dict[str, Tensor]:
        """Initial tensors of the field by name: normal planes and lines, constant vectors, networks as torch starts linear layers.

        The last layers' biases are zero (official code).
        """
        tensors = {}
        for quantity in QUANTITIES:
            for name, shape in self.grids(quantity).items():
                first = GRID_DEVIATION * random.standard_normal(shape, dtype=np.float32)
                tensors[name] = torch.full(shape, FIRST_VECTOR) if ".vector_" in name else torch.from_numpy(first)
            for name, (rows, columns) in self.layers(quantity).items():
                bound = 1.0 / math.sqrt(columns)
                tensors[f"{name}.weights"] = _uniform(random, bound, (rows, columns))
                if ".layer_" in name:
                    tensors[f"{name}.biases"] = _uniform(random, 0.0 if ".layer_3" in name else bound, (rows,))
        return tensors


@dataclass(frozen=True, eq=False)
class ViSNeRFField:
    """The field of `tensors` by name; with `bfloat16` its networks compute in that precision.

    Points (N, 3) are in [-1, 1] along each side of the box, parameters in [-1, 1] over their bounds; what lies beyond counts as the
    border.  A parameter's `vectors_at` are asked for once for each ray and handed to the other two with a row for each point.
    """

    tensors: Mapping[str, Tensor]
    architecture: ViSNeRFArchitecture
    bfloat16: bool = False

    def vectors_at(self, quantity: Quantity, parameters: Tensor) -> Tensor:
        """Vectors at the parameters (R, P), concatenated: (R, 4 P)."""
        vectors = [parameters.new_zeros(len(parameters), 0)]
        for number, values in enumerate(parameters.unbind(1)):
            vectors.append(self._line(vector_name(quantity, number), values).T)
        return torch.cat(vectors, dim=1)

    def densities(self, points: Tensor, vectors: Tensor) -> Tensor:
        """Densities (N,) per unit of length, from points (N, 3) and vectors (N, 4 P)."""
        components = self.components("density", points)
        with self._precision(points):
            features = self._features("density", components, vectors)  # [N, 27]
            inputs = torch.cat([points, features, encoded(points), encoded(features)], dim=1)  # [N, 150]
            outputs = self._network("density", inputs).squeeze(1).float()  # [N]
        return softplus(outputs + DENSITY_SHIFT)

    def colors(self, points: Tensor, vectors: Tensor, directions: Tensor) -> Tensor:
        """Colours (N, 3) in [0, 1], from points (N, 3), vectors (N, 4 P) and the unit directions (N, 3) of their rays."""
        components = self.components("color", points)
        with self._precision(points):
            features = self._features("color", components, vectors)  # [N, 27]
            inputs = torch.cat([features, directions, encoded(features), encoded(directions)], dim=1)  # [N, 150]
            outputs = self._network("color", inputs).float()  # [N, 3]
        return torch.sigmoid(outputs)

    def components(self, quantity: Quantity, points: Tensor) -> Tensor:
        """The sum over the three planes of plane times line at points (N, 3): (N, 16) or (N, 48)."""
        total = points.new_zeros(())
        for axes in AXES:
            plane = _interpolated(self.tensors[plane_name(quantity, axes)], points[:, list(axes[:2])])  # [C, N]
            total = total + plane * self._line(line_name(quantity, axes), points[:, axes[2]])
        return total.T

    def _line(self, name: str, at: Tensor) -> Tensor:
        return _interpolated(self.tensors[name], torch.stack([torch.zeros_like(at), at], dim=1))  # [C, N]

    def _features(self, quantity: Quantity, components: Tensor, vectors: Tensor) -> Tensor:
        inputs = torch.cat([components, vectors], dim=1)  # [N, 16 or 48 + 4 P]
        return linear(inputs, self.tensors[f"{quantity}.basis.weights"]).float()

    def _network(self, quantity: Quantity, inputs: Tensor) -> Tensor:
        for layer in (1, 2, 3):
            name = f"{quantity}.layer_{layer}"
            inputs = linear(
                relu(inputs) if layer > 1 else inputs, self.tensors[f"{name}.weights"], self.tensors[f"{name}.biases"]
            )
        return inputs

    def _precision(self, like: Tensor) -> torch.autocast:
        return torch.autocast(like.device.type, dtype=torch.bfloat16, enabled=self.bfloat16)


def encoded(values: Tensor) -> Tensor:
    """Sines, then cosines, of values (N, D) times 1 and 2, (N, 4 D); without pi (official code)."""
    scaled = (values.unsqueeze(-1) * values.new_tensor(FREQUENCIES)).flatten(1)  # [N, 2 D]
    return torch.cat([scaled.sin(), scaled.cos()], dim=1)


def variation(grid: Tensor) -> Tensor:
    """Twice the mean squared difference of neighbours of a grid (C, H, W) along rows and columns, added.

    Chen et al. 2022, section 4 (official code).  Along a side of one there are no neighbours: 0, where the formula says 0 / 0.
    """
    differences = [grid.diff(dim=dim) for dim in (1, 2) if grid.shape[dim] > 1]
    return 2.0 * sum((d.square().mean() for d in differences), grid.new_zeros(()))


def _interpolated(grid: Tensor, at: Tensor) -> Tensor:
    """A grid (C, H, W) at (N, 2) in [-1, 1], along columns first: (C, N); the corners are the outermost entries' middles."""
    return bilinear(grid[None], at[None])[0]


def _uniform(random: np.random.Generator, bound: float, shape: tuple[int, ...]) -> Tensor:
    return torch.from_numpy(random.uniform(-bound, bound, shape)).to(torch.float32)
