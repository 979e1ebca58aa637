"""The emulators of all fields of a catalog, in one folder."""

from __future__ import annotations

import os
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from catalogs.store.catalog import Catalog
from catalogs.store.coarse import CoarseField
from catalogs.store.members import Member
from catalogs.vocabulary.parameters import ParameterSpace
from catalogs.vocabulary.quantity import Quantity
from catalogs.vocabulary.words import joined_names
from surrogate.appearance.scale import ValueScale
from surrogate.emulation import storage
from surrogate.emulation.emulator import FieldEmulator
from surrogate.emulation.field import EmulatedField
from surrogate.emulation.fitting import FEWEST
from surrogate.storage import models
from surrogate.storage.names import joined, part_of

MOST_FIELDS = 256
SAME_PLACE = 1e-3  # of a spacing, by which places may be rounded


@dataclass(frozen=True, eq=False)
class EmulatedFields(Mapping[str, FieldEmulator]):
    """The emulator of each field, by its name, or its quantity's; "" for a single unnamed one.

    Attributes
    ----------
    space : the parameters, which emulators take normalized in it.
    emulators : by field.
    quantities : names and units, by field.
    left_out : a sentence about each field that could not be emulated, and was not required; not stored.

    Examples
    --------
    >>> from blobs import make_run
    >>> from catalogs import Catalog
    >>> from surrogate.emulation import EmulatedFields
    >>> fields = EmulatedFields.fit(Catalog.open(make_run() / "blobs.cdb"))
    >>> fields[""].at([0.0, 0.0]).values.shape  # in the middle of both parameters
    (24, 24, 24)
    """

    space: ParameterSpace
    emulators: Mapping[str, FieldEmulator]
    quantities: Mapping[str, Quantity] = field(default_factory=dict)
    left_out: tuple[str, ...] = ()

    @classmethod
    def fit(
        cls,
        catalog: Catalog,
        scales: Mapping[str, ValueScale] | None = None,
        splits: Sequence[str] = ("train",),
        *,
        without: str = "",
        required: Collection[str] | None = None,
    ) -> EmulatedFields:
        """From the coarse fields of the members of some splits, `without` the one of that name.

        The `scales` are those that appearances show fields on, by field; `required` are the fields that appearances show, None for
        all.

        Fields that fewer than three members have are left out: there may be none.  Raises ValueError naming a member whose field
        lies on another grid than that of the others; one that is not required is `left_out`.
        """
        space = catalog.plan.space.with_logarithms()
        members = [member for member in catalog.members if member.split in splits and member.name != without]
        by_field: dict[str, list[tuple[Member, CoarseField]]] = {}
        for member in members:
            for name, coarse in member.coarse_fields().items():
                by_field.setdefault(name, []).append((member, coarse))
        emulators, left_out = dict[str, FieldEmulator](), list[str]()
        for name, having in by_field.items():
            if len(having) < FEWEST:
                continue
            try:
                emulators[name] = _emulator(name, having, space, (scales or {}).get(name))
            except ValueError as error:
                if required is None or name in required:
                    raise
                left_out.append(str(error))
        quantities = {name: catalog.plan.quantity(name) for name in emulators}
        return cls(space, emulators, quantities, tuple(left_out))

    def __getitem__(self, name: str) -> FieldEmulator:
        try:
            return self.emulators[self.by_name.get(name, name)]
        except KeyError:
            raise KeyError(f"no field {name!r} is emulated, only {joined_names(self.by_name)}") from None

    def __iter__(self) -> Iterator[str]:
        return iter(self.emulators)

    def __len__(self) -> int:
        return len(self.emulators)

    def __repr__(self) -> str:
        return f"<EmulatedFields of {self.space}: {joined_names(self.by_name)}, {self.megabytes:.1f} MB>"

    @cached_property
    def megabytes(self) -> float:
        """Size of the stored tensors, 10^6 bytes."""
        return self.stored_form().megabytes

    @property
    def by_name(self) -> dict[str, str]:
        """The fields by their names, an unnamed one by that of its quantity."""
        return {name or self.quantities.get(name, Quantity()).name: name for name in self.emulators}

    def field(self, name: str, point: ArrayLike) -> EmulatedField:
        """A field with its name and unit at normalized parameters (P,)."""
        return replace(self[name].at(point), quantity=self.quantity(name))

    def quantity(self, name: str) -> Quantity:
        """The name and the unit of a field."""
        return self.quantities.get(self.by_name.get(name, name), Quantity(name))

    def save(self, directory: str | os.PathLike[str]) -> None:
        """Write `model.safetensors`, then `model.json`, which makes them emulators, into `directory`."""
        self.stored_form().save(directory)

    @classmethod
    def load(cls, directory: str | os.PathLike[str]) -> EmulatedFields:
        """The emulators that were saved into `directory`; the folder may come from anyone, for nothing in it is run.

        Raises FileNotFoundError where there are none, ValueError for those of a newer schema and, naming the part, for damage.
        """
        return models.load(directory, cls.of_stored)

    def stored_form(self) -> models.StoredModel:
        """The contents of their files."""
        by_name = {name: storage.stored_form(emulator) for name, emulator in self.emulators.items()}
        numbered = {str(number): parts for number, parts in enumerate(by_name.values())}
        record = {
            "schema": models.SCHEMA,
            "parameters": self.space.to_json(),
            "fields": [
                {
                    "field": name,
                    "quantity": self.quantity(name).to_json(),
                    **parts[1],
                }
                for name, parts in by_name.items()
            ],
        }
        encodings = {f"{n}.{name}": e for n, parts in numbered.items() for name, e in parts[2].items()}
        return models.StoredModel(joined({n: parts[0] for n, parts in numbered.items()}), record, encodings)

    @classmethod
    def of_stored(cls, model: models.StoredModel) -> EmulatedFields:
        """Those of which `stored_form` gave this, whatever else the record holds; raises ValueError naming a damaged part."""
        with models.part("parameters"):
            space = ParameterSpace.from_json(model.record["parameters"])
        emulators: dict[str, FieldEmulator] = {}
        quantities: dict[str, Quantity] = {}
        for number, record in enumerate(_listed(model.record["fields"])):
            with models.part(f"field {number}"):
                name = Quantity(record["field"]).name
                encodings = {
                    key.removeprefix(f"{number}."): e
                    for key, e in model.encodings.items()
                    if key.startswith(f"{number}.")
                }
                emulators[name] = FieldEmulator.of_stored(part_of(model.tensors, str(number)), record, encodings)
                if emulators[name].processes.points.shape[1] != len(space):
                    raise ValueError(f"it must have the {len(space)} parameters {joined_names(space.names)}")
                quantities[name] = Quantity(**record["quantity"])
        return cls(space, emulators, quantities)


