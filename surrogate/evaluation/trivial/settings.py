"""The trained settings of a variation: which there are, and their stored pictures."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from catalogs.catalog import Member
from catalogs.variations import Variation
from surrogate.evaluation.cases import Case
from surrogate.evaluation.trivial.interpolation import nearest_member


@dataclass(frozen=True, eq=False)
class Trained:
    """The trained settings: names of S appearances, and their visualization parameters as a network sees them.

    The base is one of them where it has such parameters: among transfer functions, but not among isovalues.
    """

    appearances: tuple[str, ...]
    places: NDArray[np.float64]  # [S, V]

    @classmethod
    def of(cls, variation: Variation) -> Trained:
        """All trained settings."""
        known = {s.appearance: variation.normalize(s.values) for s in variation.settings if s.split == "train"}
        base = variation.normalize(None)
        if not np.isnan(base).any():
            known[variation.base] = base
        return cls(tuple(known), np.array(list(known.values())))

    def among(self, appearances: Sequence[str]) -> Trained:
        """The settings that are among `appearances`."""
        kept = [i for i, name in enumerate(self.appearances) if name in appearances]
        return Trained(tuple(self.appearances[i] for i in kept), self.places[kept])

    def __len__(self) -> int:
        return len(self.appearances)

    def nearest(self, place: NDArray[np.float64]) -> str:
        """The appearance nearest to a place (V,)."""
        return self.appearances[int(nearest_member(self.places, place[None])[0].argmax())]


@dataclass(frozen=True, eq=False)
class SettingPictures:
    """Pictures of the same member under trained settings, for unseen ones; they predict none of the simulation's parameters."""

    variation: Variation

    @cached_property
    def trained(self) -> Trained:
        """All of the variation's."""
        return Trained.of(self.variation)

    def stored(self, case: Case) -> list[tuple[Member, str, int]]:
        """See `Sources`; none of a member that shows no trained setting."""
        return [(case.member, name, case.view) for name in self.shown(case.member).appearances]

    def points(self, case: Case) -> NDArray[np.float64]:
        """See `Sources`: visualization parameters as a network sees them."""
        return self.shown(case.member).places

    def place(self, case: Case) -> NDArray[np.float64]:
        """See `Sources`."""
        return self.variation.normalize(self.variation.values_of(case.varied))

    def shown(self, member: Member) -> Trained:
        """The trained settings that a member shows."""
        return self.trained.among(member.appearances)
