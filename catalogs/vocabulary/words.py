"""Short texts for names, counts and records."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import fields
from typing import Any

from catalogs.vocabulary.numbers import text

SPLITS = ("train", "validation", "test")
FEWEST_LEARNT = 4  # training members; what lies between fewer can only be blended from them
WIDTH = 120  # characters of a record


def shortened(names: Sequence[str], most: int = 12) -> str:
    """The names with commas between; of more than `most` only the first, and their number."""
    return ", ".join(names[:most]) + (f", ... ({len(names)} in all)" if len(names) > most else "")


def joined_names(names: Iterable[object]) -> str:
    """Names in a sentence, such as "Re, time"; "none" where there are none."""
    return ", ".join(str(name) or "''" for name in names) or "none"


def check_keys(keys: Sequence[str], table: Mapping[str, Any], place: str) -> None:
    """Raise ValueError naming the keys of a table that are none of `keys`, and these."""
    if unknown := sorted(set(table) - set(keys)):
        raise ValueError(f"{place}: unknown keys {joined_names(unknown)}; known are {joined_names(keys)}")


def keys_of(form: type) -> list[str]:
    """Names of the fields that a dataclass is made from, in alphabetical order."""
    return sorted(entry.name for entry in fields(form) if entry.init)


def counted(splits: Iterable[str]) -> str:
    """Numbers per split, such as "2 train, 0 validation, 1 test"."""
    counts = Counter(splits)
    return ", ".join(f"{counts[split]} {split}" for split in SPLITS)


def named_values(values: Mapping[str, float]) -> str:
    """Numbers by name, such as "Re=120 Pr=1"."""
    return " ".join(f"{name}={text(value)}" for name, value in values.items())


def plural(count: int, word: str) -> str:
    """Such as "1 member" and "1,200 members"."""
    return f"{count:,} {word}{'' if count == 1 else 's'}"


def member_line(member: Any, text: str) -> str:
    """One-line `__repr__` of a member: name, split, parameters, and `text`."""
    return f"<{type(member).__name__} {member.name} ({member.split}): {named_values(member.parameters)}; {text}>"


def one_line(record: Any) -> str:
    """One-line `__repr__` of a dataclass or named tuple: shapes in place of arrays and tensors, at most `WIDTH` characters."""
    names = getattr(record, "_fields", None) or [field.name for field in fields(record)]
    text = f"{type(record).__name__}({', '.join(_field_text(name, getattr(record, name)) for name in names)})"
    return text if len(text) <= WIDTH else f"{text[: WIDTH - 2]}…)"


def _field_text(name: str, value: Any) -> str:
    if hasattr(value, "shape"):
        return f"{name}{list(value.shape)}"
    if isinstance(value, Mapping):
        return f"{name}={{{len(value)} entries}}"
    return f"{name}={' '.join(repr(value).split())}"
