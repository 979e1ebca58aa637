"""Samples of K-Planes, placed by proposal fields: density fields that show where along a ray something is.

Barron et al. 2022, "Mip-NeRF 360: Unbounded Anti-Aliased Neural Radiance Fields", sections 3 and 4 and its supplement.
The schedules are those of K-Planes' official code, of 30,001 steps, stretched to the planned number of steps.

Samples reach from near to far, and resampled ones are moved together. In the official code the outermost borders are
moved too, by up to half an interval inwards, and each is moved on its own.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import torch
from torch import Tensor

from research.studies.baselines.radiance import resampled, spaced, weights_of

STEPS = 30_001  # of the official training
ANNEALED, SLOPE = 1000, 10.0  # steps until samples follow the proposals' weights entirely, and the initial slope
FIRST_UPDATES = 10  # first steps, in each of which the proposals learn
SPARSE, LONGEST_WAIT = 5000, 5  # step of the longest wait between the proposals' updates, and that wait in steps
TINY = 1e-7  # weight of a sample, where errors are divided by it

Densities = Callable[[Tensor], Tensor]  # of the distances (R, S) along R rays, (R, S)


class WeightedSamples(NamedTuple):
    """Intervals along R rays between `borders` (R, S + 1), distances, and their contributions `weights` (R, S)."""

    borders: Tensor  # [R, S + 1]
    weights: Tensor  # [R, S]


def middles(borders: Tensor) -> Tensor:
    """The distances (R, S) at which densities are evaluated between `borders` (R, S + 1)."""
    return (borders[:, 1:] + borders[:, :-1]) / 2.0


def sampled(borders: Tensor, densities: Tensor) -> WeightedSamples:
    """The samples between `borders` (R, S + 1) that have these densities (R, S)."""
    return WeightedSamples(borders, weights_of(densities, borders.diff(dim=1)))


def proposed(
    near: Tensor,
    far: Tensor,
    proposals: Sequence[Densities],
    counts: Sequence[int],
    sharpness: float = 1.0,
    random: torch.Generator | None = None,
) -> tuple[list[WeightedSamples], Tensor]:
    """The samples of every proposal between `near` and `far` (R,), and the final borders (R, counts[-1] + 1).

    The first proposal is evaluated in counts[0] equal intervals, each further one where the previous weights, to the
    power of `sharpness`, are large. With `random`, borders are moved at random.
    """
    samples: list[WeightedSamples] = []
    borders = spaced(near, far, counts[0], random)
    for proposal, count in zip(proposals, counts[1:], strict=True):
        samples.append(sampled(borders, proposal(middles(borders))))
        borders = resampled(borders, samples[-1].weights.detach() ** sharpness, count, random)
    return samples, borders


def interlevel_loss(proposal: WeightedSamples, final: WeightedSamples) -> Tensor:
    """Shortfall of a proposal's weights (R, S) against the final ones (R, T) in the same place: losses (R, T).

    Equation 13 of Mip-NeRF 360: max(0, w - bound)^2 / w, where the bound of an interval is the sum of the proposal's weights in all
    intervals that it overlaps.  Final weights learn nothing from it.
    """
    borders, weights = (tensor.detach() for tensor in final)
    sums = torch.nn.functional.pad(proposal.weights.cumsum(dim=1), (1, 0))  # [R, S + 1], before each border
    last = proposal.weights.shape[1] - 1
    starts, ends = (side.contiguous() for side in (proposal.borders[:, :-1], proposal.borders[:, 1:]))  # [R, S]
    first_overlapped = torch.searchsorted(starts, borders[:, :-1].contiguous(), right=True) - 1  # [R, T]
    last_overlapped = torch.searchsorted(ends, borders[:, 1:].contiguous(), right=True)  # [R, T]
    bounds = sums.gather(1, last_overlapped.clamp(max=last) + 1) - sums.gather(1, first_overlapped.clamp(min=0))
    return (weights - bounds).clamp(min=0.0) ** 2 / (weights + TINY)


def sharpness_at(fraction: float) -> float:
    """Power of the weights after a `fraction` of all steps: from 0, evenly spaced samples, to 1.

    Equation 18 of Mip-NeRF 360.
    """
    part = min(fraction * STEPS / ANNEALED, 1.0)
    return SLOPE * part / ((SLOPE - 1.0) * part + 1.0)


def proposals_learn(fraction: float, waited: int) -> bool:
    """True if the proposals learn in the step after a `fraction` of all steps, `waited` steps after their last update."""
    place = fraction * STEPS
    wait = min(max(LONGEST_WAIT * place / SPARSE, 1.0), LONGEST_WAIT)
    return place < FIRST_UPDATES or waited > wait
