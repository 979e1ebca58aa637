"""The contestants: the surrogate as `surrogate train --minutes` trains it, and published methods with their own training."""

from __future__ import annotations

import math
import shutil
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any, Protocol

import safetensors.torch
import torch
from torch import Tensor

from catalogs.files import durable
from catalogs.vocabulary.variations import KINDS
from research.studies.baselines.method import Fit, Method, Plan, Precision
from research.studies.comparison.fitting import CheckpointPath, Clock, FinishedFit, Point, fit_in_time
from research.studies.comparison.predictor import FitPredictor, measure
from research.studies.comparison.task import WATCHED, ComparisonTask
from surrogate.evaluation.cases import Case
from surrogate.evaluation.predictor import Predictor, SurrogatePredictor
from surrogate.evaluation.scoring import mean, score_cases
from surrogate.evaluation.timing import Milliseconds
from surrogate.model import Surrogate
from surrogate.settings import TrainingSettings
from surrogate.splatting.threads import one_torch_thread, torch_threads
from surrogate.storage.checkpoints import CHECKPOINT
from surrogate.storage.tensors import read_tensors, tensors_of
from surrogate.training.begin import TrainingOptions, begin
from surrogate.training.budget import Budget
from surrogate.training.run import train

BYTES = 4  # of a stored number
MOST_OFF = 1.15  # a training that misses its time by more than this factor is repeated with as many steps as fit
CHANGE_AND_VIEW = tuple[Milliseconds, Milliseconds]
Report = Callable[[str, int, int], None]  # stage, done, total


@dataclass(frozen=True)
class TrainingContext:
    """The folders, device and limits of a training.

    Attributes
    ----------
    work : its own folder, which also holds the checkpoint of an interrupted training.
    shared : folder of tensors that several trainings start from.
    device : "cpu", where processor time is counted, or "cuda", where wall-clock time is.
    until : `time.monotonic()` at which a published method stops; it can be resumed later.
    report : called with the progress of the training.
    """

    work: Path
    shared: Path
    device: str = "cpu"
    until: float = math.inf
    report: Report = lambda *_: None

    @property
    def clock(self) -> Clock:
        """Processor time; on a GPU wall-clock time, after the device has finished its work."""
        return time.process_time if self.device == "cpu" else _after_the_device


def _after_the_device() -> float:
    torch.cuda.synchronize()
    return time.perf_counter()


@dataclass(frozen=True, eq=False)
class TrainedContestant:
    """A contestant after its training.

    Attributes
    ----------
    predictor : predicts test images.
    measured : times an image at other parameters, and another view.
    plan : the steps, rate, size and precision that it was trained with.
    megabytes : size of the trained model, 10^6 bytes.
    seconds : that training took.
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
        """Name on the command line and in file names."""

    @property
    def title(self) -> str:
        """Title in tables."""

    @property
    def source(self) -> str:
        """The publication, or a description."""

    @property
    def official_steps(self) -> int:
        """Published number of training steps; 0 for a method that is not published."""

    @property
    def precision(self) -> Precision:
        """Preferred precision of its networks; see `precision_here`."""

    @property
    def is_tuned(self) -> bool:
        """True if its rates are chosen by short trainings."""

    @property
    def steps_of(self) -> str:
        """Name of the contestant whose number of steps it takes, whatever time that needs; "" for as many as fit."""

    def trained(
        self, task: ComparisonTask, plan: Plan, seconds: float | None, session: TrainingContext
    ) -> TrainedContestant:
        """Train for about `seconds`, with as many steps as fit; without `seconds`, with the steps of `plan`."""


def precision_here(preferred: Precision, device: str) -> Precision:
    """The preferred precision, or float32 on a processor that does not multiply in bfloat16.

    Torch emulates it there, and takes longer than in float32.
    """
    capabilities: Mapping[str, Any] = getattr(torch.cpu, "get_capabilities", dict)()
    multiplies = device != "cpu" or any(capabilities.get(name) for name in ("avx512_bf16", "amx_bf16", "bf16"))
    return preferred if multiplies else "float32"


@dataclass(frozen=True)
class OurSurrogate:
    """The surrogate of this project; the pilot and all choices are on the clock.

    With `steps_of`, or without a time, the plan gives the number of steps.
    """

    name: str
    title: str
    source: str
    official_steps: int = 0
    precision: Precision = "float32"
    is_tuned: bool = False
    steps_of: str = ""

    def trained(
        self, task: ComparisonTask, plan: Plan, seconds: float | None, session: TrainingContext
    ) -> TrainedContestant:
        """See `Contestant`."""
        clock = session.clock
        begun = clock()

        def elapsed() -> float:
            return clock() - begun

        def at(case: Case) -> Callable[[Case], object]:
            deformed = surrogate.at({**case.member.parameters, **case.varied})
            return lambda other: deformed.render(other.camera)

        settings = {"seed": plan.seed, "validation_images": WATCHED, "device": session.device}
        budget = Budget(steps=plan.steps) if seconds is None or self.steps_of else Budget(minutes=seconds / 60.0)
        run = begin(
            task.catalog.path,
            emptied(session.work) / "run",
            TrainingOptions(budget, settings=settings),
            elapsed=elapsed,
        )
        planned = elapsed()
        surrogate = train(
            run.settings, run.catalog, run.model, progress=lambda now: session.report(now.stage, now.step, now.steps)
        ).to(session.device)
        taken = elapsed()
        return TrainedContestant(
            SurrogatePredictor(surrogate.at, task.catalog.plan.background),
            lambda: measure(at, task.cases),
            replace(plan, steps=surrogate.training["steps"]),
            surrogate.megabytes,
            taken,
            curve_of(surrogate, task, planned, session.device),
        )


@dataclass(frozen=True)
class EmulatedFieldAlone:
    """The emulator of the members' coarse fields, drawn by the ray caster; it takes seconds, whatever time there is."""

    name: str
    title: str
    source: str
    official_steps: int = 0
    precision: Precision = "float32"
    is_tuned: bool = False
    steps_of: str = ""

    def trained(
        self, task: ComparisonTask, plan: Plan, seconds: float | None, session: TrainingContext
    ) -> TrainedContestant:
        """See `Contestant`; raises ValueError where the members keep no coarse fields."""
        settings = TrainingSettings(seed=plan.seed)
        surrogate = train(settings, task.catalog, emptied(session.work) / "run", only_field=True)

        def at(case: Case) -> Callable[[Case], object]:
            member = surrogate.at({**case.member.parameters, **case.varied}, outside="allow")
            return lambda other: member.render(other.camera)

        return TrainedContestant(
            SurrogatePredictor(partial(surrogate.at, outside="allow"), task.catalog.plan.background),
            lambda: measure(at, task.cases),
            replace(plan, steps=1),
            surrogate.megabytes,
            surrogate.training["processor_seconds" if session.device == "cpu" else "seconds"],
        )


