"""A transfer function averaged over normally distributed field values, in closed form.

A function of u is given by nodes: linear between them, a step where two lie at one place, constant beyond the ends.  A change by J
from place a to place b changes its average under N(u, s²) by J times the mean of Phi((u - t) / s) over t in [a, b].  Phi is the
normal distribution's cumulative function.  With H(z) = z Phi(z) + phi(z), whose derivative is Phi, that mean is

    (H(z_a) - H(z_b)) / (z_a - z_b),        z_a = (u - a) / s,  z_b = (u - b) / s,

and Phi(z_a) for a step.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from catalogs.vocabulary import numbers
from catalogs.vocabulary.appearance import TransferFunction
from catalogs.vocabulary.words import one_line

LEAST_SPREAD, MOST_SPREAD = 0.004, 0.6  # spreads s that `AverageTable` has, and for which `resampled` chooses its nodes
LOWEST, HIGHEST = -0.5, 1.5  # values u that `AverageTable` has
MOST_OPAQUE = 0.999  # an opacity of 1 would be an infinite extinction
TOLERANCE = 1e-4  # of `resampled`: error of an average, by the averaged extinction
NEGLIGIBLE = 0.01  # of the function's largest extinction: errors are measured by no less than that
FAR = 40.0  # beyond as many spreads Phi is 0 or 1 in float64 too
NARROW = 0.1  # spreads: over less, differences of H have lost digits


@dataclass(frozen=True, eq=False)
class Nodes:
    """Extinction and emission as functions of a value u: linear between nodes, constant beyond the ends.

    Raises ValueError naming what does not fit.

    Attributes
    ----------
    places : (K,) float64, never decreasing; where several are equal, the function steps from the first to the last of them.
    columns : (K, 4) float64, extinction and extinction times red, green and blue, none negative; dimensionless, per opacity
        unit distance of the base function.
    """

    places: NDArray[np.float64]  # [K]
    columns: NDArray[np.float64]  # [K, 4]

    __repr__ = one_line

    def __post_init__(self) -> None:
        places, columns = (np.array(a, dtype=np.float64, order="C") for a in (self.places, self.columns))
        if places.ndim != 1 or not len(places) or columns.shape != (len(places), 4):
            raise ValueError(
                f"nodes must be places (K,) and columns (K, 4), K from 1 on, got {places.shape} and {columns.shape}"
            )
        if not np.isfinite(places).all() or (np.diff(places) < 0.0).any():
            raise ValueError(f"places of nodes must be finite and never decrease, got {places}")
        wrong = np.flatnonzero(~np.isfinite(columns).all(axis=1) | (columns < 0.0).any(axis=1))
        if len(wrong):
            raise ValueError(
                f"extinction and emission must be finite and not negative, got {columns[wrong[0]]} at node {wrong[0]}"
            )
        dark = np.flatnonzero((columns[:, 0] == 0.0) & (columns[:, 1:] > 0.0).any(axis=1))
        if len(dark):
            raise ValueError(f"only what absorbs can emit, got {columns[dark[0]]} at node {dark[0]}")
        object.__setattr__(self, "places", places)
        object.__setattr__(self, "columns", columns)

    def __len__(self) -> int:
        return len(self.places)


def averages_reference(nodes: Nodes, values: Tensor, log_spreads: Tensor) -> Tensor:
    """The columns (N, 4) averaged under normal distributions: the definition that the kernel is tested against.

    Parameters
    ----------
    values : (N,) finite means u, of any float dtype, which is that of the result.
    log_spreads : (N,) logarithms of the standard deviations s.
    """
    places, columns = (torch.from_numpy(array).to(values) for array in (nodes.places, nodes.columns))  # [K], [K, 4]
    changes = torch.from_numpy(np.diff(nodes.columns, axis=0)).to(values)  # [K - 1, 4]
    widths = torch.from_numpy(np.diff(nodes.places)).to(values)  # [K - 1]
    per_spread = torch.exp(-log_spreads)[:, None]  # [N, 1]
    z = (values[:, None] - places) * per_spread  # [N, K]
    shares = _mean_cumulative(z[:, :-1], z[:, 1:], widths * per_spread)  # [N, K - 1]
    return columns[0] + shares @ changes


def _mean_cumulative(upper: Tensor, lower: Tensor, widths: Tensor) -> Tensor:
    """Means of Phi(z) over z from `lower` to `upper`, which are `widths` apart (...)."""
    narrow = widths < NARROW
    # H(z) = max(z, 0) + H(-|z|), and this difference of the first part loses no digits
    ramp = torch.where(lower > 0.0, widths, torch.relu(upper))
    wide = (ramp + _tail(upper) - _tail(lower)) / torch.where(narrow, 1.0, widths)
    # the Taylor series about the middle, up to the fourth derivative of Phi: what is left out is below 2e-11
    z, square = (0.5 * (upper + lower)).clamp(-FAR, FAR), widths.clamp(max=NARROW) ** 2
    series = _cumulative(z) + _density(z) * square * (-z / 24.0 + square * (3.0 * z - z**3) / 1920.0)
    return torch.where(narrow, series, wide)


def _cumulative(z: Tensor) -> Tensor:
    return 0.5 * torch.special.erfc(-z * math.sqrt(0.5))


def _density(z: Tensor) -> Tensor:
    return torch.exp(-0.5 * z**2) / math.sqrt(2.0 * math.pi)


def _tail(z: Tensor) -> Tensor:
    """H(-|z|)."""
    size = torch.where(z > 0.0, z, -z).clamp(max=FAR)  # at 0 with the derivative that torch.relu leaves to it
    return _density(z) - size * _cumulative(-size)


def resampled(function: TransferFunction, unit: float, knots: NDArray[np.float64]) -> Nodes:
    """Nodes of a transfer function on the scale whose u = 0, 1 / (n - 1), ..., 1 are the field values `knots`.

    There is a node at every knot and control point, and as many between as averages over spreads from LEAST_SPREAD on need.  Each
    of the four errs by at most TOLERANCE times the larger of the averaged extinction and NEGLIGIBLE of the largest extinction.
    Raises ValueError naming what is wrong with `unit` or `knots`.

    Parameters
    ----------
    unit : the opacity unit distance of the base function: extinctions are dimensionless by it.
    knots : (n,) increasing field values, n from 2 on; beyond them the scale goes on as in its first and last interval.
    """
    unit, knots = numbers.positive(unit, "unit"), np.asarray(knots, dtype=np.float64)  # [n]
    if knots.ndim != 1 or len(knots) < 2 or not np.isfinite(knots).all() or not (np.diff(knots) > 0.0).all():
        raise ValueError(f"knots must be two or more increasing field values, got {knots}")
    values = _breaks(function, knots)  # [I + 1]
    opacities = np.minimum(function.opacities(values), MOST_OPAQUE)  # [I + 1]
    depths = -np.log1p(-opacities)  # [I + 1]
    pieces = _Pieces(_on_scale(values, knots), opacities, depths, function.colors(values))
    scale = unit / function.opacity_unit_distance
    places, columns = _placed(pieces, _counts(pieces))
    return Nodes(places, scale * columns)


@dataclass(frozen=True)
class _Pieces:
    """The places at which opacity or colour, both linear in between, bend."""

    places: NDArray[np.float64]  # [I + 1]
    opacities: NDArray[np.float64]  # [I + 1]
    depths: NDArray[np.float64]  # [I + 1], -ln(1 - opacity)
    colors: NDArray[np.float64]  # [I + 1, 3]

    @property
    def floor(self) -> float:
        """The extinction below which errors are not relative."""
        return max(NEGLIGIBLE * float(self.depths.max()), 1e-12)


def _breaks(function: TransferFunction, knots: NDArray[np.float64]) -> NDArray[np.float64]:
    """Increasing field values, between which opacity, colour and scale are linear and MOST_OPAQUE is not crossed."""
    values, opacities = np.array(function.opacity_points).T  # [Q] each
    over = opacities - MOST_OPAQUE  # [Q]
    k = np.flatnonzero(over[:-1] * over[1:] < 0.0)
    capped = values[k] + over[k] / (over[k] - over[k + 1]) * (values[k + 1] - values[k])
    return np.unique(np.concatenate([values, capped, knots, np.array(function.color_points)[:, 0]]))


def _on_scale(values: NDArray[np.float64], knots: NDArray[np.float64]) -> NDArray[np.float64]:
    """Places u of field values on the scale of `knots`."""
    k = np.clip(np.searchsorted(knots, values, side="right") - 1, 0, len(knots) - 2)
    return (k + (values - knots[k]) / (knots[k + 1] - knots[k])) / (len(knots) - 1)


def _counts(pieces: _Pieces) -> NDArray[np.int64]:
    """Into how many parts each of the pieces is cut, (I,).

    Parts are equal in w = sqrt(extinction + floor).  A line then errs by (step of w)² / 2 of w² where the colour is even, elsewhere
    by change of extinction x change of colour / 4.  Averages err far less when a part is not much wider than the least spread,
    because inner nodes are placed so that the errors add up to zero.
    """
    w = np.sqrt(pieces.depths + pieces.floor)  # [I + 1]
    steps, low = np.abs(np.diff(w)), np.minimum(w[1:], w[:-1])  # [I] each
    colors = np.abs(np.diff(pieces.colors, axis=0)).max(axis=1)  # [I]
    chord = steps**2 / 2.0 + colors * steps / (2.0 * np.maximum(low, steps))  # [I], times 1 / parts²
    middle = np.clip(np.sqrt(0.5), low, low + steps)  # where a step of w goes farthest in u
    change = np.maximum(np.abs(np.diff(pieces.opacities)), 1e-300)  # [I]
    steepest = 2.0 * middle * np.exp(pieces.floor - middle**2) * steps / change  # [I], over the mean
    widest = np.diff(pieces.places) * steepest / LEAST_SPREAD  # [I], times 1 / parts
    most = int(np.ceil(np.sqrt(chord.max() / TOLERANCE))) + 1
    parts = np.arange(1, most + 1)  # [most]
    width = np.maximum(widest[:, None] / parts, 1e-3)  # [I, most]
    damping = np.minimum(1.0, 0.15 * width + np.exp(-20.0 / width**2) + 20.0 / parts**2)  # [I, most]
    damping[:, 0] = 1.0  # no inner node
    chord *= np.minimum(1.0, 0.3 / NEGLIGIBLE * np.diff(pieces.places) / LEAST_SPREAD)  # [I]
    return 1 + np.argmax(chord[:, None] / parts**2 * damping <= TOLERANCE, axis=1)


def _placed(pieces: _Pieces, counts: NDArray[np.int64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Nodes that cut the pieces into `counts` parts: places (K,), and columns (K, 4) by the function's own unit distance."""
    piece = np.repeat(np.arange(len(counts)), counts)  # [K - 1]
    first = np.repeat(np.cumsum(counts) - counts, counts)  # [K - 1]
    inside = (np.arange(len(piece)) - first) / counts[piece]  # [K - 1], 0 where the piece begins
    inner = inside > 0.0  # [K - 1]
    w = np.sqrt(pieces.depths + pieces.floor)  # [I + 1]
    between = (w[piece] + inside * np.diff(w)[piece]) ** 2 - pieces.floor  # [K - 1]
    depths = np.where(inner, between, pieces.depths[piece])  # [K - 1]
    change = np.diff(pieces.opacities)[piece]  # [K - 1]
    rise = -np.expm1(-depths) - pieces.opacities[piece]  # [K - 1]
    shares = np.where(change == 0.0, inside, rise / np.where(change == 0.0, 1.0, change))  # [K - 1]
    lengths = np.diff(pieces.places)[piece]  # [K - 1]
    color_change = np.diff(pieces.colors, axis=0)[piece]  # [K - 1, 3]
    hues = np.pad(
        pieces.colors[piece] + shares[:, None] * color_change, ((0, 0), (1, 0)), constant_values=1.0
    )  # [K - 1, 4]
    places = np.append(pieces.places[piece] + shares * lengths, pieces.places[-1])  # [K]
    columns = depths[:, None] * hues  # [K - 1, 4]

    # A line errs by h³ / 12 times the second derivative: inner nodes make up for it, one beside an end for all of its part.
    per_length = 1.0 / np.where(lengths > 0.0, lengths, np.inf)  # [K - 1]
    slopes = change * per_length * np.exp(depths)  # [K - 1], of the extinction
    bends = slopes[:, None] ** 2 * hues  # [K - 1, 4]
    bends[:, 1:] += (2.0 * slopes * per_length)[:, None] * color_change
    before, after = np.diff(places, prepend=places[0])[:-1], np.diff(places)  # [K - 1] each
    beside = 2.0 - np.roll(inner, 1), 2.0 - np.roll(inner, -1)  # 2 where that neighbour is an end
    moved = (before**3 * beside[0] + after**3 * beside[1]) / np.maximum(12.0 * (before + after), 1e-300)  # [K - 1]
    columns -= np.where(inner, moved, 0.0)[:, None] * bends
    last = pieces.depths[-1] * np.append(1.0, pieces.colors[-1])  # [4]
    return places, np.maximum(np.concatenate([columns, last[None]]), 0.0)
