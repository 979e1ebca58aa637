"""Scores of models while choices are made about them, and models after a few more steps."""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable
from dataclasses import dataclass, replace

import torch
from torch import Tensor

from surrogate.evaluation.metrics import WHITE
from surrogate.gaussians import Gaussians
from surrogate.rasterizer import Rasterizer
from surrogate.settings import TrainingSettings
from surrogate.training.compression.choice import MeasuredModel
from surrogate.training.data import Example, TrainingData
from surrogate.training.loop import StageRun, mean_psnr
from surrogate.training.stages import FINAL_FACTOR, simulation_stage
from surrogate.training.state import FittedGaussians

TIMED = 8  # pictures
RECOVERY_RATE = 0.05  # of stage 2's rates, with which a fine-tuning begins
RECOVERY_FRACTION = 0.02  # of all steps, for which a model is fine-tuned after each choice
RECOVERY_DECAY = 0.3  # of these in it


@dataclass(frozen=True, eq=False, repr=False)
class Evaluator:
    """Scores models on validation images and fine-tunes them; `settings` are those of the whole training."""

    settings: TrainingSettings
    data: TrainingData

    @property
    def tolerance(self) -> float:
        """The loss in dB that a choice may cause."""
        return self.settings.need_tolerance

    def steps(self, fraction: float) -> int:
        """A part of the steps of stages 1 and 2, at least one."""
        return max(1, round(fraction * (self.settings.canonical_steps + self.settings.deformation_steps)))

    def psnr(self, fitted: FittedGaussians) -> float:
        """Mean over the validation images, in dB."""
        return self.psnr_of(fitted.at)

    def psnr_of(self, gaussians_at: Callable[[Tensor], Gaussians]) -> float:
        """The same for the Gaussians at normalized parameters (P,)."""
        data = self.data
        return mean_psnr(gaussians_at, data.validation, self.rasterizer, data.background or WHITE, data.ranks)

    def measure(
        self, fitted: FittedGaussians, psnr: float | None = None, megabytes: float | None = None
    ) -> MeasuredModel:
        """Quality, size and speed of a model."""
        every = self.data.validation
        some = every[:: max(1, len(every) // TIMED)][:TIMED]
        return MeasuredModel(
            self.psnr(fitted) if psnr is None else psnr,
            fitted.megabytes if megabytes is None else megabytes,
            statistics.median(self._milliseconds(fitted, example) for example in some),
        )

    def fine_tuned(self, fitted: FittedGaussians, turn: int) -> FittedGaussians:
        """A copy after a few more steps at low rates; `turn` decides on which images."""
        steps = self.steps(RECOVERY_FRACTION)
        return self._trained(fitted, steps, turn, RECOVERY_RATE, RECOVERY_DECAY)

    def settled(self, fitted: FittedGaussians, steps: int) -> FittedGaussians:
        """A copy whose training was brought to an early end: in `steps` its rates decay as those of stage 2 do."""
        return self._trained(fitted, steps, 0, 1.0, FINAL_FACTOR)

    def _trained(self, fitted: FittedGaussians, steps: int, turn: int, start: float, decay: float) -> FittedGaussians:
        settings = self.settings.changed(
            seed=self.settings.seed + 1 + turn,
            deformation_steps=steps,
            relocation_interval=0,
        )
        copy = fitted.copy()
        stage = simulation_stage(*copy, settings)
        rates = {name: start * rate for name, rate in stage.rates.items()}
        stage = replace(stage, rates=rates, final_factor=decay)
        StageRun(stage, settings, self.data).finish()
        return copy.copy()

    @property
    def rasterizer(self) -> Rasterizer:
        """The rasterizer that draws a model where it is, on a GPU or in main memory."""
        return Rasterizer.of(self.settings).for_any_device()

    def _milliseconds(self, fitted: FittedGaussians, example: Example) -> float:
        with torch.no_grad():
            started = time.perf_counter()
            self.rasterizer.draw(fitted.at(example.parameters), example.camera).color.cpu()  # which waits for a GPU
            return 1e3 * (time.perf_counter() - started)
