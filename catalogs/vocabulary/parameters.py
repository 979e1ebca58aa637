"""The simulation parameters of an ensemble: names, units, bounds, scales and sampling."""

from __future__ import annotations

import math
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, fields, replace
from reprlib import repr as shortened
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from catalogs.vocabulary.numbers import finite, text
from catalogs.vocabulary.quantity import label
from catalogs.vocabulary.words import SPLITS as SPLITS
from catalogs.vocabulary.words import joined_names

Outside = Literal["warn", "allow"]
SCALES = ("linear", "log")
DECADE = 10.0
SLACK = 1e-9  # of a range, for bounds rounded to decimals


@dataclass(frozen=True)
class Parameter:
    """One simulation parameter.

    Attributes
    ----------
    name : in tables and on pages.
    low, high : the ensemble's bounds, in `unit`.
    unit : "" where dimensionless.
    scale : "linear"; or "log" where ratios matter, such as for a viscosity over several powers of ten: sampling, sliders and the
        surrogate use the logarithm.  Bounds and values are positive then.

    Raises ValueError naming the parameter and the problem.

    Examples
    --------
    >>> from catalogs import Parameter
    >>> viscosity = Parameter("viscosity", 1e-4, 1e-2, "m²/s", scale="log")
    >>> print(viscosity, "middle", f"{viscosity.middle:g}")
    viscosity in [0.0001, 0.01] m²/s (log) middle 0.001
    """

    name: str
    low: float
    high: float
    unit: str = ""
    scale: str = "linear"

    def __post_init__(self) -> None:
        if not isinstance(self.name, str) or not self.name:
            raise ValueError(f"a parameter needs a name and bounds low < high, got the name {self.name!r}")
        what = f"parameter {self.name}"
        for end in ("low", "high"):
            object.__setattr__(self, end, finite(getattr(self, end), f"{what}: {end}, one of its bounds,"))
        if not self.low < self.high:
            raise ValueError(f"{what} needs bounds low < high, got {text(self.low)}, {text(self.high)}")
        if not isinstance(self.unit, str):
            raise ValueError(f"{what}: its unit must be text, got {self.unit!r}")
        if self.scale not in SCALES:
            raise ValueError(f"{what}: scale must be one of {SCALES}, got {self.scale!r}")
        if self.scale == "log" and self.low <= 0.0:
            raise ValueError(
                f'{what} has scale "log", so its bounds must be positive, got {text(self.low)}, {text(self.high)}: '
                'raise low, or take scale "linear"'
            )

    def __str__(self) -> str:
        scale = " (log)" if self.scale == "log" else ""
        return f"{self.name} in {self.range} {self.unit}".rstrip() + scale

    def text(self, value: float, least: int = 6) -> str:
        """A value in as many digits as its range asks for; see `numbers.text`."""
        return text(value, self.high - self.low, least)

    @property
    def range(self) -> str:
        """The bounds, such as "[1500, 2500]"."""
        return f"[{self.text(self.low)}, {self.text(self.high)}]"

    @property
    def spans_decade(self) -> bool:
        """True if the bounds are positive, and the upper at least ten times the lower."""
        return self.low > 0.0 and self.high >= DECADE * self.low

    @property
    def label(self) -> str:
        """Axis label, such as "nu (m²/s)"."""
        return label(self.name, self.unit)

    @property
    def middle(self) -> float:
        """Halfway between the bounds on its scale."""
        if self.scale == "log":
            return math.sqrt(self.low) * math.sqrt(self.high)
        return (self.low + self.high) / 2.0

    def at(self, fraction: float) -> float:
        """The value at a fraction of the way from `low`, 0, to `high`, 1, on its scale."""
        if self.scale == "log":
            return math.exp((1.0 - fraction) * math.log(self.low) + fraction * math.log(self.high))
        return self.low + fraction * (self.high - self.low)

    def fraction(self, value: float) -> float:
        """Inverse of `at`; minus infinity for values up to zero on a logarithmic scale."""
        if self.scale == "log":
            low, high = math.log(self.low), math.log(self.high)
            return (math.log(value) - low) / (high - low) if value > 0.0 else -math.inf
        return (value - self.low) / (self.high - self.low)

    def holds(self, value: float) -> bool:
        """True if a value lies within the bounds."""
        return -SLACK <= self.fraction(value) <= 1.0 + SLACK

    def note_on(self, values: Sequence[float]) -> str:
        """A sentence for an ensemble of which no member has a value within the bounds, else ""."""
        if not values or any(map(self.holds, values)):
            return ""
        return (
            f"all members lie outside the bounds {self.range} of {self.name}, from {self.text(min(values))} to "
            f"{self.text(max(values))}: are the bounds in another unit?"
        )

    def to_json(self) -> dict[str, Any]:
        """JSON values; a `scale` only where it is "log"."""
        record = asdict(self)
        if self.scale == "linear":
            record.pop("scale")
        return record

    @classmethod
    def from_json(cls, record: Mapping[str, Any]) -> Parameter:
        """The parameter of a `to_json` record or of a scene's `[[parameters]]` table; raises ValueError naming wrong keys."""
        names = [field.name for field in fields(cls)]
        missing = [key for key in names[:3] if key not in record]
        unknown = [key for key in record if key not in names]
        if missing or unknown:
            named = record.get("name", "?")
            raise ValueError(
                f"parameter {named!r}: missing keys {joined_names(missing)}, unknown keys "
                f"{joined_names(unknown)}; known are {joined_names(names)}"
            )
        return cls(**record)


