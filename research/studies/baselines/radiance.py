"""Volume rendering of samples along rays, and resampling where earlier samples have weight.

Mildenhall et al. 2020, "NeRF: Representing Scenes as Neural Radiance Fields for View Synthesis", equation 3 and section 5.2.
"""

from __future__ import annotations

import torch
from torch import Tensor


def weights_of(densities: Tensor, lengths: Tensor) -> Tensor:
    """Contributions (R, S) of samples to their rays, from densities and the lengths (R, S) of their intervals.

    w_i = T_i (1 - exp(-density_i length_i)), T_i = exp(-sum of density_j length_j before it).
    """
    depths = densities * lengths  # [R, S]
    before = torch.nn.functional.pad(torch.cumsum(depths[:, :-1], dim=1), (1, 0))  # [R, S]
    return torch.exp(-before) * -torch.expm1(-depths)


def composite(weights: Tensor, colors: Tensor) -> Tensor:
    """Premultiplied RGBA (R, 4) of samples with weights (R, S) and colours (R, S, 3)."""
    color = (weights.unsqueeze(-1) * colors).sum(dim=1)  # [R, 3]
    return torch.cat([color, weights.sum(dim=1, keepdim=True)], dim=1)


def spaced(near: Tensor, far: Tensor, count: int, random: torch.Generator | None = None) -> Tensor:
    """`count` + 1 borders (R, count + 1) of equal intervals between distances `near` and `far` (R,).

    With `random` the inner ones are moved by up to half an interval each.
    """
    fractions = torch.linspace(0.0, 1.0, count + 1, device=near.device).expand(len(near), -1)  # [R, S + 1]
    if random is not None:
        moved = torch.rand(len(near), count + 1, generator=random, device=near.device) - 0.5
        moved[:, [0, -1]] = 0.0
        fractions = fractions + moved / count
    return near[:, None] + fractions * (far - near)[:, None]


def resampled(
    borders: Tensor, weights: Tensor, count: int, random: torch.Generator | None = None, padding: float = 0.01
) -> Tensor:
    """`count` + 1 borders (R, count + 1), in order, dense where the intervals of `borders` (R, S + 1) have weights (R, S).

    Inverse transform sampling of the piecewise constant density whose histogram is the weights, each raised by
    `padding`. Evenly spaced quantiles are moved together by a random fraction of their distance with `random`. No
    gradient passes.
    """
    with torch.no_grad():
        weights = weights + padding  # [R, S]
        below = torch.cumsum(weights, dim=1) / weights.sum(dim=1, keepdim=True)  # [R, S]
        below = torch.cat([torch.zeros_like(below[:, :1]), below], dim=1)  # [R, S + 1]
        below[:, -1] = 1.0
        quantiles = torch.linspace(0.0, 1.0, count + 1, device=borders.device).expand(
            len(borders), -1
        )  # [R, count + 1]
        if random is not None:
            shift = (torch.rand(len(borders), 1, generator=random, device=borders.device) - 0.5) / count
            quantiles = (quantiles + shift).clamp(0.0, 1.0)
        at = torch.searchsorted(below, quantiles.contiguous(), right=True).clamp(
            1, borders.shape[1] - 1
        )  # [R, count + 1]
        low, high = below.gather(1, at - 1), below.gather(1, at)
        part = ((quantiles - low) / (high - low).clamp(min=1e-12)).clamp(0.0, 1.0)
        start, end = borders.gather(1, at - 1), borders.gather(1, at)
        return start + part * (end - start)
