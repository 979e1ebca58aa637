"""Gaussians as other viewers have them: constant opacities, and colours as spherical harmonics of the direction."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from catalogs.vocabulary.words import one_line
from surrogate.gaussians import Gaussians
from surrogate.model import DeformedGaussians

SH_C0 = 0.28209479177387814  # sqrt(1 / (4 pi)), the real spherical harmonic of degree 0
SH_C1 = 0.4886025119029199
SH_C2 = (1.0925484305920792, -1.0925484305920792, 0.31539156525252005, -1.0925484305920792, 0.5462742152960396)
DEGREES = {1: 0, 4: 1, 9: 2}  # of harmonics, by the number of coefficients
CHANNELS = 3
NODES = 64  # of the quadrature over how much a surface faces the viewer

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Splats:
    """N Gaussians in world units.

    Attributes
    ----------
    means : (N, 3).
    scales : (N, 3) standard deviations along the principal axes.
    quats : (N, 4), unit quaternions w, x, y, z.
    opacities : (N,), the alpha at the centre, from everywhere.
    coefficients : (N, K, 3) of colours, K = 1, 4 or 9: the constant itself, then factors of `harmonics`.
    parameters : where in the ensemble they are.
    """

    means: Array
    scales: Array
    quats: Array
    opacities: Array
    coefficients: Array
    parameters: Mapping[str, float | str]

    __repr__ = one_line

    def __len__(self) -> int:
        return len(self.means)

    @classmethod
    def of(cls, deformed: DeformedGaussians) -> Splats:
        """The Gaussians of a member as they are; those that absorb along rays with the opacity of balls of the same volume."""
        quats = _array(deformed.gaussians.quats)
        return cls(
            deformed.means,
            deformed.scales,
            quats / np.linalg.norm(quats, axis=1, keepdims=True),
            1.0 / (1.0 + np.exp(-_array(deformed.gaussians.opacity_logits))),
            coefficients_of(deformed.gaussians),
            deformed.parameters,
        )

    @property
    def degree(self) -> int:
        """The degree of the harmonics."""
        return DEGREES[self.coefficients.shape[1]]

    @property
    def harmonics(self) -> Array:
        """The coefficients (N, K, 3) of formats that add 0.5 to the sum over all harmonics, the constant one among them."""
        constant = (self.coefficients[:, :1] - 0.5) / SH_C0
        return np.concatenate([constant, self.coefficients[:, 1:]], axis=1)


def harmonics_of(directions: Tensor, count: int) -> Tensor:
    """One, and the real spherical harmonics of unit `directions` (N, 3) after it, (N, count) for `count` 1, 4 or 9.

    Signs and order are those of Kerbl et al. 2023, and of KHR_gaussian_splatting, "Calculating color from Spherical Harmonics".
    """
    x, y, z = directions.unbind(1)
    each = [torch.ones_like(x)]
    if count > 1:
        each += [-SH_C1 * y, SH_C1 * z, -SH_C1 * x]
    if count > 4:
        second = (x * y, y * z, 2 * z * z - x * x - y * y, x * z, x * x - y * y)
        each += [factor * basis for factor, basis in zip(SH_C2, second, strict=True)]
    return torch.stack(each, dim=1)


def coefficients_of(gaussians: Gaussians) -> Array:
    """Colours by direction, (N, K, 3): the constant, then factors of `harmonics_of`; of lit surfaces up to degree 2."""
    colors = _array(gaussians.colors)  # [N, 3 K]
    if gaussians.lighting is None:
        return colors.reshape(len(gaussians), -1, CHANNELS)
    lengths = np.linalg.norm(colors, axis=1, keepdims=True)  # [N, 1]
    normals = torch.from_numpy(colors / np.maximum(lengths, 1e-30))
    harmonics = harmonics_of(normals, 9)[:, 4:].numpy()  # [N, 5]
    nodes, weights = np.polynomial.legendre.leggauss(NODES)
    nodes, weights = (nodes + 1.0) / 2.0, weights / 2.0  # [Q], over cosines from 0 to 1
    facing = torch.from_numpy(lengths * nodes).reshape(-1, 1)  # [N Q, 1]
    shades = gaussians.lighting.colors(facing, torch.ones_like(facing)).numpy().reshape(len(colors), NODES, CHANNELS)
    constant = np.einsum("nqc,q->nc", shades, weights)  # [N, 3]
    second = np.einsum("nqc,q->nc", shades, weights * (1.5 * nodes**2 - 0.5)) * 4.0 * np.pi  # [N, 3], Funk-Hecke
    rest = harmonics[:, :, None] * second[:, None]  # [N, 5, 3]
    return np.concatenate([constant[:, None], np.zeros_like(rest[:, :3]), rest], axis=1)


def _array(tensor: Tensor) -> Array:
    return tensor.detach().double().cpu().numpy()