@dataclass(frozen=True)
class ParameterSpace:
    """The ordered parameters of an ensemble.

    Examples
    --------
    >>> from catalogs import Parameter, ParameterSpace
    >>> space = ParameterSpace((Parameter("Re", 1000, 2000), Parameter("time", 0, 10, "s")))
    >>> space.normalize([1500, 10]).tolist()
    [0.0, 1.0]
    >>> space.latin_hypercube(5, seed=0).shape
    (5, 2)
    """

    parameters: tuple[Parameter, ...]

    def __post_init__(self) -> None:
        object.__setattr__(self, "parameters", tuple(self.parameters))
        if len(set(self.names)) != len(self.names):
            raise ValueError(f"parameter names must be unique, got {joined_names(self.names)}")

    def __repr__(self) -> str:
        return f"<ParameterSpace of {self}>"

    def __str__(self) -> str:
        return ", ".join(map(str, self.parameters)) or "no parameters"

    @property
    def names(self) -> tuple[str, ...]:
        return tuple(p.name for p in self.parameters)

    def __len__(self) -> int:
        return len(self.parameters)

    def with_logarithms(self) -> ParameterSpace:
        """The same with logarithmic scales where bounds are a decade apart or more: so surrogates learn them."""
        return ParameterSpace(tuple(replace(p, scale="log") if p.spans_decade else p for p in self.parameters))

    @property
    def middle(self) -> dict[str, float]:
        """The centre of the bounds, each on its parameter's scale, by name."""
        return {p.name: p.middle for p in self.parameters}

    def values(
        self, parameters: Mapping[str, Any], *, outside: Outside = "warn", stacklevel: int = 1
    ) -> NDArray[np.float64]:
        """`parameters` by name as an array (P,) in this space's order.

        Values out of bounds are accepted with a UserWarning each, unless `outside` is "allow"; `stacklevel` is as in
        `warnings.warn`.  Raises ValueError for missing or unknown parameters, and for other values than finite numbers.
        """
        if outside not in ("warn", "allow"):
            raise ValueError(f'outside must be "warn" or "allow", got {outside!r}')
        if not isinstance(parameters, Mapping):
            raise ValueError(f"parameters must be values by name, for {joined_names(self.names)}, got {parameters!r}")
        missing = [n for n in self.names if n not in parameters]
        unknown = [n for n in parameters if n not in self.names]
        if missing or unknown:
            raise ValueError(
                f"parameters must be exactly {joined_names(self.names)}: missing {joined_names(missing)}, "
                f"unknown {joined_names(unknown)}"
            )
        values = np.array([_number(n, parameters[n]) for n in self.names], dtype=np.float64)  # [P]
        for name, value in zip(self.names, values, strict=True):
            if not np.isfinite(value):
                raise ValueError(f"parameter {name} must be finite, got {shortened(parameters[name])}")
        self._check_positive(values)
        if outside == "warn":
            for sentence in self.outside(values).values():
                warnings.warn(sentence, stacklevel=stacklevel + 1)
        return values

    def outside(self, values: ArrayLike) -> dict[str, str]:
        """Names of the parameters whose `values` (P,) are out of bounds, with a sentence about each."""
        return {
            p.name: f"parameter {p.name} = {p.text(value)} lies outside its bounds {p.range}: "
            "predictions there extrapolate"
            for p, value in zip(self.parameters, np.asarray(values, dtype=np.float64), strict=True)
            if not p.holds(value)
        }

    def normalize(self, values: ArrayLike) -> NDArray[np.float64]:
        """Physical values (..., P) to [-1, 1] over the bounds, each on its parameter's scale.

        Raises ValueError for a value on a logarithmic scale that is not positive.
        """
        low, high = self._bounds()
        return 2.0 * (self._scaled(values) - low) / (high - low) - 1.0

    def denormalize(self, normalized: ArrayLike) -> NDArray[np.float64]:
        """Inverse of `normalize`."""
        low, high = self._bounds()
        return self._unscaled(low + (np.asarray(normalized, dtype=np.float64) + 1.0) / 2.0 * (high - low))

    def latin_hypercube(self, count: int, seed: int) -> NDArray[np.float64]:
        """`count` members (count, P), one in each of `count` equal slices of every parameter, on its scale.

        McKay, Beckman & Conover 1979; scipy's `LatinHypercube` with the given seed.
        """
        from scipy.stats import qmc

        low, high = self._bounds()
        sampler = qmc.LatinHypercube(d=len(self), rng=np.random.default_rng(seed))
        return self._unscaled(low + sampler.random(count) * (high - low))  # [count, P]

    def to_json(self) -> list[dict[str, Any]]:
        return [parameter.to_json() for parameter in self.parameters]

    @classmethod
    def from_json(cls, records: Sequence[Mapping[str, Any]]) -> ParameterSpace:
        return cls(tuple(map(Parameter.from_json, records)))

    @property
    def logarithmic(self) -> bool:
        """True where some parameter has a logarithmic scale."""
        return bool(self._logarithmic)

    @property
    def _logarithmic(self) -> list[int]:
        """Positions of the parameters on a logarithmic scale."""
        return [i for i, p in enumerate(self.parameters) if p.scale == "log"]

    def _check_positive(self, values: NDArray[np.float64]) -> None:
        for i in self._logarithmic:
            if (values[..., i] <= 0.0).any():
                raise ValueError(
                    f"parameter {self.names[i]} has a logarithmic scale, so it must be positive, got {values[..., i].min():g}"
                )

    def _scaled(self, values: ArrayLike) -> NDArray[np.float64]:
        """Values (..., P), the logarithm of those on a logarithmic scale."""
        scaled = np.array(values, dtype=np.float64)
        self._check_positive(scaled)
        for i in self._logarithmic:
            scaled[..., i] = np.log(scaled[..., i])
        return scaled

    def _unscaled(self, scaled: NDArray[np.float64]) -> NDArray[np.float64]:
        """Inverse of `_scaled`, in place."""
        for i in self._logarithmic:
            scaled[..., i] = np.exp(scaled[..., i])
        return scaled

    def _bounds(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Both bounds (P,), the logarithm of those on a logarithmic scale."""
        low, high = (self._scaled([getattr(p, end) for p in self.parameters]) for end in ("low", "high"))
        return low, high


def _number(name: str, value: Any) -> float:
    """A value as a double, a zero without sign; raises ValueError unless it is a number, and for too many digits of a whole one."""
    try:
        number = float(value) + 0.0
    except OverflowError:
        number = math.inf
    except (TypeError, ValueError):
        raise ValueError(f"parameter {name} must be a number, got {value!r}") from None
    if isinstance(value, int | np.integer) and math.isfinite(number) and int(number) != int(value):
        raise ValueError(
            f"parameter {name} = {value} has more digits than a number of the catalog, and would become {int(number)}: "
            "take a smaller number in its place, such as an index"
        )
    return number
