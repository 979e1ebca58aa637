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

    def announce(
        self, stage: str, step: int, steps: int | None = None, curve: Sequence[Mapping[str, Any]] = ()
    ) -> None:
        """Tell what begins."""
        psnr = curve[-1]["psnr"] if curve else None
        self._progress(TrainingProgress(stage, step, self._steps if steps is None else steps, psnr=psnr))

    def report(self, stage: str, step: int, losses: Sequence[float], curve: Sequence[Mapping[str, Any]]) -> None:
        """Tell how far a stage is, unless that was told only just now."""
        now = time.perf_counter()
        if now - self._reported < REPORT_SECONDS:
            return
        self._reported, rate = now, self._rate(step)
        self._progress(
            TrainingProgress(
                stage=stage,
                step=step,
                steps=self._steps,
                rate=rate,
                loss=float(np.mean(losses[-200:])) if losses else curve[-1]["loss"],
                psnr=curve[-1]["psnr"] if curve else None,
                seconds_left=(self._steps - step) / rate if rate else None,
            )
        )
