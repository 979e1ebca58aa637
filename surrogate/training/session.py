"""The session of a training: its clock, progress reports and checkpoints, and requests to stop it."""

from __future__ import annotations

import signal
import threading
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from types import FrameType, TracebackType
from typing import Any

import numpy as np

from catalogs.engines.stopping import StopRequested, stop_requested
from catalogs.progress import Rate, joined, per_second, time_left
from surrogate.settings import TrainingSettings
from surrogate.storage.checkpoints import Checkpoint
from surrogate.training.ranks import ALONE, Ranks
from surrogate.training.state import TrainingState

REPORT_SECONDS = 0.5
SIGNALS = (signal.SIGINT, signal.SIGTERM)


@dataclass(frozen=True)
class TrainingProgress:
    """The progress of a training.

    Attributes
    ----------
    stage : "loading", "canonical", "colour degree", "deformation" or "compression".
    step, steps : done and planned, over all stages; of the choices that are made at the end in "compression".
    rate : steps per second, lately; 0 before it is known.
    loss : running mean of the training loss.
    psnr : the last validation PSNR in dB; None before the first.
    seconds_left : at this rate; None before it is known.
    """

    stage: str
    step: int
    steps: int
    rate: float = 0.0
    loss: float | None = None
    psnr: float | None = None
    seconds_left: float | None = None

    def __str__(self) -> str:
        return joined(
            f"{self.stage:<11} {self.step:>6} / {self.steps}",
            per_second(self.rate, "steps"),
            "" if self.loss is None else f"loss {self.loss:.4f}",
            "" if self.psnr is None else f"validation {self.psnr:.2f} dB",
            time_left(self.seconds_left),
        )


ProgressReport = Callable[[TrainingProgress], None]


class Interruption:
    """Ctrl-C and SIGTERM as a request to stop, which training follows where it is safe.

    Within its `with` block the first SIGINT or SIGTERM only sets `requested`; a second one acts at once.  Outside the main thread
    Python delivers no signals; on the worker of an engine, training is to stop when its task was taken back.
    """

    def __init__(self) -> None:
        self.received: signal.Signals | None = None
        self._previous: dict[signal.Signals, object] = {}

    @property
    def requested(self) -> bool:
        return self.received is not None or stop_requested()

    def __enter__(self) -> Interruption:
        if threading.current_thread() is threading.main_thread():
            self._previous = {number: signal.signal(number, self._note) for number in SIGNALS}
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        self._restore()

    def act(self) -> None:
        """Do what was asked for: raise KeyboardInterrupt, SystemExit with 128 + SIGTERM, or StopRequested."""
        if self.received is signal.SIGINT:
            raise KeyboardInterrupt
        if self.received is signal.SIGTERM:
            raise SystemExit(128 + signal.SIGTERM)
        if stop_requested():
            raise StopRequested

    def join(self, received: Sequence[signal.Signals | None]) -> None:
        """Take what other processes `received` for received here, where nothing was."""
        self.received = self.received or next(filter(None, received), None)

    def _note(self, number: int, frame: FrameType | None) -> None:
        self.received = signal.Signals(number)
        self._restore()

    def _restore(self) -> None:
        for number, handler in self._previous.items():
            signal.signal(number, handler)  # type: ignore[arg-type]
        self._previous = {}


@dataclass(eq=False, repr=False)
class TrainingSession:
    """One process that trains in `directory`, for `steps` steps over all stages, together with the others of `ranks`.

    Earlier ones spent `before` seconds, and `processor_before` of all cores.
    """

    settings: TrainingSettings
    directory: Path
    fingerprint: str
    steps: int
    progress: ProgressReport
    interruption: Interruption
    before: float = 0.0
    processor_before: float = 0.0
    ranks: Ranks = ALONE

    def __post_init__(self) -> None:
        self._processor_started = time.process_time()
        self._started = self._saved = self._reported = time.perf_counter()
        self._rate = Rate()

    @property
    def seconds(self) -> float:
        """That training has taken so far, in this process and those before."""
        return self.before + time.perf_counter() - self._started

    def processor_seconds(self) -> float:
        """The same, of all cores of all processes together."""
        return self.processor_before + sum(self.ranks.gathered(time.process_time() - self._processor_started))

    @property
    def pause_is_due(self) -> bool:
        """True where a checkpoint is due: in the first process as the last is old, in any as training is to stop."""
        is_old = time.perf_counter() - self._saved > self.settings.checkpoint_seconds
        return self.interruption.requested or (self.ranks.is_first and is_old)

    def save(self, state: TrainingState) -> None:
        """Keep a checkpoint, and then stop where that was asked of any process.

        Raises RuntimeError, with nothing kept, where processes hold other numbers.
        """
        checkpoint = replace(state, seconds=self.seconds, processor_seconds=self.processor_seconds()).checkpoint(
            self.fingerprint
        )
        self._require_equal(checkpoint)
        self.ranks.by_first(lambda: checkpoint.save(self.directory))
        self._saved = time.perf_counter()
        self.interruption.join(self.ranks.gathered(self.interruption.received))
        self.interruption.act()

    def _require_equal(self, checkpoint: Checkpoint) -> None:
        """Raise RuntimeError where what is to be kept is not the same in all processes."""
        if self.ranks.count > 1:
            marks = self.ranks.gathered(checkpoint.digest())
            self.ranks.by_first(lambda: _require_one(marks))

    @property
    def report_is_due(self) -> bool:
        """True where the last one was a while ago."""
        return time.perf_counter() - self._reported >= REPORT_SECONDS

    def report(
        self,
        stage: str,
        step: int,
        losses: Sequence[float] | None = None,
        curve: Sequence[Mapping[str, Any]] = (),
        steps: int | None = None,
    ) -> None:
        """Report a step of `steps` (None: those of all stages); with `losses` also the rate and the mean loss."""
        psnr, steps = curve[-1]["psnr"] if curve else None, self.steps if steps is None else steps
        if losses is None:
            self.progress(TrainingProgress(stage, step, steps, psnr=psnr))
            return
        self._reported, rate = time.perf_counter(), self._rate(step)
        loss = float(np.mean(losses[-200:])) if losses else curve[-1]["loss"]
        self.progress(TrainingProgress(stage, step, steps, rate, loss, psnr, (steps - step) / rate if rate else None))


def _require_one(marks: Sequence[str]) -> None:
    """Raise RuntimeError naming the processes whose marks differ from the first one's."""
    others = ", ".join(str(rank) for rank, mark in enumerate(marks) if mark != marks[0])
    if others:
        raise RuntimeError(
            f"process {others} of this training came to other numbers than the first one: let all run on processors of one kind; "
            "the last checkpoint stays"
        )
