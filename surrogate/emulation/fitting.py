"""From members' fields to the parts of an emulator: components, processes, and errors of members that were left out."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from catalogs.vocabulary.words import one_line
from surrogate.appearance.scale import ValueScale
from surrogate.emulation import storage
from surrogate.emulation.components import Array, Components, products_of
from surrogate.emulation.processes import Processes
from surrogate.emulation.validation import TINY, LeftOut, needed, residual_of

FEWEST = 3  # members
FARTHEST = 8.0  # samples from a hole's surface, beyond which distances say nothing
COMPARED = 8_192  # samples at which the scale is chosen, errors are measured and standard deviations are made to hold
MEASURED, OCTANTS = 4_096, 8  # of them at which numbers are made to hold, in parts of the box
CLEARLY = 0.01  # of the squared error, by which a scale must predict better than the field's unit
ROUNDED = 1e-3  # of what fields span, by which 32 bits may round values: less is not seen, 66 dB
SEED = 0


@dataclass(frozen=True, eq=False)
class Members:
    """An ensemble's fields, checked, with holes filled.

    Attributes
    ----------
    points : (M, P), normalized parameters.
    fields : (M, V), finite: in holes the mean of the members that have a value there.
    shape : (Z, Y, X).
    solid : (V,) bool, holes in all members; None where there are none.
    distances : (M, Z, Y, X) signed distances to holes in samples, negative in them; None where they do not move.
    """

    points: Array  # [M, P]
    fields: NDArray[np.float32]  # [M, V]
    shape: tuple[int, int, int]
    solid: NDArray[np.bool_] | None = None  # [V]
    distances: NDArray[np.float32] | None = None  # [M, Z, Y, X]

    __repr__ = one_line

    @classmethod
    def of(cls, points: ArrayLike, fields: ArrayLike) -> Members:
        """Of fields (M, Z, Y, X) with NaN in holes at points (M, P); raises ValueError naming what is wrong."""
        places = np.asarray(points, dtype=np.float64)
        values = np.asarray(fields, dtype=np.float32)
        if values.ndim != 4 or 0 in values.shape[1:]:
            raise ValueError(f"fields must be an array [member, z, y, x], got one of shape {list(values.shape)}")
        if places.ndim != 2 or len(places) != len(values) or not np.isfinite(places).all():
            raise ValueError(
                f"points must be finite, one row for each of the {len(values)} fields, got shape {list(places.shape)}"
            )
        if len(values) < FEWEST:
            raise ValueError(f"an emulator needs {FEWEST} members or more to learn from, got {len(values)}")
        flat = values.reshape(len(values), -1)  # [M, V]
        if len(infinite := np.flatnonzero(np.isinf(flat).any(1))):
            raise ValueError(f"the field of member {infinite[0]} has infinite values: NaN says that there are none")
        _check_rounding(np.asarray(fields), values)
        shape = (values.shape[1], values.shape[2], values.shape[3])
        holes = np.isnan(flat)  # [M, V]
        if not holes.any():
            return cls(places, flat, shape)
        if len(empty := np.flatnonzero(holes.all(1))):
            raise ValueError(f"the field of member {empty[0]} has no values at all: leave it out")
        solid = np.asarray(holes.all(0))  # [V]
        counts = np.maximum((~holes).sum(0), 1)
        filled = np.where(holes, np.nansum(flat, axis=0, dtype=np.float64) / counts, flat).astype(np.float32)
        moving = bool((holes != solid).any())
        distances = np.stack([_distances(h.reshape(shape)) for h in holes]) if moving else None
        return cls(places, filled, shape, solid if solid.any() else None, distances)

    def about_mean(self, scale: ValueScale | None) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """The mean (V,) of the members' values, in their unit or on a scale, and what each differs by (M, V)."""
        scaled = self.fields
        if scale is not None:
            scaled = np.stack([scale.places(values).astype(np.float32) for values in self.fields])
        mean = scaled.mean(0, dtype=np.float64).astype(np.float32)
        return mean, scaled - mean


def fit(members: Members, scale: ValueScale | None) -> dict[str, Any]:
    """The fitted parts of an emulator, by the names of its fields."""
    voxels = np.arange(members.fields.shape[1]) if members.solid is None else np.flatnonzero(~members.solid)
    places = np.sort(np.random.default_rng(SEED).permutation(voxels)[:COMPARED])
    fitted = _Fit.of(members, None)
    if scale is not None:
        other = _Fit.of(members, scale)
        errors = [one.error(members.fields[:, places], places, scale) for one in (fitted, other)]
        fitted = other if errors[1] < errors[0] - np.log1p(CLEARLY) else fitted
    return fitted.parts(members, places)