@dataclass(frozen=True)
class Recorded:
    """A contestant of which only records are left: tables and plots show them, and nothing trains it any more."""

    name: str
    title: str
    source: str
    official_steps: int = 0
    precision: Precision = "bfloat16"
    is_tuned: bool = False
    steps_of: str = ""

    def trained(
        self, task: ComparisonTask, plan: Plan, seconds: float | None, session: TrainingContext
    ) -> TrainedContestant:
        """Raises ValueError: its code was removed."""
        raise ValueError(f"{self.name} can't be trained any more: only its records are left")


def curve_of(surrogate: Surrogate, task: ComparisonTask, planned: float, device: str) -> list[tuple[float, float]]:
    """Seconds, including planning, and dB at validation images of the compared appearance."""
    clock = "processor_seconds" if device == "cpu" else "seconds"
    compared = None if task.variation is None else task.variation.kind
    return [
        (planned + point[clock], point["psnr"])
        for point in surrogate.training["curve"]
        if point["psnr"] is not None and (point["stage"] if point["stage"] in KINDS else None) == compared
    ]


@dataclass(frozen=True)
class Published:
    """A published method."""

    method: Method
    precision: Precision = "float32"
    clock: Clock | None = None  # by default that of the context

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

    def trained(
        self, task: ComparisonTask, plan: Plan, seconds: float | None, session: TrainingContext
    ) -> TrainedContestant:
        """See `Contestant`."""
        prepared, identity = self._prepared(task, plan.seed, session), f"{task.mark}, {self.name}, {plan}, {seconds}"

        def look(fit: Fit) -> float:
            return validation(task, FitPredictor(fit, task))

        def fitted(plan: Plan, seconds: float | None) -> FinishedFit:
            return fit_in_time(
                self.method,
                lambda: task.pictures(session.device),
                plan,
                prepared,
                seconds,
                look,
                clock=self.clock or session.clock,
                report=lambda step, steps: session.report(self.title, step, steps),
                place=CheckpointPath(session.work, identity, session.until),
            )

        with torch_threads(plan.threads):
            result = fitted(plan, seconds)
            if seconds is not None and not 1.0 / MOST_OFF <= result.seconds / seconds <= MOST_OFF:
                steps = max(1, int(result.plan.steps * seconds / result.seconds))
                (session.work / CHECKPOINT).unlink(missing_ok=True)  # the repeated training must not resume it
                result = fitted(replace(plan, steps=steps), None)
        predictor = FitPredictor(result.fit, task, (self.title,))
        megabytes = BYTES * sum(tensor.numel() for tensor in result.fit.tensors().values()) / 1e6
        return TrainedContestant(
            predictor,
            lambda: measure(predictor.at, task.cases),
            result.plan,
            megabytes,
            result.seconds,
            list(result.curve),
        )

    def _prepared(self, task: ComparisonTask, seed: int, session: TrainingContext) -> Mapping[str, Tensor]:
        """The tensors that the method starts from, computed once per seed and stored."""
        if self.method.prepare is None:
            return {}
        path = session.shared / f"{self.method.prepare.__name__}.seed{seed}.safetensors"
        durable.make_folder(session.shared)
        with durable.locked(session.shared / f".{path.name}.lock"):
            if not path.exists():
                session.report(f"initial state of {self.title}", 0, 1)
                with one_torch_thread():
                    initial = self.method.prepare(task.pictures(session.device), seed)
                durable.replace(path, safetensors.torch.save({name: tensor.cpu() for name, tensor in initial.items()}))
        with path.open("rb") as file:
            stored = tensors_of(read_tensors(file, path.stat().st_size))
        return {name: tensor.to(session.device) for name, tensor in stored.items()}


@one_torch_thread()
def validation(task: ComparisonTask, predictor: Predictor) -> float:
    """Mean PSNR (dB) of the validation images; nan without any."""
    [scores] = score_cases(predictor, task.catalog, task.watched)
    psnr = mean(scores.values(), "psnr")
    return float("nan") if psnr is None else psnr


def emptied(folder: Path) -> Path:
    """The folder, created or emptied."""
    shutil.rmtree(folder, ignore_errors=True)
    durable.make_folder(folder)
    return folder
