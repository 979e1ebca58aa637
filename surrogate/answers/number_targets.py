"""Numbers of a field whose parameters are asked for, in place of pictures."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from catalogs.store.catalog import Catalog
from catalogs.vocabulary.appearance import field_of
from catalogs.vocabulary.cameras import Camera
from catalogs.vocabulary.numbers import finite
from catalogs.vocabulary.words import joined_names, one_line
from surrogate.answers.committee import thinned
from surrogate.answers.drafts import AT_ONCE, values_at
from surrogate.emulation import FieldEmulator
from surrogate.emulation.lattice_field import LatticeField
from surrogate.emulation.measures import NUMBERS, SHARE, Box, histogram, statistics
from surrogate.model import Surrogate
from surrogate.model.judged import judged

HISTOGRAM = "histogram"
LEAST = 1e-4  # of a number's spread over members, which its error is taken to be at least

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Wanted:
    """A number that a field is to have, or shares in bins.

    Attributes
    ----------
    name : "minimum", "maximum", "mean", "share_above" or "histogram".
    values : one, or the share of each bin.
    at : the level of a share, or the B + 1 edges of bins.
    """

    name: str
    values: tuple[float, ...]
    at: tuple[float, ...] = ()

    def __post_init__(self) -> None:
        if self.name not in (*NUMBERS, HISTOGRAM):
            raise ValueError(f"a field has {joined_names((*NUMBERS, HISTOGRAM))}, got {self.name!r}")
        for value in (*self.values, *self.at):
            finite(value, self.name)
        needed = {SHARE: 1, HISTOGRAM: len(self.values) + 1}.get(self.name, 0)
        if len(self.at) != needed or (self.name != HISTOGRAM and len(self.values) != 1) or not self.values:
            raise ValueError(f"{self} must be such as mean=0.5, share_above:2=0.1 or histogram:0,1,2=0.7,0.3")
        if list(self.at) != sorted(set(self.at)):
            raise ValueError(f"{self}: edges of bins must increase")

    @classmethod
    def of_text(cls, text: str) -> Wanted:
        """That of "mean=0.5", "share_above:2=0.1" or "histogram:0,1,2=0.7,0.3"; raises ValueError for other text."""
        left, _, right = text.partition("=")
        name, _, at = left.partition(":")
        try:
            values, places = (tuple(map(float, filter(None, part.split(",")))) for part in (right, at))
        except ValueError:
            raise ValueError(f"a value must be such as mean=0.5 or share_above:2=0.1, got {text!r}") from None
        return cls(name.strip(), values, places)

    def __str__(self) -> str:
        at = f":{','.join(f'{x:g}' for x in self.at)}" if self.at else ""
        return f"{self.name}{at}={','.join(f'{x:g}' for x in self.values)}"

    def of(self, field: LatticeField, box: Box | None) -> Array:
        """The same numbers (N,) of a field that is known."""
        if self.name == HISTOGRAM:
            return histogram(field, self.at, box).shares
        measured = getattr(statistics(field, box, self.at[0] if self.at else None), self.name)
        return np.array([measured.value])


@dataclass(frozen=True, eq=False)
class NumberResiduals:
    """Differences of an emulated field's numbers from `values` (N,), in their `errors` (N,): (B, N) at points (B, P)."""

    surrogate: Surrogate
    emulator: FieldEmulator
    wanted: tuple[Wanted, ...]
    box: Box | None
    values: Array  # [N]
    errors: Array  # [N]
    cameras: tuple[Camera, ...] = ()

    __repr__ = one_line

    @classmethod
    def of(
        cls, surrogate: Surrogate, wanted: Sequence[Wanted], field: str | None = None, box: Box | None = None
    ) -> NumberResiduals:
        """Of a field by name, by default the one that is drawn; numbers whose errors are not known yet count alike.

        Raises ValueError for no numbers, and a field that is not emulated.
        """
        if not wanted:
            raise ValueError("no value is wanted: say at least one, such as mean=0.5")
        if surrogate.field is None:
            raise ValueError("this surrogate has no emulated field, whose numbers are asked about")
        fields = surrogate.field.emulators
        name = field_of(surrogate.field.appearances[0]) if field is None else field
        if name not in (*fields, *fields.by_name):
            raise ValueError(f"no field {name!r} is emulated, only {joined_names(fields.by_name)}")
        values = np.array([value for one in wanted for value in one.values])
        return cls(surrogate, fields[name], tuple(wanted), box, values, np.ones(len(values)))

    @property
    def parameters(self) -> int:
        """The number P of parameters."""
        return len(self.surrogate.space)

    unknowns = parameters

    def __call__(self, points: Array) -> Array:
        return (np.concatenate(list(self._numbers(points))) - self.values) / self.errors

    def costs(self, points: Array) -> Array:
        """The mean squares (B,) of residuals."""
        return np.asarray((self(points) ** 2).mean(1))

    def learning(self, catalog: Catalog) -> NumberResiduals:
        """The same by an emulator that has not learnt from validation members."""
        return NumberResiduals.of(judged(self.surrogate, catalog), self.wanted, self.field, self.box)

    @property
    def field(self) -> str:
        """The name of the field."""
        fields = self.surrogate.field
        assert fields is not None
        return next(name for name, own in fields.emulators.emulators.items() if own is self.emulator)

    @cached_property
    def draft(self) -> NumberResiduals:
        """The same of the field on a coarse lattice."""
        return replace(self, emulator=thinned(self.emulator))

    def at_most(self, side: int) -> NumberResiduals:
        """Itself: numbers have no pixels."""
        return self

    def seen_from(self, cameras: Mapping[int, Camera]) -> NumberResiduals:
        """Itself: numbers are not seen."""
        return self

    def seen_by(self, point: Array) -> tuple[Camera, ...]:
        """No cameras."""
        return ()

    def of_field(self, values: NDArray[Any], holes: NDArray[np.bool_] | None) -> Array:
        """The numbers (N,) of a field (Z, Y, X) on the emulator's lattice, or as many samples over its box."""
        field = LatticeField(values, holes, self.emulator.spacing, self.emulator.origin)
        return np.concatenate([one.of(field, self.box) for one in self.wanted])

    def _numbers(self, points: Array) -> Any:
        for start in range(0, len(points), AT_ONCE):
            some = points[start : start + AT_ONCE]
            fields = zip(values_at(self.emulator, some), some, strict=True)
            yield np.stack([self.of_field(values, self.emulator.holes(point)) for values, point in fields])


def with_errors(
    residuals: NumberResiduals, catalog: Catalog, split: str
) -> tuple[NumberResiduals, list[NumberResiduals], list[Array]]:
    """(the same with the emulator's errors at members of a split, those of each member's own numbers, members' points (P,))."""
    space, name = residuals.surrogate.space, residuals.field
    points, numbers = [], []
    for member in (one for one in catalog.members if one.split == split):
        if (coarse := member.coarse_fields().get(name)) is None:
            continue
        holes = ~np.isfinite(coarse.values)
        points.append(space.normalize(space.values(member.parameters, outside="allow")))
        numbers.append(residuals.of_field(coarse.values, holes if holes.any() else None))
    if not numbers:
        return residuals, [], []
    truths = np.array(numbers)  # [M, N]
    expected = residuals(np.array(points)) * residuals.errors + residuals.values
    spread = np.maximum(truths.std(0), np.abs(truths).max(0) * LEAST)
    errors = np.maximum(np.sqrt(((expected - truths) ** 2).mean(0)), LEAST * spread) + np.finfo(float).tiny
    own = replace(residuals, errors=errors)
    return own, [replace(own, values=row) for row in truths], points
