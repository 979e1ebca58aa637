"""Bundled simulations: what a scene may name, and the fields that each returns."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from importlib import import_module
from typing import Any, Protocol

from insitu.field import Field

__all__ = ["Field", "RunFields", "Simulation", "simulation"]

_HOMES = {"taylor_green": "insitu.simulations.taylor_green"}


class RunFields(Protocol):
    """How every bundled simulation is run: one member, from its initial condition to `time`."""

    def __call__(
        self,
        parameters: Mapping[str, float],
        *,
        fields: Sequence[str],
        resolution: int,
        time: float,
        progress: Callable[[float], Any] | None = None,
        solver_resolution: int | None = None,
    ) -> dict[str, Field]:
        """The fields of these names on `resolution`³ points, solved on `solver_resolution`³ where given.

        `progress`, where given, is called with the finished fraction of the run, up to 1.  ValueError names the known fields.
        """
        ...


@dataclass(frozen=True)
class Simulation:
    """A bundled simulation: its name in scenes, the parameters that a member must give, and how to run one.

    `fields` are the names of what it can tell of a member.
    """

    name: str
    parameters: tuple[str, ...]
    fields: tuple[str, ...]
    run_fields: RunFields

    def run(self, parameters: Mapping[str, float], **how: Any) -> Field:
        """The first of its fields; the other arguments are those of `RunFields`."""
        return self.run_fields(parameters, fields=self.fields[:1], **how)[self.fields[0]]

    def check_fields(self, fields: Sequence[str]) -> None:
        """Raise ValueError unless these are some of the simulation's, each once."""
        unknown = [name for name in fields if name not in self.fields]
        if unknown or not fields or len(set(fields)) != len(fields):
            raise ValueError(f"fields of {self.name} are some of {list(self.fields)}, each once, got {list(fields)}")


def simulation(name: str) -> Simulation:
    """The bundled simulation called `name`, loaded on first use; ValueError names the known ones."""
    if name not in _HOMES:
        raise ValueError(f"there is no simulation {name!r}; bundled are: {', '.join(sorted(_HOMES))}")
    found: Simulation = import_module(_HOMES[name]).SIMULATION
    return found
