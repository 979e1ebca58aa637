"""Sines and cosines of coordinates, with which a network learns what varies fast along them."""

from __future__ import annotations

import math

import torch
from torch import Tensor


def encode(points: Tensor, frequencies: int) -> Tensor:
    """The positional encoding of NeRF (Mildenhall et al. 2020, equation 4) after the points themselves.

    Parameters
    ----------
    points : (N, D).
    frequencies : K; the angles are pi, 2 pi, ... 2^(K - 1) pi times each coordinate.

    Returns
    -------
    (N, D (1 + 2 K)) : the points, then all sines, then all cosines, each coordinate by coordinate.
    """
    powers = (2 ** torch.arange(frequencies, device=points.device)).to(points)  # [K]
    turns = (points[:, :, None] * powers).flatten(1)  # [N, D K], exact
    angles = math.pi * (turns - 2.0 * (turns / 2.0).round())  # within [-pi, pi], where float32 is as exact as it can be
    return torch.cat([points, angles.sin(), angles.cos()], dim=1)
