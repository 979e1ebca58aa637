"""Choice of the best factor on a method's rates, by short trainings on one scene judged by validation images."""

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

KIND, VERSION, FOLDER = "tuning", 1, "tuning"  # below the folder of all records
KEY = ("method", "size", "precision")
RATES = (0.1, 0.3, 1.0, 3.0, 10.0)
SECONDS = 60.0
DIVERGED = "diverged"  # a marker file in a training's folder


@dataclass(frozen=True)
class Tuning:
    """The outcome of a method's short trainings.

    Attributes
    ----------
    scene : the scene of the trainings.
    seconds : processor time of each training.
    decibels : PSNR of validation images by the factor on the rates, as text; None where training diverged.
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
        scores = {float(rate): psnr for rate, psnr in self.decibels.items() if psnr is not None}
        return max(scores, key=lambda rate: scores[rate]) if scores else 1.0


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
    """Train a contestant for a minute at each of `RATES` in `folder`; `shared` holds the tensors that trainings start from."""
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
    """The factor and all lower `RATES`: a longer training may diverge at a rate that suits a minute."""
    return [rate, *(lower for lower in reversed(RATES) if lower < rate)]


def at_rates_that_hold(rates: Sequence[float], work: Path, made: Callable[[float, Path], Made]) -> Made:
    """The result of `made` at the first of the `rates` that does not diverge, each in its own folder of `work`.

    Diverged rates are marked, so that an interrupted training resumes at its own rate. Raises `Diverged` where all
    rates diverge.
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
    """Store a tuning in the folder of all records."""
    Record.of(KIND, VERSION, tuning, KEY).save(
        records / FOLDER / f"{tuning.method}.{tuning.size}.{tuning.precision}.json"
    )


def find(records: Path, method: str, plan: Plan) -> Tuning | None:
    """The stored tuning of a method in this size, preferably in the plan's precision; None without one."""
    for precision in sorted(PRECISIONS, key=lambda each: each != plan.precision):
        key = {"method": method, "size": plan.size, "precision": precision}
        record = Record.load(records / FOLDER / f"{method}.{plan.size}.{precision}.json", KIND, VERSION, key)
        if record is not None:
            return record.to(Tuning)
    return None


def load(records: Path) -> list[Tuning]:
    """All stored tunings, by method."""
    tunings = (record.to(Tuning) for record in Record.load_all(records / FOLDER, KIND, VERSION).values())
    return [tuning for tuning in tunings if tuning is not None]
