"""Physical quantities: what a field or a parameter is called, and its unit."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any


@dataclass(frozen=True)
class Quantity:
    """A quantity by `name` and `unit`, each "" where it is not known or there is none.

    Raises ValueError where one of them is no printable text.
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
    """A name and its unit as an axis says them, such as "Q (1/s²)"; the one of them that is known, or ""."""
    return f"{name} ({unit})" if name and unit else name or unit


def quantities_from(fields: Mapping[str, Any]) -> dict[str, Quantity]:
    """Quantities by the names of fields, from `{name: unit}`, `{name: Quantity}` or `{name: {"name": ..., "unit": ...}}`.

    Raises ValueError naming what is none of these.
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


def quantities_of(given: Mapping[str, Quantity], shown: Sequence[str]) -> dict[str, Quantity]:
    """`given` by the names under which appearances show their fields; "" where they show an only one without naming it.

    Raises ValueError where a field is described that is not shown.
    """
    if tuple(shown) in ((), ("",)) and len(given) == 1:
        return {"": next(iter(given.values()))}
    unknown = [name for name in given if name not in shown]
    if unknown:
        only = (
            "an only one, whose name they do not say: describe that one" if tuple(shown) == ("",) else f"{list(shown)}"
        )
        raise ValueError(f"fields describes {unknown}, but the appearances show {only}")
    return dict(given)


def text(value: Any, what: str) -> str:
    """`value` without blanks around it; raises ValueError naming `what` unless it is printable text, which "" is."""
    if not isinstance(value, str) or not value.strip().isprintable():
        raise ValueError(f"{what} must be printable text, got {value!r}")
    return value.strip()
