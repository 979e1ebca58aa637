"""What came of one method in one time with one seed, each in a record of its own."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

from research.studies.baselines.method import Precision
from surrogate.storage.records import Provenance, Record

KIND, VERSION = "comparison", 1
KEY = ("method", "minutes", "seed", "size", "precision", "device", "mark")
AS_PUBLISHED = 0.0  # minutes, where the number of steps is that of the publication
FOLDER = "comparison"  # of a scene's results and records
TRIVIAL = "trivial"  # the method of what mixes stored pictures


class Terms(NamedTuple):
    """What results of one table have in common; see `ComparisonResult`."""

    device: str
    size: str
    minutes: float

    @property
    def name(self) -> str:
        """In file names."""
        time = "published" if self.minutes == AS_PUBLISHED else f"{self.minutes:g}"
        published = self.size == "official" and self.minutes != AS_PUBLISHED
        return ".".join([time, *["official"] * published, *[self.device] * (self.device != "cpu")])

    def __str__(self) -> str:
        time = "sizes and steps as published" if self.minutes == AS_PUBLISHED else f"{self.minutes:g} min"
        return time if self.device == "cpu" else f"{time}, {self.device}"


class MethodRow(NamedTuple):
    """Whose results stand in one row of a table: seeds of a row differ in nothing else."""

    method: str
    precision: Precision = "float32"


@dataclass(frozen=True)
class ComparisonResult:
    """One training of a method, scored.

    Attributes
    ----------
    method : its name; "trivial" for mixtures of stored pictures.
    minutes : of processor time that it was given, of the wall's on a GPU; `AS_PUBLISHED`, and for mixtures, 0.
    size, precision : as `research.studies.baselines.method.Plan` has them.
    mark : of the catalog, and of how methods are judged by its pictures.
    device : "cpu" or "cuda".
    threads : of torch, in the training of a published method.
    rate : the factor on the method's rates that tuning chose.
    steps : that it took.
    seconds : on the clock, of all cores together; of the wall on a GPU.
    megabytes : of what must be kept of it, 10^6 bytes.
    cells : means by name of the cell and metric, and how many "images" they are of; of mixtures by the rule's name before.
    colors : of mixtures alone: the mean RGBA of each cell's test images, in [0, 1].
    curve : seconds and dB at validation images, by time.
    change_milliseconds, picture_milliseconds : medians, of a picture at other parameters and of another view.
    error : why there is no result; "" where there is one.
    """

    method: str
    minutes: float
    seed: int
    size: str
    precision: Precision
    mark: str
    device: str = "cpu"
    threads: int = 1
    rate: float = 1.0
    steps: int = 0
    seconds: float = 0.0
    megabytes: float = 0.0
    cells: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    colors: Mapping[str, Sequence[float]] = field(default_factory=dict)
    curve: Sequence[Sequence[float]] = ()
    change_milliseconds: float | None = None
    picture_milliseconds: float | None = None
    error: str = ""
    provenance: Provenance = field(default_factory=Provenance)

    @property
    def name(self) -> str:
        """Of its files."""
        parts = [self.method, self.terms.name, str(self.seed)]
        return ".".join(parts + [self.precision] * (self.precision != "float32"))

    @property
    def row(self) -> MethodRow:
        """Beside which other seeds' results it stands."""
        return MethodRow(self.method, self.precision)

    @property
    def terms(self) -> Terms:
        """On which others are comparable with it."""
        return Terms(self.device, self.size, self.minutes)


def save(records: Path, result: ComparisonResult) -> Path:
    """Keep a result in the folder of a scene's records; returns where."""
    path = records / FOLDER / f"{result.name}.json"
    Record.of(KIND, VERSION, result, KEY).save(path)
    return path


def find(records: Path, wanted: ComparisonResult) -> ComparisonResult | None:
    """The result that is kept of the same method, time, seed, size, precision and catalog."""
    key = {name: getattr(wanted, name) for name in KEY}
    record = Record.load(records / FOLDER / f"{wanted.name}.json", KIND, VERSION, key)
    return None if record is None else record.to(ComparisonResult)


def load(records: Path) -> list[ComparisonResult]:
    """All that is kept of a scene, by method, precision, time and seed."""
    found = (record.to(ComparisonResult) for record in Record.load_all(records / FOLDER, KIND, VERSION).values())
    return sorted((r for r in found if r is not None), key=lambda r: (*r.row, r.minutes, r.seed))


def in_float32(results: Sequence[ComparisonResult]) -> list[ComparisonResult]:
    """Without those in bfloat16 of methods that were trained in float32 too, on the same terms and with the same seed."""
    whole = {(r.method, r.terms, r.seed) for r in results if r.precision == "float32" and not r.error}
    return [r for r in results if r.precision == "float32" or (r.method, r.terms, r.seed) not in whole]


def terms(results: Iterable[ComparisonResult]) -> list[Terms]:
    """On which methods were trained, in order."""
    found = {r.terms for r in results if r.method != TRIVIAL}
    return sorted(found, key=lambda each: (each.device, each.size == "official", each.minutes))