def _emulator(
    name: str, having: Sequence[tuple[Member, CoarseField]], space: ParameterSpace, scale: ValueScale | None
) -> FieldEmulator:
    """Of one field, by the members that have it."""
    first = having[0][1]
    for member, coarse in having:
        if not _alike(coarse, first):
            raise ValueError(
                f"the coarse field {name!r} of {member.name} has {_grid(coarse)}, that of {having[0][0].name} {_grid(first)}: "
                "an emulator needs one grid for all members"
            )
    parameters = [[member.parameters[parameter] for parameter in space.names] for member, _ in having]
    points = space.normalize(np.reshape(parameters, (len(having), len(space))))
    return FieldEmulator.fit(points, np.stack([c.values for _, c in having]), first.spacing, first.origin, scale)


def _alike(coarse: CoarseField, first: CoarseField) -> bool:
    """True if the samples of two fields lie at the same places, but for rounding."""
    if coarse.values.shape != first.values.shape:
        return False
    spacing, origin = np.array(first.spacing), np.array(first.origin)
    last = (np.array(coarse.spacing) - spacing) * first.values.shape[::-1]
    return bool((np.abs([coarse.origin - origin, last]) <= SAME_PLACE * spacing).all())


def _grid(coarse: CoarseField) -> str:
    z, y, x = coarse.values.shape
    return f"{x} x {y} x {z} samples of spacing {coarse.spacing} from {coarse.origin} on"


def _listed(records: Any) -> list[Mapping[str, Any]]:
    if not isinstance(records, list) or not all(isinstance(r, dict) for r in records) or len(records) > MOST_FIELDS:
        raise ValueError(f"fields must be at most {MOST_FIELDS} objects")
    return records
