"""Results kept as small JSON files: what was measured, what it must agree in to be used again, and what measured it.

A record is there whole or not at all.  One that is missing, damaged, of another kind or version, or made of something else reads
as None, so that whoever asks measures anew.  Records hold JSON values only, and no numbers that are not finite.
"""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Iterable, Mapping
from contextlib import suppress
from dataclasses import asdict, dataclass, field, fields
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, TypeVar

from catalogs.files import durable
from surrogate.provenance import code, commit, machine

Result = TypeVar("Result")
MOST_BYTES = 16_000_000  # that are read: the largest record of a study has some 100 kB


@dataclass(frozen=True)
class Provenance:
    """The origin of a record.

    Attributes
    ----------
    commit, code : of this project; `code` as `surrogate.provenance.code` has it, "" where it is not known.
    machine : as `surrogate.provenance.machine` describes it; empty where it is not known.
    made : when (ISO 8601); "" where it is not known.
    processor_seconds : that this took, over all cores; None where it is not known.
    """

    commit: str = "unknown"
    code: str = ""
    machine: Mapping[str, str | int] = field(default_factory=dict)
    made: str = ""
    processor_seconds: float | None = None

    def __post_init__(self) -> None:
        for each, kind in zip(fields(self), (str, str, Mapping, str, int | float | None), strict=True):
            if not isinstance(getattr(self, each.name), kind):
                raise TypeError(f"{each.name} of a provenance must be {kind}, got {getattr(self, each.name)!r}")

    @classmethod
    def now(cls, processor_seconds: float | None = None, *also: str) -> Provenance:
        """This code on this machine, at this moment; `also` names modules that decide the result beside training and evaluation."""
        moment = datetime.now(UTC).isoformat(timespec="seconds")
        return cls(commit(), code(*also), machine(), moment, processor_seconds)


@dataclass(frozen=True)
class Record:
    """One result.

    Attributes
    ----------
    kind, version : what is kept, such as "ceiling", and the version of its layout.
    key : what the result depends on, by name: settings, fingerprints, a seed.
    values : the result.
    provenance : what made it.
    """

    kind: str
    version: int
    key: Mapping[str, Any]
    values: Mapping[str, Any]
    provenance: Provenance = field(default_factory=Provenance)

    def __post_init__(self) -> None:
        if not (isinstance(self.kind, str) and type(self.version) is int):
            raise TypeError(f"a record has a kind and a number of its version, got {self.kind!r} and {self.version!r}")
        if not (isinstance(self.key, Mapping) and isinstance(self.values, Mapping)):
            raise TypeError(f"a record's key and values are mappings, got {self.key!r} and {self.values!r}")

    @classmethod
    def of(cls, kind: str, version: int, result: Any, key: Iterable[str]) -> Record:
        """A dataclass with a `provenance` as a record, its fields of the names in `key` as the key, and the others as values."""
        values = {each.name: getattr(result, each.name) for each in fields(result)}
        provenance = values.pop("provenance")
        return cls(kind, version, {name: values.pop(name) for name in key}, values, provenance)

    def to(self, form: Callable[..., Result], check: Callable[[Result], None] = lambda _: None) -> Result | None:
        """The result that `of` made a record of; None where it lacks fields of the dataclass `form`, or `check` raises."""
        try:
            result = form(**self.key, **self.values, provenance=self.provenance)
            check(result)
        except (ValueError, KeyError, TypeError, AttributeError):
            return None
        return result

    def agrees(self, key: Mapping[str, Any]) -> bool:
        """True where the record's key has all of these values; it may have more."""
        own, missing = _plain(self.key), object()
        return all(own.get(name, missing) == value for name, value in _plain(key).items())

    def save(self, path: Path) -> None:
        """Write the record to `path`, at once and whole; raises ValueError for numbers that are not finite."""
        write_json(path, asdict(self))

    @classmethod
    def keep(
        cls, path: Path | None, kind: str, version: int, key: Mapping[str, Any], values: Mapping[str, Any], began: float
    ) -> None:
        """Save what was measured since processor time `began`; not where there is no path, or it can't be written."""
        if path is not None:
            with suppress(OSError):  # in a folder that can only be read it is measured anew each time
                cls(kind, version, key, values, Provenance.now(time.process_time() - began)).save(path)

    @classmethod
    def load(cls, path: Path, kind: str, version: int, key: Mapping[str, Any] | None = None) -> Record | None:
        """The record at `path`; None without one of this kind and version that agrees with `key`."""
        content = read_json(path)
        try:
            values = dict(content or {})
            record = cls(**values | {"provenance": Provenance(**values["provenance"])})
        except (KeyError, TypeError, ValueError):
            return None
        same = (record.kind, record.version) == (kind, version)
        return record if same and record.agrees(key or {}) else None

    @classmethod
    def load_all(cls, folder: Path, kind: str, version: int, key: Mapping[str, Any] | None = None) -> dict[str, Record]:
        """All records in a folder that `load` finds, by file name without ".json"."""
        records = {path.stem: cls.load(path, kind, version, key) for path in sorted(folder.glob("*.json"))}
        return {name: record for name, record in records.items() if record is not None}


def write_json(path: Path, content: Mapping[str, Any]) -> None:
    """Let `path` hold `content`, at once and whole; its folder is made.  Raises ValueError for numbers that are not finite."""
    data = json.dumps(content, indent=1, allow_nan=False).encode()
    durable.make_folder(path.parent)
    durable.remove_abandoned(path.parent)
    durable.replace(path, data + b"\n")


def read_json(path: Path) -> dict[str, Any] | None:
    """The JSON object in a file; None where there is none, or it is damaged or larger than any record."""
    try:
        with path.open("rb") as file:
            data = file.read(MOST_BYTES + 1)
        content = json.loads(data) if len(data) <= MOST_BYTES else None
    except (OSError, ValueError, RecursionError):
        return None
    return content if isinstance(content, dict) else None


def _plain(values: Mapping[str, Any]) -> dict[str, Any]:
    """The values as they are once they were written and read: tuples become lists."""
    return dict(json.loads(json.dumps(dict(values))))
