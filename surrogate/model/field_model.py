"""An ensemble as an emulator of its fields, which draws any appearance of them."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from catalogs.store.catalog import Catalog
from catalogs.vocabulary import numbers
from catalogs.vocabulary.appearance import (
    Appearance,
    Isosurface,
    TransferFunction,
    VolumeRendering,
    appearance_from_json,
    appearance_to_json,
    field_of,
)
from catalogs.vocabulary.parameters import ParameterSpace
from catalogs.vocabulary.variations import Variation, variation_from_json
from catalogs.vocabulary.words import joined_names, one_line
from surrogate.appearance.scale import ValueScale
from surrogate.emulation import EmulatedField, EmulatedFields
from surrogate.gaussians import Normalization
from surrogate.model.emulated_member import EmulatedMember
from surrogate.model.places import separated
from surrogate.storage import models
from surrogate.storage.models import part

FOLDER = "field"


def scales_of(appearances: Sequence[Appearance]) -> dict[str, ValueScale]:
    """The scales on which appearances show fields, by field; the first appearance of a field counts."""
    volumes = [a for a in reversed(appearances) if isinstance(a, VolumeRendering)]
    return {field_of(a): ValueScale.of_function(a.transfer_function) for a in volumes}


@dataclass(frozen=True, eq=False)
class FieldPoint:
    """Parameters of one member, and the appearance of its field there.

    Attributes
    ----------
    parameters : by name, in their units.
    simulation : (P,) normalized.
    warnings : a sentence about each parameter that is out of bounds.
    sample_distance : along rays through a volume, world units; None for what the appearance needs.
    """

    parameters: Mapping[str, float | str]
    simulation: NDArray[np.float64]  # [P]
    appearance: VolumeRendering | Isosurface
    warnings: tuple[str, ...] = ()
    sample_distance: float | None = None

    __repr__ = one_line


@dataclass(frozen=True, eq=False)
class FieldModel:
    """An emulator of the coarse fields that a catalog keeps.

    Attributes
    ----------
    emulators : of each field, functions of the parameters of their `space`.
    appearances : those that can be drawn, the base first.
    variations : of the base.
    sample_distances : along rays, world units, by volume rendering: those that the catalog's images were rendered with.
    training : how it came to be: `seconds`, `processor_seconds`, `fingerprint`, `appearance`, `settings`, `splits`.
    """

    emulators: EmulatedFields
    appearances: tuple[Appearance, ...]
    variations: tuple[Variation, ...]
    normalization: Normalization
    background: tuple[float, float, float] | None = None
    sample_distances: Mapping[str, float] = field(default_factory=dict)
    training: Mapping[str, Any] = field(default_factory=dict)

    __repr__ = one_line

    @property
    def space(self) -> ParameterSpace:
        """The parameters' names, units and bounds."""
        return self.emulators.space

    @property
    def splits(self) -> tuple[str, ...]:
        """The splits whose members it has learnt from."""
        return tuple(self.training.get("splits", ("train",)))

    def learning(self, catalog: Catalog, splits: Sequence[str]) -> FieldModel:
        """The same fitted to the members of some splits, itself where it was; raises ValueError where these lack its fields."""
        if set(splits) == set(self.splits):
            return self
        emulators = EmulatedFields.fit(catalog, scales_of(self.appearances), splits, required=self.emulators)
        if lacking := set(self.emulators) - set(emulators):
            raise ValueError(f"{catalog.path} no longer keeps the coarse fields {joined_names(sorted(lacking))}")
        return replace(self, emulators=emulators, training={**self.training, "splits": list(splits)})

    def point(
        self, parameters: Mapping[str, Any], outside: Any, function: TransferFunction | None = None
    ) -> FieldPoint:
        """The place of parameters as `Surrogate.at` takes them, or of the simulation's alone under any transfer function.

        Raises ValueError as `Surrogate.at` does.
        """
        variations = () if function is not None else self.variations
        place, varied = separated(self.space, variations, parameters, outside)
        appearance = self.appearances[0]
        if varied is not None:
            appearance = self.variations[varied.number].appearance_at(varied.values, self.appearances)
        if function is not None and isinstance(appearance, VolumeRendering):
            appearance = replace(appearance, transfer_function=function)
        elif function is not None:
            raise ValueError(f"{appearance.name} is drawn by isosurfaces, which have no transfer function")
        if not isinstance(appearance, VolumeRendering | Isosurface):
            raise ValueError(f"appearance {appearance.name} can't be drawn from the emulated field")
        names = place.parameters if varied is None else {**place.parameters, **varied.parameters}
        warnings = place.warnings + (() if varied is None else varied.warnings)
        distance = None if function is not None else self.sample_distances.get(appearance.name)
        return FieldPoint(names, place.simulation, appearance, warnings, distance)

    def member(self, point: FieldPoint) -> EmulatedMember:
        """The ensemble there."""
        name = field_of(point.appearance)
        return EmulatedMember(
            self.emulators[name],
            point.simulation,
            point.appearance,
            point.parameters,
            self.normalization,
            point.sample_distance,
            self.emulators.quantity(name),
        )

    def fields(self, parameters: Mapping[str, Any], named: Sequence[str] = ()) -> list[EmulatedField]:
        """All fields at the simulation's parameters, or those `named`, by themselves or by appearances that show them.

        Raises ValueError for unknown names, and for parameters as `point` does.
        """
        place, _ = separated(self.space, (), parameters, "allow")
        return [self.emulators.field(name, place.simulation) for name in self._named(named)]

    def labels(self, named: Sequence[str] = ()) -> list[str]:
        """Names and units of the same fields."""
        return [str(self.emulators.quantity(name)) or "the field" for name in self._named(named)]

    def _named(self, named: Sequence[str]) -> list[str]:
        fields = {a.name: field_of(a) for a in self.appearances} | self.emulators.by_name
        if unknown := [name for name in named if name not in fields]:
            names = joined_names(filter(None, fields))
            raise ValueError(f"no field of {joined_names(unknown)} is emulated, only of {names}")
        return list(dict.fromkeys(fields[name] for name in named) or self.emulators)

    @property
    def megabytes(self) -> float:
        """Size of the stored tensors, 10^6 bytes."""
        return self.emulators.megabytes

    @cached_property
    def digest(self) -> str:
        """A SHA-256 over all that is stored of it."""
        return self._stored_form().digest

    @staticmethod
    def exists(directory: str | os.PathLike[str]) -> bool:
        """True where a surrogate's `directory` holds one."""
        return models.exists(Path(directory) / FOLDER)

    @staticmethod
    def fingerprint(directory: str | os.PathLike[str]) -> str | None:
        """That of the run of which `directory` holds one, from its record alone; raises as `load` does."""
        folder = Path(directory) / FOLDER
        record = models.read_record(folder)
        with models.damaged(str(folder)), part("training"):
            return record["training"].get("fingerprint")

    def save(self, directory: str | os.PathLike[str]) -> None:
        """Write it into a folder of its own in a surrogate's `directory`; see `StoredModel.save`."""
        self._stored_form().save(Path(directory) / FOLDER)

    @classmethod
    def load(cls, directory: str | os.PathLike[str]) -> FieldModel:
        """The one in a surrogate's `directory`; raises as `models.load` does."""
        return models.load(Path(directory) / FOLDER, cls._of_stored)

    @classmethod
    def of_bytes(cls, tensors: bytes, record: bytes) -> FieldModel:
        """The one whose two files hold these bytes; raises ValueError as `load` does."""
        return models.of_contents(tensors, record, cls._of_stored)

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickles, copies and what goes to other processes hold the bytes that `save` writes."""
        return type(self).of_bytes, self._stored_form().contents()

    def _stored_form(self) -> models.StoredModel:
        emulators = self.emulators.stored_form()
        own = {
            "appearances": [appearance_to_json(a) for a in self.appearances],
            "variations": [v.to_json() for v in self.variations],
            "normalization": self.normalization.to_json(),
            "background": self.background,
            "sample_distances": dict(self.sample_distances),
            "training": dict(self.training),
        }
        return replace(emulators, record={**emulators.record, **own})

    @classmethod
    def _of_stored(cls, model: models.StoredModel) -> FieldModel:
        record, emulators = model.record, EmulatedFields.of_stored(model)
        with part("appearances"):
            appearances = tuple(appearance_from_json(values, missing=True) for values in record["appearances"])
            missing = {field_of(a) for a in appearances} - set(emulators)
            if not appearances or missing:
                raise ValueError(f"each must show one of the fields {sorted(emulators)}, got {sorted(missing)}")
        with part("variations"):
            variations = tuple(variation_from_json(values) for values in record["variations"])
        with part("normalization"):
            normalization = Normalization.from_json(record["normalization"])
        with part("background"):
            color = record["background"]
            red, green, blue = (0.0, 0.0, 0.0) if color is None else numbers.color(color, "background")
            background = None if color is None else (red, green, blue)
        with part("sample_distances"):
            distances = {str(name): numbers.positive(d, "each") for name, d in record["sample_distances"].items()}
        with part("training"):
            if not isinstance(record["training"], dict):
                raise ValueError(f"it must be an object, got {type(record['training']).__name__}")
        return cls(emulators, appearances, variations, normalization, background, distances, record["training"])
