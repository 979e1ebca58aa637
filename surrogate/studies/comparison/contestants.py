"""Who is compared: the surrogate as `surrogate train --minutes` trains it, and published methods, each with its own training."""

from __future__ import annotations

import shutil
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Protocol

import safetensors.torch
from torch import Tensor

from catalogs import durable
from surrogate.evaluation.predictor import Predictor, SurrogatePredictor
from surrogate.evaluation.scoring import mean, score_cases
from surrogate.evaluation.timing import Milliseconds
from surrogate.evaluation.timing import measure as measure_surrogate
from surrogate.splatting.threads import one_torch_thread, torch_threads
from surrogate.storage.tensors import read_tensors, tensors_of
from surrogate.studies.baselines.method import Fit, Method, Plan, Precision
from surrogate.studies.comparison.fitting import Clock, Point, fit_in_time
from surrogate.studies.comparison.predictor import FitPredictor, measure
from surrogate.studies.comparison.task import WATCHED, Task
from surrogate.training.begin import Asked, begin
from surrogate.training.budget import Budget
from surrogate.training.run import train

BYTES = 4  # of a stored number
CHANGE_AND_VIEW = tuple[Milliseconds, Milliseconds]
Report = Callable[[str, int, int], None]  # what, done, of how many


@dataclass(frozen=True, eq=False)
class Trained:
    """A contestant after its training.

    Attributes
    ----------
    predictor : of test images.
    measured : times of a picture at other parameters, and of another view.
    plan : the steps, rate, size and precision that it was trained with.
    megabytes : of what must be kept, 10^6 bytes.
    seconds : on the clock.
    curve : seconds and dB at validation images.
    """

    predictor: Predictor
    measured: Callable[[], CHANGE_AND_VIEW]
    plan: Plan
    megabytes: float
    seconds: float
    curve: Sequence[Point] = ()


class Contestant(Protocol):
    """One row of the tables."""

    @property
    def name(self) -> str:
        """On the command line and in file names."""

    @property
    def title(self) -> str:
        """In tables."""

    @property
    def source(self) -> str:
        """The publication, or what else it is."""

    @property
    def official_steps(self) -> int:
        """How many were published; 0 where nobody published any."""

    @property
    def precision(self) -> Precision:
        """Of its networks: what a processor that multiplies in bfloat16 trains them faster in."""

    @property
    def is_tuned(self) -> bool:
        """Whether its rates are chosen by trial."""

    @property
    def steps_of(self) -> str:
        """The contestant whose number of steps it takes, whatever time that needs; "" for as many as fit."""

    def trained(self, task: Task, plan: Plan, seconds: float, work: Path, shared: Path, report: Report) -> Trained:
        """Train for about `seconds` of processor time by `plan`, but for its steps, in the empty folder `work`.

        `shared` holds what several trainings start from.
        """


@dataclass(frozen=True)
class OurSurrogate:
    """The surrogate of this project under some settings of its `[training]` table; the pilot and all choices are on the clock.

    With `steps_of` it makes as many steps as the plan says.
    """

    name: str
    title: str
    source: str
    settings: Mapping[str, Any] = field(default_factory=dict)
    official_steps: int = 0
    precision: Precision = "float32"
    is_tuned: bool = False
    steps_of: str = ""

    def trained(self, task: Task, plan: Plan, seconds: float, work: Path, shared: Path, report: Report) -> Trained:
        """See `Contestant`."""
        begun = time.process_time()

        def elapsed() -> float:
            return time.process_time() - begun

        settings = {"seed": plan.seed, "validation_images": WATCHED, **self.settings}
        budget = Budget(steps=plan.steps) if self.steps_of else Budget(minutes=seconds / 60.0)
        run = begin(task.catalog.path, work / "run", Asked(budget, settings=settings), elapsed=elapsed)
        surrogate = train(
            run.settings, run.catalog, run.model, progress=lambda now: report(now.stage, now.step, now.steps)
        )
        taken, members = elapsed(), task.catalog.members
        shown = [dict(case.varied) for cases in task.cells.values() for case in cases]
        curve = surrogate.training["curve"]
        return Trained(
            SurrogatePredictor(surrogate.at, task.catalog.plan.background),
            lambda: measure_surrogate(surrogate, members, shown),
            replace(plan, steps=surrogate.training["steps"]),
            surrogate.megabytes,
            taken,
            [(point["seconds"], point["psnr"]) for point in curve if point["psnr"] is not None],
        )


@dataclass(frozen=True)
class Published:
    """A published method."""

    method: Method
    precision: Precision = "float32"
    clock: Clock = time.process_time

    @property
    def name(self) -> str:
        """See `Contestant`."""
        return self.method.name

    @property
    def title(self) -> str:
        """See `Contestant`."""
        return self.method.title

    @property
    def source(self) -> str:
        """See `Contestant`."""
        return self.method.source

    @property
    def official_steps(self) -> int:
        """See `Contestant`."""
        return self.method.official_steps

    is_tuned, steps_of = True, ""

    def trained(self, task: Task, plan: Plan, seconds: float, work: Path, shared: Path, report: Report) -> Trained:
        """See `Contestant`."""
        prepared = self._prepared(task, plan.seed, shared, report)

        def look(fit: Fit) -> float:
            return validation(task, FitPredictor(fit, task))

        with torch_threads(plan.threads):
            found = fit_in_time(
                self.method,
                task.pictures,
                plan,
                prepared,
                seconds,
                look,
                clock=self.clock,
                report=lambda step, steps: report(self.title, step, steps),
            )
        predictor = FitPredictor(found.fit, task, (self.title,))
        cases = [case for cases in task.cells.values() for case in cases]
        megabytes = BYTES * sum(tensor.numel() for tensor in found.fit.tensors().values()) / 1e6
        return Trained(
            predictor, lambda: measure(predictor, cases), found.plan, megabytes, found.seconds, list(found.curve)
        )

    def _prepared(self, task: Task, seed: int, shared: Path, report: Report) -> Mapping[str, Tensor]:
        """What the method starts from: made once for a seed, and kept in `shared`."""
        if self.method.prepare is None:
            return {}
        path = shared / f"{self.method.prepare.__name__}.seed{seed}.safetensors"
        durable.make_folder(shared)
        with durable.locked(shared / f".{path.name}.lock"):
            if not path.exists():
                report(f"what {self.title} starts from", 0, 1)
                with one_torch_thread():
                    durable.replace(path, safetensors.torch.save(dict(self.method.prepare(task.pictures(), seed))))
        with path.open("rb") as file:
            return tensors_of(read_tensors(file, path.stat().st_size))


@one_torch_thread()
def validation(task: Task, predictor: Predictor) -> float:
    """Mean PSNR (dB) of the validation images that all look at; nan without any."""
    [found] = score_cases(predictor, task.catalog, task.watched)
    psnr = mean(found.values(), "psnr")
    return float("nan") if psnr is None else psnr


def emptied(folder: Path) -> Path:
    """The folder, made or without what an earlier process left in it."""
    shutil.rmtree(folder, ignore_errors=True)
    durable.make_folder(folder)
    return folder
