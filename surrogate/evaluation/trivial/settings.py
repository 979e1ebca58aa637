"""Trivial predictors of a variation's unseen settings: mixtures of stored pictures of trained settings."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property, partial

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.distance import cdist

from catalogs.catalog import Catalog, Member
from catalogs.variations import Variation
from surrogate.evaluation.cases import Case
from surrogate.evaluation.predictor import Draw
from surrogate.evaluation.trivial.interpolation import Rule, Weights, linear, nearest_member

NEIGHBOURS = 4


@dataclass(frozen=True, eq=False)
class Trained:
    """What a variation was learnt from: names of S appearances and their places, as a network sees them.

    The base is one of them where it has a place, which it has among transfer functions but not among isovalues.
    """

    appearances: tuple[str, ...]
    places: NDArray[np.float64]  # [S, V]

    @classmethod
    def of(cls, variation: Variation, shown: Sequence[str] | None = None) -> Trained:
        """All trained settings, or those among the `shown` appearances."""
        values = {s.appearance: s.values for s in variation.settings if s.split == "train"}
        known = {name: variation.normalize(v) for name, v in values.items()}
        base = variation.normalize(None)
        if not np.isnan(base).any():
            known[variation.base] = base
        kept = [name for name in known if shown is None or name in shown]
        return cls(tuple(kept), np.array([known[name] for name in kept]).reshape(len(kept), len(variation.space)))

    def __len__(self) -> int:
        return len(self.appearances)

    def nearest(self, place: NDArray[np.float64]) -> str:
        """The appearance nearest to a place (V,)."""
        return self.appearances[int(nearest_member(self.places, place[None])[0].argmax())]


def inverse_distance(known: NDArray[np.float64], wanted: NDArray[np.float64]) -> Weights:
    """The `NEIGHBOURS` nearest, each by one over its distance; where one is met, that one alone."""
    distances = cdist(wanted, known)  # [T, M]
    order = np.argsort(distances, axis=1, kind="stable")[:, :NEIGHBOURS]  # [T, min(M, NEIGHBOURS)]
    weights = np.zeros_like(distances)
    for row, near, away in zip(weights, order, distances, strict=True):
        row[near] = 1.0 / away[near] if away[near[0]] > 0.0 else np.eye(len(near))[0]
    return np.asarray(weights / weights.sum(axis=1, keepdims=True), dtype=np.float64)


def setting_rules(variation: Variation) -> list[Rule]:
    """Rules from the trained settings that a member shows to weights of their pictures."""
    found = [Rule("nearest trained setting", nearest_member)]
    if len(variation.space) == 1:
        return [*found, Rule(f"linear interpolation of {variation.plural}", linear)]
    return [*found, Rule(f"inverse distances to the {NEIGHBOURS} nearest settings", inverse_distance)]


@dataclass(frozen=True, eq=False)
class SettingMixtures:
    """Predicts a setting by a weighted sum of the same member's stored pictures, at the same view, of trained settings.

    It predicts none of the simulation's parameters, and leaves out members that show no trained setting.
    """

    catalog: Catalog
    variation: Variation

    @cached_property
    def rules(self) -> list[Rule]:
        """One for each picture."""
        return setting_rules(self.variation)

    @property
    def names(self) -> list[str]:
        """See `Predictor`."""
        return [rule.name for rule in self.rules]

    def batches(self, cases: Sequence[Case]) -> Iterator[tuple[Sequence[Case], Draw]]:
        """See `Predictor`."""
        batches: dict[tuple[str, str], list[Case]] = {}
        for case in cases:
            batches.setdefault((case.member.name, case.appearance), []).append(case)
        for batch in batches.values():
            trained = self.shown(batch[0].member)
            if len(trained):
                wanted = place_of(batch[0], self.variation)[None]  # [1, V]
                weights = np.concatenate([rule.weights(trained.places, wanted) for rule in self.rules])  # [K, S]
                yield batch, partial(self._mixed, trained.appearances, weights)

    def shown(self, member: Member) -> Trained:
        """The trained settings that a member shows."""
        return Trained.of(self.variation, member.appearances)

    def _mixed(self, appearances: Sequence[str], weights: Weights, case: Case) -> NDArray[np.float32]:
        """Pictures (K, H, W, 4) of weights (K, S)."""
        used = np.flatnonzero(weights.any(axis=0)).tolist()
        load = partial(self.catalog.image, case.member, view=case.view, dtype="float32")
        pictures = np.stack([load(appearances[i]) for i in used])
        return np.clip(np.tensordot(weights[:, used].astype(np.float32), pictures, axes=1), 0.0, 1.0)


def place_of(case: Case, variation: Variation) -> NDArray[np.float64]:
    """The visualization parameters (V,) of a case as a network sees them."""
    return variation.normalize(variation.values_of(case.varied))
