"""Which factor on its rates a method does best with: short trainings on one scene, judged by validation images."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TypeVar

from catalogs.files import durable
from research.studies.baselines.method import PRECISIONS, Plan
from research.studies.comparison.contestants import Contestant, Report, TrainingContext, emptied, validation
from research.studies.comparison.task import ComparisonTask
from surrogate.storage.records import Provenance, Record
from surrogate.training.loop import Diverged

KIND, VERSION, FOLDER = "tuning", 1, "tuning"  # of the records of all scenes
KEY = ("method", "size", "precision")
RATES = (0.1, 0.3, 1.0, 3.0, 10.0)
SECONDS = 60.0
DIVERGED = "diverged"  # a file, beside a training's other files


@dataclass(frozen=True)
class Tuning:
    """What short trainings of a method found.

    Attributes
    ----------
    scene : that it was tuned on.
    seconds : of processor time that each training was given.
    decibels : at validation images by the factor on its rates, as text; None where it diverged.
    """

    method: str
    size: str
    precision: str
    scene: str
    seconds: float
    decibels: Mapping[str, float | None]
    provenance: Provenance = field(default_factory=Provenance)

    @property
    def rate(self) -> float:
        """The best factor."""
        found = {float(rate): psnr for rate, psnr in self.decibels.items() if psnr is not None}
        return max(found, key=lambda rate: found[rate]) if found else 1.0


def tune(
    contestant: Contestant,
    task: ComparisonTask,
    scene: str,
    plan: Plan,
    folder: Path,
    shared: Path,
    *,
    report: Report = lambda *_: None,
    tell: Callable[[float, float | None], None] = lambda *_: None,
) -> Tuning:
    """Train a contestant once for each of `RATES` in `folder`, for a minute each; `shared` holds what trainings start from."""
    decibels = dict[str, float | None]()
    for rate in RATES:
        try:
            form = replace(plan, rate=rate)
            trained = contestant.trained(
                task, form, SECONDS, TrainingContext(emptied(folder / "fit"), shared, report=report)
            )
            psnr: float | None = validation(task, trained.predictor)
        except ValueError:
            psnr = None
        decibels[f"{rate:g}"] = psnr
        tell(rate, psnr)
    made = Provenance.now()
    return Tuning(contestant.name, plan.size, plan.precision, scene, SECONDS, decibels, made)


Made = TypeVar("Made")


def rates_from(rate: float) -> list[float]:
    """A factor on a method's rates, and the lower ones of `RATES`: longer trainings diverge where a minute's did well."""
    return [rate, *(lower for lower in reversed(RATES) if lower < rate)]


def at_rates_that_hold(rates: Sequence[float], work: Path, made: Callable[[float, Path], Made]) -> Made:
    """What is made at the first of the `rates` that does not diverge; each has a folder of its own in `work`.

    Which did diverge is kept, so that a training that was interrupted goes on with the rate that it was at.  Raises `Diverged`
    where all do.
    """
    for rate in rates:
        folder = work / f"rate {rate:g}"
        if (folder / DIVERGED).exists():
            continue
        try:
            durable.make_folder(folder)
            return made(rate, folder)
        except Diverged as error:
            durable.replace(folder / DIVERGED, str(error).encode())
    raise Diverged((folder / DIVERGED).read_text())


def save(records: Path, tuning: Tuning) -> None:
    """Keep it in the folder of all records."""
    Record.of(KIND, VERSION, tuning, KEY).save(
        records / FOLDER / f"{tuning.method}.{tuning.size}.{tuning.precision}.json"
    )


def find(records: Path, method: str, plan: Plan) -> Tuning | None:
    """What is kept of a method in this size, in this precision or else in the other; None where nobody tuned it."""
    for precision in sorted(PRECISIONS, key=lambda each: each != plan.precision):
        key = {"method": method, "size": plan.size, "precision": precision}
        record = Record.load(records / FOLDER / f"{method}.{plan.size}.{precision}.json", KIND, VERSION, key)
        if record is not None:
            return record.to(Tuning)
    return None


def load(records: Path) -> list[Tuning]:
    """All that is kept, by method."""
    found = (record.to(Tuning) for record in Record.load_all(records / FOLDER, KIND, VERSION).values())
    return [tuning for tuning in found if tuning is not None]
