"""Relocation of Gaussians that have become invisible to where more are needed; their number stays the same.

Source: Kheradmand et al. 2024, "3D Gaussian Splatting as Markov Chain Monte Carlo", section 3.3.  A dead Gaussian moves onto a
living one, chosen in proportion to its opacity.  Those that now share a place get the opacity and scale with which together they
look like the one before (equation 9).

In an ensemble a Gaussian may be invisible in one member and needed in another.  So a decayed running maximum of the *deformed*
opacity over the members seen lately counts, not the canonical opacity.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from surrogate.training.optimizer import Moments

DEAD_OPACITY = 0.01
PEAK_DECAY = 0.995  # of the recent largest opacities, per step
STOP = 0.7  # of a stage; later no Gaussian is relocated
MOST_SHARING = 16  # Gaussians that may come to share one place at once
LEAST_DEPTH = 1e-300  # so that its logarithm is finite


@dataclass(frozen=True, eq=False)
class Relocation:
    """Which Gaussians move onto which: `moved` (D,) take the places of `sources` (D,); `sharing` (D,) share it then."""

    moved: Tensor  # [D] int64
    sources: Tensor  # [D] int64
    sharing: Tensor  # [D] int64

    def to(self, device: torch.device) -> Relocation:
        """The same on another device."""
        return Relocation(self.moved.to(device), self.sources.to(device), self.sharing.to(device))


def plan_relocation(
    peaks: Tensor, random: np.random.Generator, dead_opacity: float = DEAD_OPACITY
) -> Relocation | None:
    """Dead Gaussians and where they go, from `peaks` (N,), each Gaussian's recent largest opacity.

    Places are drawn in proportion to the opacities.

    Sharers of a source must not be nearly dead again (below twice `dead_opacity`).  Else a crowd of faint Gaussians would be shared
    out again and again (CloverLeaf, 40,000 Gaussians: 48 dB fell to 27).  Dead Gaussians without room stay where they are.  None
    where nothing moves; else in main memory.
    """
    opacities = peaks.cpu().numpy().astype(np.float64)  # [N]
    dead = np.flatnonzero(~(opacities >= dead_opacity))
    room = np.log1p(-np.minimum(opacities, 1.0 - 1e-6)) / np.log1p(-2.0 * dead_opacity)  # [N], who may share each place
    room = np.minimum(np.floor(room).astype(np.int64), MOST_SHARING) - 1  # [N], beside the one that is there
    chances = np.where(room > 0, opacities, 0.0)
    if not len(dead) or not chances.any():
        return None
    sources = random.choice(len(opacities), len(dead), p=chances / chances.sum())  # [D]
    admitted = _place_in_group(sources) < room[sources]
    moved, sources = dead[admitted], sources[admitted]
    sharing = 1 + np.bincount(sources, minlength=len(opacities))[sources]  # [D]
    return Relocation(*(torch.from_numpy(rows) for rows in (moved, sources, sharing)))


def _place_in_group(values: NDArray[np.int64]) -> NDArray[np.int64]:
    """The number of values (D,) before each one that equal it, (D,)."""
    order = np.argsort(values, kind="stable")
    starts = np.flatnonzero(np.diff(values[order], prepend=-1))  # of each group in the order
    lengths = np.diff(starts, append=len(values))
    places = np.empty(len(values), dtype=np.int64)
    places[order] = np.arange(len(values)) - np.repeat(starts, lengths)
    return places


def relocate(relocation: Relocation, rows: Mapping[str, Tensor], moments: Mapping[str, Moments]) -> None:
    """Move Gaussians in place: `rows` are all tensors with a row per Gaussian, `moments` what Adam remembers of them.

    `rows` holds at least `opacity_logits` (N,) and `log_scales` (N, 3).  The first moments of all concerned start anew; second
    ones, and the steps that a row has seen, are those of the source.  With second moments of zero after these steps Adam made
    steps of up to 6.6 times the rate for some fifty steps, from which training drifted away.
    """
    moved, sources = relocation.moved, relocation.sources
    logits, log_scales = share(rows["opacity_logits"][sources], rows["log_scales"][sources], relocation.sharing)
    rows["opacity_logits"][sources] = logits
    rows["log_scales"][sources] = log_scales
    for name, tensor in rows.items():
        tensor[moved] = tensor[sources]
        if name in moments:
            first, second, steps = moments[name]
            first[moved] = 0.0
            first[sources] = 0.0
            second[moved] = second[sources]
            if steps is not None:
                steps[moved] = steps[sources]


def share(opacity_logits: Tensor, log_scales: Tensor, sharing: Tensor) -> tuple[Tensor, Tensor]:
    """Opacity logits (D,) and log scales (D, 3) of each of `sharing` (D,) Gaussians that replace one.

    Equation 9 of Kheradmand et al.: o' = 1 - (1 - o)^(1/n), and scales are multiplied by
    o / sum_{i=1..n} sum_{k=0..i-1} binom(i-1, k) (-1)^k o'^(k+1) / sqrt(k+1).

    Optical depths, -ln(1 - o), are divided.  A Gaussian that is seen in some members only may have a canonical opacity of 1e-17,
    where 1 - o is 1 and a scale would be multiplied by 1e-17 / 0.
    """
    depth = torch.nn.functional.softplus(opacity_logits.double()).clamp(min=LEAST_DEPTH)  # [D]
    each_depth = depth / sharing  # [D]
    each = -torch.expm1(-each_depth)  # [D]
    total = torch.zeros_like(each)  # [D], over `each`
    for i in range(1, int(sharing.max()) + 1):
        terms = sum(math.comb(i - 1, k) * (-1) ** k / math.sqrt(k + 1) * each**k for k in range(i))
        total += torch.where(sharing >= i, terms, 0.0)
    factor = -torch.expm1(-depth) / each / total  # [D]
    logits = each_depth + each.log()  # [D], ln(o' / (1 - o'))
    return logits.float(), log_scales + factor.log().float()[:, None]
