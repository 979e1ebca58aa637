"""The range of one or two parameters that holds some of the members, where chance alone would hardly put them there."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations

from catalogs.vocabulary.parameters import Parameter, ParameterSpace

MOST_CHANCE = 0.05  # of members placed at random to fit one of the ranges that were tried


@dataclass(frozen=True)
class Bound:
    """The members above or below a value of a parameter."""

    parameter: Parameter
    value: float
    above: bool

    def __str__(self) -> str:
        sign = ">" if self.above else "<"
        return f"{self.parameter.name} {sign} {self.value:.10g} {self.parameter.unit}".rstrip()

    def holds(self, parameters: Mapping[str, float]) -> bool:
        """True for parameters beyond the value."""
        return (float(parameters[self.parameter.name]) > self.value) == self.above

    @property
    def opposite(self) -> Bound:
        """The rest of the range."""
        return Bound(self.parameter, self.value, not self.above)


def where(space: ParameterSpace, members: Sequence[Mapping[str, float]], flags: Sequence[bool]) -> tuple[Bound, ...]:
    """The one or two bounds that hold all members with flags, and hardly others; () where that may be chance.

    With k of M members within the bounds, chance puts all f with flags there with probability C(k, f) / C(M, f).  Times the
    number of bounds tried (Bonferroni), that is at most `MOST_CHANCE`.
    """
    flagged = sum(flags)
    if not 0 < flagged < len(flags):
        return ()
    bounds = [b for p in space.parameters for above in (False, True) if (b := _bound(p, members, flags, above))]
    tried = 2 * len(space)
    chances = {}
    for each in (*combinations(bounds, 1), *combinations(bounds, 2)):
        inside = sum(all(bound.holds(member) for bound in each) for member in members)
        by_chance = math.comb(inside, flagged) / math.comb(len(members), flagged)
        chances[each] = by_chance * math.comb(tried, len(each))
    best = min(chances, key=lambda each: chances[each], default=())
    return best if best and chances[best] <= MOST_CHANCE else ()


def _bound(
    parameter: Parameter, members: Sequence[Mapping[str, float]], flags: Sequence[bool], above: bool
) -> Bound | None:
    """The bound on one side that holds all members with flags and the fewest others; None where it holds all members."""
    values = [float(member[parameter.name]) for member in members]
    inside = [v for v, flag in zip(values, flags, strict=True) if flag]
    edge = min(inside) if above else max(inside)
    others = [v for v in values if (v < edge if above else v > edge)]
    if not others:
        return None
    return Bound(parameter, short_between(edge, max(others) if above else min(others)), above)


def short_between(one: float, other: float) -> float:
    """A number of few digits about halfway between two."""
    low, high = sorted((one, other))
    for digits in range(1, 17):
        rounded = float(f"{(low + high) / 2.0:.{digits}g}")
        if low < rounded < high:
            return rounded
    return (low + high) / 2.0
