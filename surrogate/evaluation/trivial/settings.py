"""The trained settings of a variation, and their stored images."""

from __future__ import annotations

from collections.abc import Hashable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from catalogs.store.catalog import Member
from catalogs.vocabulary.parameters import ParameterSpace
from catalogs.vocabulary.variations import Variation
from surrogate.evaluation.cases import Case
from surrogate.evaluation.trivial.interpolation import nearest_member
from surrogate.evaluation.trivial.mixtures import MemberPictures


@dataclass(frozen=True, eq=False)
class TrainedSettings:
    """The trained settings: names of S appearances, and their visualization parameters as network inputs.

    The base is included where it has such parameters: among transfer functions, but not among isovalues.
    """

    appearances: tuple[str, ...]
    places: NDArray[np.float64]  # [S, V]

    @classmethod
    def of(cls, variation: Variation) -> TrainedSettings:
        """All trained settings."""
        settings = {s.appearance: variation.normalize(s.values) for s in variation.settings if s.split == "train"}
        base = variation.normalize(None)
        if not np.isnan(base).any():
            settings[variation.base] = base
        return cls(tuple(settings), np.array(list(settings.values())))

    def among(self, appearances: Sequence[str]) -> TrainedSettings:
        """The settings that are among `appearances`."""
        indices = [i for i, name in enumerate(self.appearances) if name in appearances]
        return TrainedSettings(tuple(self.appearances[i] for i in indices), self.places[indices])

    def __len__(self) -> int:
        return len(self.appearances)

    def nearest(self, place: NDArray[np.float64]) -> str:
        """The appearance nearest to a place (V,)."""
        return self.appearances[int(nearest_member(self.places, place[None])[0].argmax())]


@dataclass(frozen=True, eq=False)
class TrainedPictures:
    """Images of training members under all trained settings.

    They predict unseen members under unseen settings without any image of these members.

    Attributes
    ----------
    pictures : images of the training members that have all trained settings.
    """

    variation: Variation
    pictures: MemberPictures

    @classmethod
    def of(cls, variation: Variation, space: ParameterSpace, members: Sequence[Member]) -> TrainedPictures | None:
        """The images of `members`; None where no training member has all trained settings."""
        trained = set(TrainedSettings.of(variation).appearances)
        whole = [m for m in members if m.split == "train" and trained <= set(m.appearances)]
        return cls(variation, MemberPictures(space, variation.base, whole)) if whole else None

    @cached_property
    def trained(self) -> TrainedSettings:
        """All of the variation's."""
        return TrainedSettings.of(self.variation)

    def key(self, case: Case) -> Hashable:
        """See `Sources`."""
        return self.pictures.key(case)

    def images_for(self, case: Case) -> list[tuple[Member, str, int]]:
        """See `Sources`: member by member, all settings of each."""
        of_members = self.pictures.images_for(case)
        return [(member, name, view) for member, _, view in of_members for name in self.trained.appearances]

    def points(self, case: Case) -> NDArray[np.float64]:
        """See `Sources`: normalized simulation and visualization parameters."""
        members, settings = self.pictures.points(case), self.trained.places  # [A, P], [S, V]
        return np.concatenate([members.repeat(len(settings), axis=0), np.tile(settings, (len(members), 1))], axis=1)

    def place(self, case: Case) -> NDArray[np.float64]:
        """See `Sources`."""
        setting = self.variation.normalize(self.variation.values_of(case.varied))
        return np.concatenate([self.pictures.place(case), setting])


@dataclass(frozen=True, eq=False)
class SettingPictures:
    """Images of the same member under trained settings, for unseen settings; simulation parameters stay the same."""

    variation: Variation

    @cached_property
    def trained(self) -> TrainedSettings:
        """All of the variation's."""
        return TrainedSettings.of(self.variation)

    def key(self, case: Case) -> Hashable:
        """See `Sources`."""
        return case.member.name, case.view

    def images_for(self, case: Case) -> list[tuple[Member, str, int]]:
        """See `Sources`; empty for a member without trained settings."""
        return [(case.member, name, case.view) for name in self.trained_in(case.member).appearances]

    def points(self, case: Case) -> NDArray[np.float64]:
        """See `Sources`: visualization parameters as network inputs."""
        return self.trained_in(case.member).places

    def place(self, case: Case) -> NDArray[np.float64]:
        """See `Sources`."""
        return self.variation.normalize(self.variation.values_of(case.varied))

    def trained_in(self, member: Member) -> TrainedSettings:
        """The trained settings that a member has."""
        return self.trained.among(member.appearances)
