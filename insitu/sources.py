"""Where a scene's fields come from: a bundled simulation, or an ensemble stored in a file."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from catalogs.parameters import ParameterSpace
from catalogs.scene import PlannedMember, Scene
from insitu.ensemble import FieldSource
from insitu.readers.hdf5 import Hdf5Ensemble, Hdf5Source
from insitu.simulations import Field, simulation


@dataclass(frozen=True)
class SimulationSource:
    """Runs a bundled simulation for each member, in the worker that renders it."""

    name: str
    resolution: int
    time: float
    dear: bool = True

    @property
    def identity(self) -> Mapping[str, Any]:
        return {"kind": "simulation", "simulation": self.name, "resolution": self.resolution, "time": self.time}

    def field(self, member: PlannedMember, progress: Callable[[float], None]) -> Field:
        found = simulation(self.name)
        return found.run(member.parameters, resolution=self.resolution, time=self.time, progress=progress)


@dataclass(frozen=True)
class Ensemble:
    """What a scene asks for: its members, their parameters' space, and the source of their fields."""

    space: ParameterSpace
    members: Sequence[PlannedMember]
    source: FieldSource


def ensemble_of(scene: Scene) -> Ensemble:
    """The ensemble behind a scene of kind "simulation" or "hdf5".

    Raises ValueError naming a wrong key of `[source]`, FileNotFoundError for absent data.
    """
    table = dict(scene.source)
    kind = table.pop("kind")
    known = {"simulation": {"simulation", "resolution", "time"}, "hdf5": {"path", "dataset"}}[kind]
    unknown = sorted(set(table) - known)
    if unknown:
        raise ValueError(
            f"scene {scene.path}: source of kind {kind} has unknown keys {unknown}; known are {sorted(known)}"
        )
    if kind == "hdf5":
        stored = Hdf5Ensemble.open(scene.data_path(), table.get("dataset", "field"))
        return Ensemble(stored.space, stored.members(scene.validation_members, scene.seed), Hdf5Source(stored))
    missing = sorted(known - set(table))
    if missing:
        raise ValueError(f"scene {scene.path}: source of kind simulation lacks {missing}")
    found = simulation(table["simulation"])
    if set(found.parameters) != set(scene.space.names):
        raise ValueError(
            f"scene {scene.path}: simulation {found.name} takes the parameters {list(found.parameters)}, "
            f"the scene has {list(scene.space.names)}"
        )
    source = SimulationSource(found.name, int(table["resolution"]), float(table["time"]))
    return Ensemble(scene.space, scene.members, source)
