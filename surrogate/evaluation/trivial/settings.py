"""Trivial predictors of unseen settings of a variation: mixtures of stored pictures of trained ones, same member and view.

They need a member that was rendered with trained settings, so they predict none of the simulation's parameters.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.distance import cdist

from catalogs.catalog import Catalog, Member
from catalogs.variations import Variation
from surrogate.evaluation.trivial.interpolation import Predictor, Weights, linear, nearest_member

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


def setting_predictors(variation: Variation) -> list[Predictor]:
    """Rules from the trained settings that a member shows to weights of their pictures."""
    found = [Predictor("nearest trained setting", nearest_member)]
    if len(variation.space) == 1:
        return [*found, Predictor(f"linear interpolation of {variation.plural}", linear)]
    return [*found, Predictor(f"inverse distances to the {NEIGHBOURS} nearest settings", inverse_distance)]


def mixtures(
    catalog: Catalog,
    trained: Trained,
    member: Member,
    view: int,
    wanted: NDArray[np.float64],
    predictors: Sequence[Predictor],
) -> list[NDArray[np.float32]]:
    """Premultiplied RGBA (H, W, 4) by each predictor for the setting at `wanted` (V,); `trained` is what the member shows of it."""
    weights = np.concatenate([p.weights(trained.places, wanted[None]) for p in predictors])  # [K, S]
    used = np.flatnonzero(weights.any(axis=0))
    pictures = np.stack([catalog.image(member, trained.appearances[i], view, dtype="float32") for i in used])
    mixed = np.tensordot(weights[:, used].astype(np.float32), pictures, axes=1)  # [K, H, W, 4]
    return list(np.clip(mixed, 0.0, 1.0))
