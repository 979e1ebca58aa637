"""Extinction and emission of a transfer function at field values: by the C++ kernel, or by its reference implementation."""

from __future__ import annotations

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from catalogs.vocabulary.appearance import TransferFunction
from native import kernels
from surrogate.appearance.averages import MOST_OPAQUE

SAMPLES = 32  # of the transfer function between two neighbouring values


def extinction_table(function: TransferFunction, values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Extinction, and extinction times colour, at B increasing values: (B, 4), per opacity unit distance of the function.

    Each is the mean over the neighbouring intervals, weighted by the hat function of linear interpolation: 1 at the value and 0 at
    its neighbours.
    """
    points = np.array(function.color_points), np.array(function.opacity_points)  # [P, 4], [Q, 2]
    return kernels.extinction_table(values, *points, SAMPLES, MOST_OPAQUE)


def extinction_table_reference(function: TransferFunction, values: NDArray[np.float64]) -> NDArray[np.float64]:
    """The same in numpy: the definition that the kernel is tested against."""
    inside = (np.arange(SAMPLES) + 0.5) / SAMPLES  # [S], places between two values
    fine = values[:-1, None] + np.diff(values)[:, None] * inside  # [B - 1, S]
    extinctions = -np.log1p(-np.minimum(function.opacities(fine), MOST_OPAQUE))  # [B - 1, S]
    columns = np.concatenate([extinctions[..., None], extinctions[..., None] * function.colors(fine)], axis=2)
    lengths = np.diff(values)[:, None]  # [B - 1, 1]
    # [B - 1, 4] each: to the upper and to the lower value of each interval
    rising = lengths * np.einsum("s,bsc->bc", inside, columns) / SAMPLES
    falling = lengths * np.einsum("s,bsc->bc", 1.0 - inside, columns) / SAMPLES
    total = np.pad(rising, ((1, 0), (0, 0))) + np.pad(falling, ((0, 1), (0, 0)))  # [B, 4]
    weight = np.pad(lengths, ((1, 0), (0, 0))) / 2.0 + np.pad(lengths, ((0, 1), (0, 0))) / 2.0  # [B, 1]
    return total / weight


def differentiable_table(function: TransferFunction, opacity_points: Tensor, values: NDArray[np.float64]) -> Tensor:
    """The table (B, 4) of a function that has these control points (Q, 2) float64 of its opacity, differentiable by them."""
    inside = torch.arange(SAMPLES).add(0.5).double() / SAMPLES  # [S]
    lengths = torch.from_numpy(np.diff(values))[:, None]  # [B - 1, 1]
    fine = torch.from_numpy(values[:-1, None]) + lengths * inside  # [B - 1, S]
    extinctions = -torch.log1p(-_interpolated(fine, opacity_points).clamp(max=MOST_OPAQUE))  # [B - 1, S]
    colors = torch.from_numpy(function.colors(fine.numpy()))  # [B - 1, S, 3]
    columns = torch.cat([extinctions[..., None], extinctions[..., None] * colors], dim=2)  # [B - 1, S, 4]
    rising = lengths * torch.einsum("s,bsc->bc", inside, columns) / SAMPLES  # [B - 1, 4]
    falling = lengths * torch.einsum("s,bsc->bc", 1.0 - inside, columns) / SAMPLES  # [B - 1, 4]
    pad = torch.nn.functional.pad
    total = pad(rising, (0, 0, 1, 0)) + pad(falling, (0, 0, 0, 1))  # [B, 4]
    return total / (pad(lengths, (0, 0, 1, 0)) / 2.0 + pad(lengths, (0, 0, 0, 1)) / 2.0)


def _interpolated(places: Tensor, points: Tensor) -> Tensor:
    """Heights at `places` (...) of the lines through points (Q, 2), constant beyond the ends."""
    across, heights = points.unbind(1)  # [Q] each
    upper = torch.searchsorted(across.detach().contiguous(), places, right=True).clamp(1, len(across) - 1)  # [...]
    low, high = across[upper - 1], across[upper]
    shares = ((places - low) / (high - low)).clamp(0.0, 1.0)
    return heights[upper - 1] + shares * (heights[upper] - heights[upper - 1])
