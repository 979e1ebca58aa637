"""The simulation parameters of an ensemble: names, units, bounds, and how members are placed among them."""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

Outside = Literal["warn", "allow"]
SPLITS = ("train", "validation", "test")
SLACK = 1e-9  # of a range: bounds that went through decimals


@dataclass(frozen=True)
class Parameter:
    """One simulation parameter; its bounds are the ensemble's, in `unit` ("" where dimensionless)."""

    name: str
    low: float
    high: float
    unit: str = ""

    def __post_init__(self) -> None:
        if not self.name or not np.isfinite([self.low, self.high]).all() or not self.low < self.high:
            raise ValueError(
                f"parameter {self.name!r} needs a name and finite bounds low < high, got {self.low}, {self.high}"
            )

    def __str__(self) -> str:
        return f"{self.name} in [{self.low:g}, {self.high:g}] {self.unit}".rstrip()


@dataclass(frozen=True)
class ParameterSpace:
    """The ordered parameters of an ensemble."""

    parameters: tuple[Parameter, ...]

    def __post_init__(self) -> None:
        object.__setattr__(self, "parameters", tuple(self.parameters))
        if len(set(self.names)) != len(self.names):
            raise ValueError(f"parameter names must be unique, got {self.names}")

    def __repr__(self) -> str:
        return f"<ParameterSpace of {self}>"

    def __str__(self) -> str:
        return ", ".join(map(str, self.parameters)) or "no parameters"

    @property
    def names(self) -> tuple[str, ...]:
        return tuple(p.name for p in self.parameters)

    def __len__(self) -> int:
        return len(self.parameters)

    def values(
        self, parameters: Mapping[str, Any], *, outside: Outside = "warn", stacklevel: int = 1
    ) -> NDArray[np.float64]:
        """`parameters` by name as an array (P,) in this space's order.

        Values out of bounds are taken; unless `outside` is "allow", a UserWarning names each.  It points to the caller's line, or
        further up by `stacklevel` as `warnings.warn` counts.  Raises ValueError for missing or unknown parameters and for what is
        no finite number.
        """
        if outside not in ("warn", "allow"):
            raise ValueError(f'outside must be "warn" or "allow", got {outside!r}')
        missing = [n for n in self.names if n not in parameters]
        unknown = [n for n in parameters if n not in self.names]
        if missing or unknown:
            raise ValueError(f"parameters must be exactly {list(self.names)}: missing {missing}, unknown {unknown}")
        values = np.array([_number(n, parameters[n]) for n in self.names], dtype=np.float64)  # [P]
        for name, value in zip(self.names, values, strict=True):
            if not np.isfinite(value):
                raise ValueError(f"parameter {name} must be finite, got {value}")
        if outside == "warn":
            for sentence in self.outside(values).values():
                warnings.warn(sentence, stacklevel=stacklevel + 1)
        return values

    def outside(self, values: ArrayLike) -> dict[str, str]:
        """The parameters of which `values` (P,) are out of bounds: their names, and a sentence about each."""
        return {
            p.name: f"parameter {p.name} = {value:g} lies outside its bounds [{p.low:g}, {p.high:g}]: "
            "predictions there extrapolate"
            for p, value in zip(self.parameters, np.asarray(values, dtype=np.float64), strict=True)
            if not -SLACK <= (value - p.low) / (p.high - p.low) <= 1.0 + SLACK
        }

    def normalize(self, values: ArrayLike) -> NDArray[np.float64]:
        """Physical values (..., P) to [-1, 1] over the bounds."""
        low, high = self._bounds()
        return 2.0 * (np.asarray(values, dtype=np.float64) - low) / (high - low) - 1.0

    def denormalize(self, normalized: ArrayLike) -> NDArray[np.float64]:
        """Inverse of `normalize`."""
        low, high = self._bounds()
        return low + (np.asarray(normalized, dtype=np.float64) + 1.0) / 2.0 * (high - low)

    def latin_hypercube(self, count: int, seed: int) -> NDArray[np.float64]:
        """`count` members (count, P), one in each of `count` equal slices of every parameter.

        McKay, Beckman & Conover 1979; scipy's `LatinHypercube` with the given seed.
        """
        from scipy.stats import qmc

        low, high = self._bounds()
        sampler = qmc.LatinHypercube(d=len(self), rng=np.random.default_rng(seed))
        return low + sampler.random(count) * (high - low)  # [count, P]

    def to_json(self) -> list[dict[str, Any]]:
        return [asdict(parameter) for parameter in self.parameters]

    @classmethod
    def from_json(cls, records: list[dict[str, Any]]) -> ParameterSpace:
        return cls(tuple(Parameter(**record) for record in records))

    def _bounds(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        low, high = np.array([(p.low, p.high) for p in self.parameters], dtype=np.float64).reshape(-1, 2).T
        return low, high


def _number(name: str, value: Any) -> float:
    try:
        return float(value)
    except (TypeError, ValueError):
        raise ValueError(f"parameter {name} must be a number, got {value!r}") from None
