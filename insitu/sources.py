"""Where a scene's fields come from: a bundled simulation, or an ensemble stored in a file."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from catalogs.parameters import ParameterSpace
from catalogs.scene import PlannedMember, Scene
from insitu.ensemble import FieldSource
from insitu.field import Field
from insitu.readers.hdf5 import Hdf5Ensemble
from insitu.simulations import simulation

KEYS = {  # of a scene's `[source]`: those that must be there, and those that may
    "simulation": ({"simulation", "resolution", "time"}, {"fields"}),
    "hdf5": ({"path"}, {"dataset", "fields"}),
}


@dataclass(frozen=True)
class SimulationSource:
    """Runs a bundled simulation for each member, in the worker that renders it.

    `fields` names what is taken of it; () stands for its first field, and is not recorded.
    """

    name: str
    resolution: int
    time: float
    expensive: bool = True
    fields: tuple[str, ...] = ()

    @property
    def identity(self) -> Mapping[str, Any]:
        known = {"kind": "simulation", "simulation": self.name, "resolution": self.resolution, "time": self.time}
        return {**known, "fields": list(self.fields)} if self.fields else known

    @property
    def names(self) -> tuple[str, ...]:
        """What `field` returns for each member."""
        return self.fields or simulation(self.name).fields[:1]

    def field(self, member: PlannedMember, progress: Callable[[float], None]) -> dict[str, Field]:
        found = simulation(self.name)
        return found.run_fields(
            member.parameters, fields=self.names, resolution=self.resolution, time=self.time, progress=progress
        )


@dataclass(frozen=True)
class Ensemble:
    """What a scene asks for: its members, their parameters' space, the source of their fields and the names of these."""

    space: ParameterSpace
    members: Sequence[PlannedMember] = field(repr=False)
    source: FieldSource
    fields: tuple[str, ...]


def ensemble_of(scene: Scene) -> Ensemble:
    """The ensemble behind a scene of kind "simulation" or "hdf5".

    Raises ValueError naming a wrong key of `[source]` or another kind, FileNotFoundError for absent data.
    """
    try:
        return _ensemble(scene, dict(scene.source))
    except ValueError as error:
        raise ValueError(f"scene {scene.path}: {error}") from None


def _ensemble(scene: Scene, table: dict[str, Any]) -> Ensemble:
    kind = table.pop("kind")
    if kind not in KEYS:
        raise ValueError(f"a source of kind {kind} has no fields, its images were made elsewhere")
    needed, more = KEYS[kind]
    unknown, missing = sorted(set(table) - needed - more), sorted(needed - set(table))
    if unknown:
        raise ValueError(f"source of kind {kind} has unknown keys {unknown}; known are {sorted(needed | more)}")
    if missing:
        raise ValueError(f"source of kind {kind} lacks {missing}")
    fields = table.get("fields", [])
    if not isinstance(fields, list) or not all(isinstance(name, str) and name for name in fields):
        raise ValueError(f"source.fields must be a list of names, got {fields!r}")
    if kind == "hdf5":
        if "dataset" in table and fields:
            raise ValueError("fields name the data sets of the file, several or one: leave dataset out")
        stored = Hdf5Ensemble.open(scene.data_path(), fields or (table.get("dataset", "field"),))
        return Ensemble(stored.space, stored.members(scene.validation_members, scene.seed), stored, stored.datasets)
    found = simulation(table["simulation"])
    if set(found.parameters) != set(scene.space.names):
        raise ValueError(
            f"simulation {found.name} takes the parameters {list(found.parameters)}, the scene has {list(scene.space.names)}"
        )
    try:
        found.check_fields(fields or found.fields[:1])
    except ValueError as error:
        raise ValueError(f"source.{error}") from None
    source = SimulationSource(found.name, int(table["resolution"]), float(table["time"]), fields=tuple(fields))
    return Ensemble(scene.space, scene.members, source, source.names)