@dataclass(frozen=True, eq=False)
class _Fit:
    """Components and processes on one scale."""

    scale: ValueScale | None
    mean: NDArray[np.float32]  # [V]
    differences: NDArray[np.float32]  # [M, V]
    products: Array  # [M, M]
    components: Components
    processes: Processes  # through all J coefficients
    count: int  # of components that are kept

    @classmethod
    def of(cls, members: Members, scale: ValueScale | None) -> _Fit:
        mean, differences = members.about_mean(scale)
        products = products_of(differences)
        components = Components.of(products)
        processes = Processes.fit(members.points, components.coefficients)
        count = needed(components.coefficients, processes.left_out())
        return cls(scale, mean, differences, products, components, processes, count)

    def error(self, truth: NDArray[np.float32], places: NDArray[np.int64], scale: ValueScale) -> float:
        """The mean logarithm of the members' squared leave-one-out errors on a scale, at some places of their fields."""
        modes = self.components.combinations.T @ self.differences[:, places]  # [J, N]
        predicted = self.mean[places] + (self.components.coefficients - self.processes.left_out()) @ modes  # [M, N]
        values = predicted if self.scale is None else self.scale.values(predicted)
        squares = ((scale.places(values) - scale.places(truth)) ** 2).mean(1)  # [M]
        return float(np.log(squares + TINY).mean())

    def parts(self, members: Members, places: NDArray[np.int64]) -> dict[str, Any]:
        """Those of the emulator; standard deviations are made to hold at `places`."""
        combinations = self.components.combinations[:, : self.count]  # [M, K]
        left_out = LeftOut.of(members.points, self.products, self.processes, self.count)
        tails = left_out.tails(self.products, combinations)
        residual = residual_of(tails, self.differences)
        modes = combinations.T.astype(np.float32) @ self.differences  # [K, V]
        processes = storage.rounded(self.processes.first(self.count))
        error = float(np.exp(np.log(left_out.squared(self.products) / len(self.mean) + np.finfo(float).tiny).mean()))
        strengths = (processes.coefficients**2).mean(0)  # [K]
        differences = self.differences[:, places].astype(np.float64)  # [M, N]
        factor = left_out.factor(differences, tails)
        parts = _parts_of_box(places, members.shape)  # [B, N]
        number_factors = left_out.number_factors(self.mean[parts], self.differences[:, parts], factor, self.scale)
        encodings = storage.encodings_of(self.mean, modes, residual, members.solid, strengths, error, factor)
        predicted = self.mean[places] + (np.eye(len(differences)) - left_out.remainders) @ differences
        truth = members.fields[:, places].astype(np.float64)
        missed = (predicted if self.scale is None else self.scale.values(predicted)) - truth
        return {
            "processes": processes,
            **storage.decoded(encodings),
            "factor": factor,
            "number_factors": number_factors,
            "errors": np.sqrt((missed**2).mean(1)).astype(np.float32).astype(np.float64),
            "spread": float(members.fields[:, places].std(dtype=np.float64)),
            "scale": self.scale,
            "encodings": encodings,
        }


def _parts_of_box(places: NDArray[np.int64], shape: tuple[int, int, int]) -> NDArray[np.int64]:
    """Some of the places (V,) of a field of a shape, those of each of its octants, as far as it has them, in a row (B, N)."""
    some = np.random.default_rng(SEED).permutation(places)[:MEASURED]
    halves = [2 * indices >= side for indices, side in zip(np.unravel_index(some, shape), shape, strict=True)]
    ordered = some[np.lexsort(halves)]
    parts = min(OCTANTS, len(ordered))
    return ordered[: len(ordered) // parts * parts].reshape(parts, -1)


def _check_rounding(fields: NDArray[np.floating], rounded: NDArray[np.float32]) -> None:
    """Raise ValueError for fields that span less than float32 tells apart about their values."""
    if fields.dtype == np.float32 or np.isnan(fields).all():
        return
    low, high = float(np.nanmin(fields)), float(np.nanmax(fields))
    if np.spacing(np.nanmax(np.abs(rounded))) > ROUNDED * (high - low) > 0.0:
        middle = 0.5 * (low + high)
        raise ValueError(
            f"the fields span {high - low:.3g} about {middle!r}, which numbers of 32 bits hardly tell apart: take {middle:g} from "
            "the field and from the values of its appearances"
        )


def _distances(holes: NDArray[np.bool_]) -> NDArray[np.float32]:
    """Signed distances (Z, Y, X) in samples to the surface of holes, negative inside, at most `FARTHEST`."""
    if not holes.any():
        return np.full(holes.shape, FARTHEST, np.float32)
    from scipy.ndimage import distance_transform_edt  # slow to load

    inside, outside = distance_transform_edt(holes), distance_transform_edt(~holes)
    signed = np.where(holes, 0.5 - inside, outside - 0.5)
    return np.clip(signed, -FARTHEST, FARTHEST).astype(np.float32)
