"""Bundled simulations: what a scene may name, and the fields that each returns."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from importlib import import_module
from typing import Any

from catalogs.vocabulary.words import joined_names
from insitu.fields.field import Field

__all__ = ["Field", "Simulation", "simulation"]

_HOMES = {"taylor_green": "insitu.simulations.taylor_green_fields"}


@dataclass(frozen=True)
class Simulation:
    """A bundled simulation: its name in scenes, the parameters that a member must give, and how to run one.

    Attributes
    ----------
    name, parameters : as scenes spell them.
    fields : the names of what it can tell of a member.
    run_fields : (parameters, *, fields, resolution, time, progress=None, solver_resolution=None) gives the fields of these names
        at `time` on `resolution`³ points, solved on `solver_resolution`³; `progress` is called with the finished fraction.
    dumps : the same for several ascending `times` in place of `time`: yields the fields at one after the other, of a single run.
        The fields at a time do not depend on the other times; `progress` is called with the fraction of the way to the next.
    """

    name: str
    parameters: tuple[str, ...]
    fields: tuple[str, ...]
    run_fields: Callable[..., dict[str, Field]]
    dumps: Callable[..., Iterator[dict[str, Field]]]

    def run(self, parameters: Mapping[str, float], **how: Any) -> Field:
        """The first of its fields; the other arguments are those of `run_fields`."""
        return self.run_fields(parameters, fields=self.fields[:1], **how)[self.fields[0]]

    def check_fields(self, fields: Sequence[str]) -> None:
        """Raise ValueError unless these are some of the simulation's, each once."""
        unknown = [name for name in fields if name not in self.fields]
        if unknown or not fields or len(set(fields)) != len(fields):
            raise ValueError(
                f"fields of {self.name} are some of {joined_names(self.fields)}, each once, got {joined_names(fields)}"
            )


def simulation(name: str) -> Simulation:
    """The bundled simulation called `name`, loaded on first use; ValueError names the known ones."""
    if name not in _HOMES:
        raise ValueError(f"there is no simulation {name!r}; bundled are: {', '.join(sorted(_HOMES))}")
    solver: Simulation = import_module(_HOMES[name]).SIMULATION
    return solver
