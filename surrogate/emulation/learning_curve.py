"""The learning curve of an ensemble: how much closer emulated fields come with more members."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from catalogs.vocabulary.words import one_line
from surrogate.appearance.scale import ValueScale
from surrogate.emulation.components import Array, products_of
from surrogate.emulation.fitting import FEWEST, Members
from surrogate.emulation.validation import NORMAL, TINY, predicted_by, squared

SHARES = (0.4, 0.55, 0.7, 0.85)  # of the members, that are learnt from
REPEATS = 12  # with other members
FEWEST_MEASURED = 8  # members: the smallest subset then has three


class TooFew(ValueError):
    """An ensemble has too few members to measure a learning curve; the message says how many it takes."""


@dataclass(frozen=True)
class Gain:
    """The expected change of the error with more members, in decibels of the field, and its 90 % interval."""

    more: int
    decibels: float
    low: float
    high: float

    def __str__(self) -> str:
        return f"{self.more} more members: about {self.decibels:+.1f} dB ({self.low:+.1f} to {self.high:+.1f})"


@dataclass(frozen=True, eq=False)
class LearningCurve:
    """Errors of emulators that learnt from some of the members, at all others.

    Decibels are minus twenty times the logarithm of a member's root mean square error over the spread of all values.  Their mean
    grows by a slope times the logarithm of the number of members learnt from: errors fall by a power of it.

    Attributes
    ----------
    members : their number, M.
    sizes : (S,) members that each emulator learnt from.
    decibels : (S, M), NaN for the members that it learnt from.
    """

    members: int
    sizes: NDArray[np.int64]  # [S]
    decibels: Array  # [S, M]

    __repr__ = one_line

    @classmethod
    def of(
        cls,
        points: ArrayLike,
        fields: ArrayLike,
        scale: ValueScale | None = None,
        *,
        runs: ArrayLike | None = None,
        seed: int = 0,
    ) -> LearningCurve:
        """Of fields (M, Z, Y, X) with NaN in holes at normalized points (M, P), measured on a scale of values.

        Members of the same of `runs` (M,), such as its times, are left out together.
        Raises TooFew for fewer than `FEWEST_MEASURED` members, ValueError as `FieldEmulator.fit` does.
        """
        count = len(np.asarray(points))
        if count < FEWEST_MEASURED:
            raise TooFew(f"a learning curve takes {FEWEST_MEASURED} members or more, got {count}")
        members = Members.of(points, fields)
        _, differences = members.about_mean(scale)
        products = products_of(differences if members.solid is None else differences[:, ~members.solid])
        random, groups = np.random.default_rng(seed), np.arange(count) if runs is None else np.asarray(runs)
        wanted = np.repeat([max(FEWEST, round(share * count)) for share in SHARES], REPEATS)  # [S]
        decibels, sizes = np.full((len(wanted), count), np.nan), np.zeros(len(wanted), int)
        for number, size in enumerate(wanted):
            learnt, out = _parted(groups, int(size), random)
            decibels[number, out] = _decibels(learnt, out, members.points, products)
            sizes[number] = len(learnt)
        return cls(count, sizes, decibels)

    @cached_property
    def line(self) -> tuple[float, float, float]:
        """The slope by the logarithm of the number of members, its standard deviation, and that of a mean about the line (dB)."""
        logarithms, means = np.log(self.sizes), np.nanmean(self.decibels, axis=1)  # [S]
        x, y = logarithms - logarithms.mean(), means - means.mean()
        slope = float(x @ y / (x @ x))
        scatter = math.sqrt(float(((y - slope * x) ** 2).sum()) / (len(x) - 2))
        return slope, scatter / math.sqrt(float(x @ x)), scatter

    def gain(self, more: int) -> Gain:
        """The expected gain of `more` members, placed like those there are; raises ValueError for fewer than one.

        Its interval has both the uncertainty of the slope and that of which members they will be.
        """
        if more < 1:
            raise ValueError(f"more must be 1 member or more, got {more}")
        (slope, deviation, scatter), factor = self.line, math.log(1.0 + more / self.members)
        half = NORMAL * math.hypot(deviation * factor, scatter)
        return Gain(more, slope * factor, slope * factor - half, slope * factor + half)

    def to_json(self) -> dict[str, Any]:
        """JSON values: decibels are averages over the members left out."""
        means = np.nanmean(self.decibels, axis=1)
        return {"members": self.members, "sizes": self.sizes.tolist(), "decibels": means.tolist()}


def _parted(
    groups: NDArray[np.int64], size: int, random: np.random.Generator
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """About `size` members of some groups drawn at random, and the members of the others; raises TooFew where none are left."""
    names, sizes = np.unique(groups, return_counts=True)
    order = random.permutation(len(names))
    totals = np.cumsum(sizes[order])  # members of the first one, two, ... groups
    count = min(int(np.searchsorted(totals, size)) + 1, len(names) - 1)
    is_learnt = np.isin(groups, names[order[:count]])
    if is_learnt.sum() < FEWEST:
        raise TooFew(f"a learning curve takes {FEWEST_MEASURED} runs or more, got {len(names)}")
    return np.flatnonzero(is_learnt), np.flatnonzero(~is_learnt)


def _decibels(learnt: NDArray[np.int64], out: NDArray[np.int64], points: Array, products: Array) -> Array:
    """Those (O,) of members `out` by an emulator of the members `learnt`."""
    variance = float(np.trace(products)) / len(points) + np.finfo(float).tiny  # of a member, times V
    remainders, _, _ = predicted_by(learnt, out, points, products)
    return -10.0 * np.log10(squared(remainders, products) / variance + TINY)
