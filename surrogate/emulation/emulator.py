"""An emulator of one field: its values at any parameters, with their uncertainty, from an ensemble's members."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from torch import Tensor

from catalogs.vocabulary.words import plural
from surrogate.appearance.scale import ValueScale
from surrogate.emulation import fitting, storage
from surrogate.emulation.corners import Corners, Vector, vector
from surrogate.emulation.field import EmulatedField
from surrogate.emulation.posterior import Posterior
from surrogate.emulation.processes import Processes
from surrogate.storage import models
from surrogate.storage.encoding import Encoding

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class FieldEmulator:
    """Principal components of the members' fields, and a Gaussian process through the coefficients of each.

    Attributes
    ----------
    processes : through the members' K coefficients, functions of normalized parameters.
    mean : (V,) of the members, on the modelled scale; V samples in the order [z, y, x].
    modes : (K, V), components.
    residual : (V,) standard deviations of what no mode expresses.
    factor : on standard deviations, so that 90 % intervals hold for members that were left out.
    errors : (M,) root mean square error of each member's field, predicted without it, in the field's unit.
    spread : standard deviation of all values of the members, in the field's unit.
    shape : (Z, Y, X).
    spacing, origin : (x, y, z), in world units.
    scale : that is modelled; None: the field's unit.
    solid : (V,) bool, samples that are holes in all members; None where there are none.
    outline : of the signed distance to holes in samples, negative in holes; None where they do not move.
    encodings : of tensors that are stored in fewer bits, by name.
    number_factors : on standard deviations of a box's numbers, by name, which likewise make intervals hold.

    Examples
    --------
    >>> import numpy as np
    >>> from blobs import PLACE, simulate
    >>> from surrogate.emulation import FieldEmulator
    >>> separations = np.linspace(0.6, 1.0, 6)
    >>> emulator = FieldEmulator.fit([[p] for p in np.linspace(-1, 1, 6)], [simulate(s, 0.3) for s in separations], **PLACE)
    >>> float(np.abs(emulator.at([0.1]).values - simulate(0.82, 0.3)).max()) < 0.01
    True
    """

    processes: Processes
    mean: NDArray[np.float32]  # [V]
    modes: NDArray[np.float32]  # [K, V]
    residual: NDArray[np.float32]  # [V]
    factor: float
    errors: Array  # [M]
    spread: float
    shape: tuple[int, int, int]
    spacing: Vector
    origin: Vector
    scale: ValueScale | None = None
    solid: NDArray[np.bool_] | None = None  # [V]
    outline: FieldEmulator | None = None
    encodings: Mapping[str, Encoding] = field(default_factory=dict)
    number_factors: Mapping[str, float] = field(default_factory=dict)

    @classmethod
    def fit(
        cls,
        points: ArrayLike,
        fields: ArrayLike,
        spacing: Vector,
        origin: Vector,
        scale: ValueScale | None = None,
    ) -> FieldEmulator:
        """The emulator of M members' fields (M, Z, Y, X), NaN in holes, at points (M, P): parameters normalized to [-1, 1].

        Values are modelled in their unit or on `scale`, by leave-one-out errors on `scale`.  Raises ValueError naming what is
        wrong with the fields or the points.
        """
        members = fitting.Members.of(points, fields)
        outline = None
        if members.distances is not None:
            outline = cls.fit(members.points, members.distances, spacing, origin)
        fitted = fitting.fit(members, scale)
        return cls(
            **fitted,
            shape=members.shape,
            spacing=vector(spacing, "spacing"),
            origin=vector(origin, "origin"),
            solid=members.solid,
            outline=outline,
        )

    def save(self, directory: str | os.PathLike[str]) -> None:
        """Write `model.safetensors`, then `model.json`, which makes it an emulator, into `directory`."""
        tensors, record, encodings = storage.stored_form(self)
        models.StoredModel(tensors, {"schema": models.SCHEMA, **record}, encodings).save(directory)

    @classmethod
    def load(cls, directory: str | os.PathLike[str]) -> FieldEmulator:
        """The emulator that was saved into `directory`; the folder may come from anyone, for nothing in it is run.

        Raises FileNotFoundError where there is none, ValueError for one of a newer schema and, naming the part, for one that is
        damaged.
        """
        return models.load(directory, lambda model: cls.of_stored(model.tensors, model.record, model.encodings))

    @classmethod
    def of_stored(
        cls, tensors: Mapping[str, Tensor], record: Mapping[str, Any], encodings: Mapping[str, Encoding]
    ) -> FieldEmulator:
        """The emulator of which `storage.stored_form` gave these; raises ValueError naming the part that is damaged."""
        parts = storage.parts_of(tensors, record, encodings)
        outline = storage.outline_of(tensors, record, encodings)
        if outline is not None:
            with models.part(storage.OUTLINE):
                parts["outline"] = cls.of_stored(*outline)
        return cls(**parts)

    @property
    def megabytes(self) -> float:
        """Size of the stored tensors, 10^6 bytes."""
        tensors, record, encodings = storage.stored_form(self)
        return models.StoredModel(tensors, record, encodings).megabytes

    def __repr__(self) -> str:
        z, y, x = self.shape
        relative = f", left-out error {self.relative_error:.3f}" if np.isfinite(self.relative_error) else ""
        return (
            f"<FieldEmulator of {plural(len(self.processes.points), 'member')}, {x} x {y} x {z}: "
            f"{plural(len(self.modes), 'mode')}{relative}>"
        )

    @property
    def relative_error(self) -> float:
        """The mean of the members' errors over the spread of the values; NaN where values do not spread."""
        return float(self.errors.mean() / self.spread) if self.spread > 0.0 else float("nan")

    def at(self, point: ArrayLike) -> EmulatedField:
        """The field at normalized parameters (P,)."""
        posterior = self.posterior(point)
        values = posterior.values().reshape(self.shape)
        return EmulatedField(values, self.holes(point), self.spacing, self.origin, posterior)

    def posterior(self, point: ArrayLike) -> Posterior:
        """The distribution of fields at normalized parameters (P,)."""
        means, spreads = self.processes.predict(self._checked(point)[None])
        distribution = means[0], spreads[0] * self.factor
        return Posterior(self.mean, self.modes, self._residual, self.scale, *distribution, self.number_factors)

    def holes(self, point: ArrayLike) -> NDArray[np.bool_] | None:
        """The holes (Z, Y, X) at normalized parameters (P,); None where there are none."""
        solid = None if self.solid is None else self.solid.reshape(self.shape)
        if self.outline is None:
            return solid
        moving = self.outline.at(point).values < 0.0  # [Z, Y, X]
        return moving if solid is None else moving | solid

    def sample(self, point: ArrayLike, places: ArrayLike) -> tuple[Array, Array]:
        """Values and standard deviations (N,) at world places (N, 3), trilinear; NaN beside holes and outside the box."""
        corners = Corners.of(places, self.shape, self.spacing, self.origin)
        holes = self.holes(point)
        return self.posterior(point).sample(corners, None if holes is None else holes.ravel())

    def derivative(self, point: ArrayLike) -> NDArray[np.float32]:
        """Derivatives (P, Z, Y, X) of the field by each normalized parameter, in the field's unit."""
        checked = self._checked(point)
        slopes = self.processes.derivative(checked).astype(np.float32) @ self.modes  # [P, V]
        if self.scale is not None:
            means, _ = self.processes.predict(checked[None])
            slopes *= self.scale.slopes(self.mean + means[0].astype(np.float32) @ self.modes)
        return slopes.reshape(-1, *self.shape)

    @cached_property
    def _residual(self) -> NDArray[np.float32]:
        return self.residual * np.float32(self.factor)

    def _checked(self, point: ArrayLike) -> Array:
        count = self.processes.points.shape[1]
        try:
            values = np.asarray(point, dtype=np.float64)
        except (TypeError, ValueError):
            values = np.full(count, np.nan)
        if values.shape != (count,) or not np.isfinite(values).all():
            raise ValueError(f"a point must be {count} finite numbers, normalized parameters, got {point!r}")
        return values
