"""Simulations that run in situ without any other code: what a scene may name, and the field that each returns."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from importlib import import_module
from typing import TYPE_CHECKING, Any, Protocol

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

_HOMES = {"taylor_green": "insitu.simulations.taylor_green"}


@dataclass(frozen=True)
class Field:
    """One scalar field on a uniform grid of point samples, ready to render.

    Attributes
    ----------
    values : (nz, ny, nx) float32.
    spacing, origin : of the points, in (x, y, z) order and world units; point (i, j, k) lies at
        ``origin + (i, j, k) * spacing`` and holds ``values[k, j, i]``.
    name, unit : of the quantity ("" where dimensionless).
    time : simulation time.
    """

    values: NDArray[np.float32]
    spacing: tuple[float, float, float]
    origin: tuple[float, float, float]
    name: str
    unit: str
    time: float

    def __repr__(self) -> str:
        nz, ny, nx = self.values.shape
        low, high = float(self.values.min()), float(self.values.max())
        unit = f" {self.unit}" if self.unit else ""
        return f"Field({self.name} on {nx} x {ny} x {nz} points, {low:.4g} to {high:.4g}{unit}, t = {self.time:g})"


class Run(Protocol):
    """How every bundled simulation is run for its first field: one member, from its initial condition to `time`."""

    def __call__(
        self,
        parameters: Mapping[str, float],
        *,
        resolution: int,
        time: float,
        progress: Callable[[float], Any] | None = None,
        solver_resolution: int | None = None,
    ) -> Field:
        """Simulate the member on `resolution`³ points, or on `solver_resolution`³ and return it on fewer.

        `progress`, where given, is called with the finished fraction of the run, up to 1.
        """
        ...


class RunFields(Protocol):
    """The same for any of its fields, one run for all."""

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
        """The fields of these names; ValueError names the known ones."""
        ...


@dataclass(frozen=True)
class Simulation:
    """A bundled simulation: its name in scenes, the parameters that a member must give, and how to run one.

    `fields` are the names of what it can tell of a member, the first of which `run` returns.
    """

    name: str
    parameters: tuple[str, ...]
    fields: tuple[str, ...]
    run: Run
    run_fields: RunFields

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
