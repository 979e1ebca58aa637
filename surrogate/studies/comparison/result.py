"""What came of one method in one time with one seed, each in a record of its own."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from surrogate.storage.records import Provenance, Record

KIND, VERSION = "comparison", 1
KEY = ("method", "minutes", "seed", "size", "precision", "mark")
FOLDER = "comparison"  # of a scene's results and records
TRIVIAL = "trivial"  # the method of what mixes stored pictures


@dataclass(frozen=True)
class Result:
    """One training of a method, scored.

    Attributes
    ----------
    method : its name; "trivial" for mixtures of stored pictures.
    minutes : of processor time that it was given; 0 for mixtures.
    size, precision : as `surrogate.studies.baselines.method.Plan` has them.
    mark : of the catalog, the pictures and how they are judged.
    threads : of torch, in the training of a published method.
    rate : the factor on the method's rates that tuning chose.
    steps : that it took.
    seconds : on the clock, of all cores together.
    megabytes : of what must be kept of it, 10^6 bytes.
    cells : means by name of the cell and metric, and how many "images" they are of; of mixtures by the rule's name before.
    curve : seconds and dB at validation images, by time.
    change_milliseconds, picture_milliseconds : medians, of a picture at other parameters and of another view.
    error : why there is no result; "" where there is one.
    """

    method: str
    minutes: float
    seed: int
    size: str
    precision: str
    mark: str
    threads: int = 1
    rate: float = 1.0
    steps: int = 0
    seconds: float = 0.0
    megabytes: float = 0.0
    cells: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    curve: Sequence[Sequence[float]] = ()
    change_milliseconds: float | None = None
    picture_milliseconds: float | None = None
    error: str = ""
    provenance: Provenance = field(default_factory=Provenance)

    @property
    def name(self) -> str:
        """Of its files."""
        parts = [self.method, f"{self.minutes:g}", str(self.seed)]
        parts += [self.size] * (self.size == "official") + [self.precision] * (self.precision != "float32")
        return ".".join(parts)


def save(records: Path, result: Result) -> Path:
    """Keep a result in the folder of a scene's records; returns where."""
    path = records / FOLDER / f"{result.name}.json"
    Record.of(KIND, VERSION, result, KEY).save(path)
    return path


def find(records: Path, wanted: Result) -> Result | None:
    """The result that is kept of the same method, time, seed, size, precision and catalog."""
    key = {name: getattr(wanted, name) for name in KEY}
    record = Record.load(records / FOLDER / f"{wanted.name}.json", KIND, VERSION, key)
    return None if record is None else record.to(Result)


def load(records: Path) -> list[Result]:
    """All that is kept of a scene, by method, time and seed."""
    found = (record.to(Result) for record in Record.load_all(records / FOLDER, KIND, VERSION).values())
    return sorted((r for r in found if r is not None), key=lambda r: (r.method, r.minutes, r.seed))


def times(results: Iterable[Result]) -> list[float]:
    """The minutes that methods were given, in order."""
    return sorted({r.minutes for r in results if r.method != TRIVIAL})
