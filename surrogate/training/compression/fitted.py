"""A model while choices are made on it."""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import torch
from torch import Tensor

from surrogate.deformation import Deformation
from surrogate.evaluation.metrics import WHITE
from surrogate.gaussians import Gaussians
from surrogate.rasterizer import Rasterizer
from surrogate.settings import TrainingSettings
from surrogate.training.compression.choice import Measured
from surrogate.training.data import Example, TrainingData
from surrogate.training.loop import StageRun
from surrogate.training.stages import simulation_stage
from surrogate.training.validation import mean_psnr

TIMED = 8  # pictures
RECOVERY_DECAY = 0.3  # of the rates in a recovery, which begins with those of stage 2's end


class Fitted(NamedTuple):
    """Canonical Gaussians and their deformation."""

    gaussians: Gaussians
    deformation: Deformation

    def copy(self) -> Fitted:
        """The same numbers in tensors of their own."""
        return Fitted(self.gaussians.copy(), self.deformation.copy())

    def to(self, device: torch.device) -> Fitted:
        """The same on another device."""
        return Fitted(self.gaussians.to(device), self.deformation.to(device))

    def at(self, parameters: Tensor) -> Gaussians:
        """The Gaussians at normalized parameters (P,)."""
        return self.deformation.deformed(self.gaussians, parameters)

    def without(self, attribute: str) -> Fitted:
        """The same with one of the Gaussians' attributes held still."""
        return Fitted(self.gaussians, self.deformation.without(attribute))

    def of(self, rows: Tensor) -> Fitted:
        """The same with only some Gaussians, by index (M,)."""
        return Fitted(self.gaussians.of(rows), self.deformation.of(rows))

    def tensors(self) -> dict[str, Tensor]:
        """All that would be stored."""
        kept = {f"gaussians.{name}": tensor for name, tensor in self.gaussians.tensors().items()}
        return kept | {f"deformation.{name}": tensor for name, tensor in self.deformation.stored().items()}

    @property
    def megabytes(self) -> float:
        """10^6 bytes in float32."""
        return 4e-6 * sum(tensor.numel() for tensor in self.tensors().values())


@dataclass(frozen=True, eq=False)
class Bench:
    """What models are tried on: images to learn from and to judge by, and how a model recovers from a change.

    `settings` are those of the whole training.
    """

    settings: TrainingSettings
    data: TrainingData

    @property
    def tolerance(self) -> float:
        """What a choice may cost, in dB."""
        return self.settings.compression.tolerance

    @property
    def recovery_steps(self) -> int:
        """How many steps a model is given after it lost something."""
        return self.steps(self.settings.compression.recovery_fraction)

    def steps(self, fraction: float) -> int:
        """A part of the steps of the whole training, at least one."""
        return max(1, round(fraction * (self.settings.steps.canonical + self.settings.steps.deformation)))

    def psnr(self, fitted: Fitted) -> float:
        """Mean over the validation images, in dB."""
        return self.psnr_of(fitted.at)

    def psnr_of(self, gaussians_at: Callable[[Tensor], Gaussians]) -> float:
        """The same for the Gaussians at normalized parameters (P,)."""
        return mean_psnr(gaussians_at, self.data.validation, self.rasterizer, self.behind)

    def measure(self, fitted: Fitted, psnr: float | None = None, megabytes: float | None = None) -> Measured:
        """Quality, size and speed of a model."""
        return Measured(
            self.psnr(fitted) if psnr is None else psnr,
            fitted.megabytes if megabytes is None else megabytes,
            statistics.median(self._milliseconds(fitted, example) for example in self.some(TIMED)),
        )

    def good_enough(self, fitted: Fitted, enough: float, turn: int) -> tuple[Fitted, float, str]:
        """A changed model as it is if it reaches `enough` dB, else after a recovery; its mean PSNR, and what to say of it."""
        psnr = self.psnr(fitted)
        if psnr >= enough:
            return fitted, psnr, ""
        fitted = self.recovered(fitted, turn)
        return fitted, self.psnr(fitted), ", after a recovery"

    def recovered(self, fitted: Fitted, turn: int) -> Fitted:
        """A copy that was trained for a few more steps at the low rates of stage 2's end; `turn` decides on which images."""
        start = self.settings.rates.final_factor
        return self._trained(fitted, self.recovery_steps, turn, start, RECOVERY_DECAY)

    def settled(self, fitted: Fitted, steps: int) -> Fitted:
        """A copy whose training was brought to an early end: in so many steps its rates decay as stage 2 lets them."""
        return self._trained(fitted, steps, 0, 1.0, self.settings.rates.final_factor)

    def _trained(self, fitted: Fitted, steps: int, turn: int, start: float, decay: float) -> Fitted:
        settings = self.settings.changed(
            seed=self.settings.seed + 1 + turn,
            deformation_steps=steps,
            relocation_interval=0,
            final_rate_factor=decay,
        )
        copy = fitted.copy()
        stage = simulation_stage(*copy, settings)
        stage = replace(stage, rates={name: start * rate for name, rate in stage.rates.items()})
        run = StageRun(stage, settings, self.data)
        while run.step < stage.steps:
            run.advance()
        for tensor in stage.tensors.values():
            tensor.requires_grad_(False)
        return copy

    def some(self, count: int) -> Sequence[Example]:
        """At most so many validation images, spread evenly."""
        every = self.data.validation
        return every[:: max(1, len(every) // count)][:count]

    @property
    def rasterizer(self) -> Rasterizer:
        """What draws a model where it is, on a GPU or in main memory."""
        return Rasterizer.of(self.settings).for_any_device()

    @property
    def behind(self) -> tuple[float, float, float]:
        return self.data.background or WHITE

    def _milliseconds(self, fitted: Fitted, example: Example) -> float:
        with torch.no_grad():
            started = time.perf_counter()
            self.rasterizer.draw(fitted.at(example.parameters), example.camera).color.cpu()  # which waits for a GPU
            return 1e3 * (time.perf_counter() - started)
