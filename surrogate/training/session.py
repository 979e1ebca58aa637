"""What surrounds the steps of a training: its clock, its progress line and its checkpoints."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from catalogs.progress import Rate
from surrogate.settings import TrainingSettings
from surrogate.training.interruption import Interruption
from surrogate.training.progress import ProgressReport, TrainingProgress
from surrogate.training.state import TrainingState

REPORT_SECONDS = 0.5


class Session:
    """One process that trains in `directory`, for `steps` steps over all stages; `before` seconds were spent by others."""

    def __init__(
        self,
        settings: TrainingSettings,
        directory: Path,
        fingerprint: str,
        steps: int,
        progress: ProgressReport,
        interruption: Interruption,
    ) -> None:
        self.settings, self.interruption, self.before = settings, interruption, 0.0
        self.fingerprint, self._directory, self._steps, self._progress = fingerprint, directory, steps, progress
        self._started = self._saved = self._reported = time.perf_counter()
        self._rate = Rate()

    @property
    def seconds(self) -> float:
        """That training has taken so far, in this process and those before."""
        return self.before + time.perf_counter() - self._started

    @property
    def checkpoint_is_due(self) -> bool:
        """Whether the last one is old, or training is to stop."""
        return self.interruption.requested or time.perf_counter() - self._saved > self.settings.checkpoint_seconds

    def save(self, state: TrainingState) -> None:
        """Keep a checkpoint, and then stop where that was asked for."""
        replace(state, seconds=self.seconds).checkpoint(self.fingerprint).save(self._directory)
        self._saved = time.perf_counter()
        self.interruption.act()

    @property
    def report_is_due(self) -> bool:
        """Whether the last one was a while ago."""
        return time.perf_counter() - self._reported >= REPORT_SECONDS

    def report(
        self,
        stage: str,
        step: int,
        losses: Sequence[float] = (),
        curve: Sequence[Mapping[str, Any]] = (),
        *,
        steps: int | None = None,
        speed: bool = False,
    ) -> None:
        """Tell where training is, of so many `steps` (None: of all stages); with `speed` also how fast and how well it learns."""
        psnr, steps = curve[-1]["psnr"] if curve else None, self._steps if steps is None else steps
        if not speed:
            self._progress(TrainingProgress(stage, step, steps, psnr=psnr))
            return
        self._reported, rate = time.perf_counter(), self._rate(step)
        loss = float(np.mean(losses[-200:])) if losses else curve[-1]["loss"]
        self._progress(TrainingProgress(stage, step, steps, rate, loss, psnr, (steps - step) / rate if rate else None))
