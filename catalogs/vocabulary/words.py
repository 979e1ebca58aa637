"""Names, counts and records in words."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import fields
from typing import Any

from catalogs.vocabulary.parameters import SPLITS

WIDTH = 120  # characters of a record


def shortened(names: Sequence[str], most: int = 12) -> str:
    """The names with commas between; of many only the first, and how many there are."""
    return ", ".join(names[:most]) + (f", ... ({len(names)} in all)" if len(names) > most else "")


def counted(splits: Iterable[str]) -> str:
    """How many of these are of each split, such as "2 train, 0 validation, 1 test"; of a Counter, of its elements."""
    counts = Counter(splits)
    return ", ".join(f"{counts[split]} {split}" for split in SPLITS)


def member_line(member: Any, shown: str) -> str:
    """A member's name, split and parameters, and what is `shown` of it, on one line: its `__repr__`."""
    values = "".join(f" {name}={value:g}" for name, value in member.parameters.items())
    return f"<{type(member).__name__} {member.name} ({member.split}):{values}; {shown}>"


def one_line(record: Any) -> str:
    """A dataclass or named tuple with shapes in place of arrays and tensors, in at most `WIDTH` characters: its `__repr__`."""
    names = getattr(record, "_fields", None) or [field.name for field in fields(record)]
    text = f"{type(record).__name__}({', '.join(_shown(name, getattr(record, name)) for name in names)})"
    return text if len(text) <= WIDTH else f"{text[: WIDTH - 2]}…)"


def _shown(name: str, value: Any) -> str:
    if hasattr(value, "shape"):
        return f"{name}{list(value.shape)}"
    if isinstance(value, Mapping):
        return f"{name}={{{len(value)} entries}}"
    return f"{name}={' '.join(repr(value).split())}"
