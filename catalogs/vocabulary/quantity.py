"""Physical quantities: names and units of fields and parameters."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

from catalogs.vocabulary.words import joined_names


@dataclass(frozen=True)
class Quantity:
    """A quantity by `name` and `unit`, each "" where unknown; raises ValueError unless both are printable text.

    Examples
    --------
    >>> from insitu import Quantity
    >>> print(Quantity("vorticity", "1/s"))
    vorticity (1/s)
    """

    name: str = ""
    unit: str = ""

    def __post_init__(self) -> None:
        object.__setattr__(self, "name", text(self.name, "the name of a quantity"))
        object.__setattr__(self, "unit", text(self.unit, f"the unit of {self.name or 'a quantity'}"))

    def __bool__(self) -> bool:
        return bool(self.name or self.unit)

    def __str__(self) -> str:
        return label(self.name, self.unit)

    def to_json(self) -> dict[str, str]:
        return asdict(self)


def label(name: str, unit: str) -> str:
    """Axis label of a name and its unit, such as "Q (1/s²)"; either may be ""."""
    return f"{name} ({unit})" if name and unit else name or unit


def quantities_from(fields: Mapping[str, Any]) -> dict[str, Quantity]:
    """Quantities by the names of fields, from `{name: unit}`, `{name: Quantity}` or `{name: {"name": ..., "unit": ...}}`.

    Raises ValueError naming any other value.
    """
    if not isinstance(fields, Mapping):
        raise ValueError(f'fields must be units by the names of fields, such as {{"Q": "1/s²"}}, got {fields!r}')
    return {text(name, "the name of a field"): _quantity(name, value) for name, value in fields.items()}


def _quantity(name: str, value: Any) -> Quantity:
    if isinstance(value, Quantity):
        return value
    if isinstance(value, Mapping) and set(value) <= {"name", "unit"}:
        return Quantity(**{"name": name, **value})
    return Quantity(name, text(value, f"the unit of field {name!r}"))


def quantities_of(quantities: Mapping[str, Quantity], names: Sequence[str]) -> dict[str, Quantity]:
    """`quantities` by the names of the shown fields; a single unnamed field is "".

    Raises ValueError for fields that are not shown.
    """
    if tuple(names) in ((), ("",)) and len(quantities) == 1:
        return {"": next(iter(quantities.values()))}
    unknown = [name for name in quantities if name not in names]
    if unknown:
        if tuple(names) == ("",):
            raise ValueError(
                f"the catalog has a single unnamed field: give exactly one entry in fields, got {joined_names(quantities)}"
            )
        raise ValueError(f"fields describes {joined_names(unknown)}, but the appearances show {joined_names(names)}")
    return dict(quantities)


def text(value: Any, what: str) -> str:
    """`value` without blanks around it; raises ValueError naming `what` unless it is printable text or ""."""
    if not isinstance(value, str) or not value.strip().isprintable():
        raise ValueError(f"{what} must be printable text, got {value!r}")
    return value.strip()
