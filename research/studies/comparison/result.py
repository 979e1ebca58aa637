"""Results of a comparison: one record for each method, time and seed."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

from research.studies.baselines.method import Precision
from surrogate.storage.records import Provenance, Record

KIND, VERSION = "comparison", 1
KEY = ("method", "minutes", "seed", "size", "precision", "device", "mark")
AS_PUBLISHED = 0.0  # minutes: the published number of steps decides instead
FOLDER = "comparison"  # below a scene's results and records
TRIVIAL = "trivial"  # name of the mixtures of stored images


class Terms(NamedTuple):
    """Conditions that all results of one table share; see `ComparisonResult`."""

    device: str
    size: str
    minutes: float

    @property
    def name(self) -> str:
        """The terms in file names."""
        time = "published" if self.minutes == AS_PUBLISHED else f"{self.minutes:g}"
        published = self.size == "official" and self.minutes != AS_PUBLISHED
        return ".".join([time, *["official"] * published, *[self.device] * (self.device != "cpu")])

    def __str__(self) -> str:
        time = "sizes and steps as published" if self.minutes == AS_PUBLISHED else f"{self.minutes:g} min"
        return time if self.device == "cpu" else f"{time}, {self.device}"


class MethodRow(NamedTuple):
    """One row of a table: results that differ in their seeds alone."""

    method: str
    precision: Precision = "float32"


@dataclass(frozen=True)
class ComparisonResult:
    """One training of a method, scored.

    Attributes
    ----------
    method : name of the method; "trivial" for mixtures of stored images.
    minutes : processor time, on a GPU wall-clock time; `AS_PUBLISHED` for the published steps, 0 for mixtures.
    size, precision : as `research.studies.baselines.method.Plan` has them.
    mark : fingerprint of the catalog and of the test images.
    device : "cpu" or "cuda".
    threads : torch threads in the training of a published method.
    rate : the tuned factor on the method's rates.
    steps : number of training steps.
    seconds : processor time of all cores; on a GPU wall-clock time.
    megabytes : size of the trained model, 10^6 bytes.
    cells : means by cell and metric, and the number of "images"; for mixtures the rule's name precedes the cell's.
    colors : for mixtures, the mean RGBA of each cell's test images, in [0, 1].
    curve : seconds and dB at validation images, by time.
    change_milliseconds, picture_milliseconds : medians for an image at other parameters, and for another view.
    error : the reason for a missing result; "" if there is one.
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
        """Name of the result's files."""
        parts = [self.method, self.terms.name, str(self.seed)]
        return ".".join(parts + [self.precision] * (self.precision != "float32"))

    @property
    def row(self) -> MethodRow:
        """The row of a table that the result belongs to."""
        return MethodRow(self.method, self.precision)

    @property
    def terms(self) -> Terms:
        """The conditions that the result shares with comparable ones."""
        return Terms(self.device, self.size, self.minutes)


def save(records: Path, result: ComparisonResult) -> Path:
    """Store a result in the folder of a scene's records; returns its path."""
    path = records / FOLDER / f"{result.name}.json"
    Record.of(KIND, VERSION, result, KEY).save(path)
    return path


def find(records: Path, wanted: ComparisonResult) -> ComparisonResult | None:
    """The stored result with the same key as `wanted`; None without one."""
    key = {name: getattr(wanted, name) for name in KEY}
    record = Record.load(records / FOLDER / f"{wanted.name}.json", KIND, VERSION, key)
    return None if record is None else record.to(ComparisonResult)


def load(records: Path) -> list[ComparisonResult]:
    """All stored results of a scene, by method, precision, time and seed."""
    results = (record.to(ComparisonResult) for record in Record.load_all(records / FOLDER, KIND, VERSION).values())
    return sorted((r for r in results if r is not None), key=lambda r: (*r.row, r.minutes, r.seed))


def in_float32(results: Sequence[ComparisonResult]) -> list[ComparisonResult]:
    """The results without bfloat16 ones that have a float32 counterpart on the same terms and with the same seed."""
    whole = {(r.method, r.terms, r.seed) for r in results if r.precision == "float32" and not r.error}
    return [r for r in results if r.precision == "float32" or (r.method, r.terms, r.seed) not in whole]


def terms(results: Iterable[ComparisonResult]) -> list[Terms]:
    """All terms on which methods were trained, in order."""
    distinct = {r.terms for r in results if r.method != TRIVIAL}
    return sorted(distinct, key=lambda each: (each.device, each.size == "official", each.minutes))
