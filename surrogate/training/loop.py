"""One stage of training, step by step, with all the state that it must remember between steps."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import torch
from torch import Tensor

from surrogate.evaluation.metrics import WHITE
from surrogate.gaussians import Gaussians
from surrogate.randomness import generator
from surrogate.rasterizer import Rasterizer
from surrogate.settings import TrainingSettings
from surrogate.training.data import Example, TrainingData
from surrogate.training.divergence import as_drawn, divergence, first_infinite
from surrogate.training.losses import deformation_size, image_loss
from surrogate.training.optimizer import Adam
from surrogate.training.relocation import plan_relocation, relocate
from surrogate.training.sampling import HardExamples, ShuffledEpochs
from surrogate.training.screen_gradients import ScreenGradients
from surrogate.training.stages import Stage
from surrogate.training.validation import mean_psnr


@dataclass(frozen=True, eq=False, repr=False)
class LoopMemory:
    """What the loop remembers after `step` steps of a stage, beside what it trains.

    `tensors` are Adam's moments, the recent largest opacities, screen gradients and the images' errors, as far as there are any.
    """

    step: int
    tensors: Mapping[str, Tensor]

    def with_color_columns(self, count: int) -> LoopMemory:
        """The same for colours of `count` columns, those that are new without moments."""
        moments = {n: t for n, t in self.tensors.items() if n in ("moments.first.colors", "moments.second.colors")}
        wider = {n: torch.nn.functional.pad(t, (0, count - t.shape[1])) for n, t in moments.items()}
        return LoopMemory(self.step, {**self.tensors, **wider})


class StageRun:
    """Optimizes a stage's tensors in place, from its first step or from where another run's `memory()` was taken."""

    def __init__(
        self, stage: Stage, settings: TrainingSettings, data: TrainingData, memory: LoopMemory | None = None
    ) -> None:
        self.stage, self.settings, self.data = stage, settings, data
        self.step = 0
        self._adam = Adam(stage.tensors, stage.rates)
        first = next(iter(stage.tensors.values()))
        count = len(stage.tensors["means"]) if stage.relocates else 0
        self._peaks = first.new_zeros(count, requires_grad=False)  # [N], decayed maximum of the deformed opacities
        by_gradient = count if settings.relocation.target == "gradient" else 0
        self._screen_gradients = ScreenGradients.none(by_gradient, first)
        images, power = len(data.examples), settings.loss.hard_example_power
        self._hard = HardExamples(images, settings.seed, power) if power else None
        self._order = self._hard or ShuffledEpochs(images, settings.seed)
        self._rasterizer = Rasterizer.of(settings)
        self._background = WHITE if data.background is None else data.background
        if memory is not None:
            self._restore(memory)

    def advance(self) -> float:
        """One step: draw, compare, move, and relocate where it is due.  Returns the loss.

        Raises ValueError where training has diverged.
        """
        settings, item = self.settings, self._order[self.step]
        example = self.data.examples[item]
        gaussians = self.stage.gaussians_at(example.parameters)
        picture = self._drawn(gaussians, example)  # [H, W, 4]
        target = torch.from_numpy(example.compared()).to(picture.device)  # [H, W, 3 or 4]
        loss = image_loss(picture, target, ssim_weight=settings.loss.ssim_weight)
        if self._hard is not None:
            self._hard.tell(item, float(loss.detach()))
        if settings.loss.deformation_penalty and self.stage.rest_at is not None:
            size = deformation_size(gaussians, self.stage.rest_at(example.parameters))
            loss = loss + settings.loss.deformation_penalty * size
        loss.backward()
        if len(self._screen_gradients):
            self._screen_gradients.add(gaussians.means.detach(), self.stage.tensors["means"].grad, example.camera)
        self._adam.step(settings.rates.final_factor ** (self.step / self.stage.steps))
        self.step += 1
        if self.stage.relocates:
            with torch.no_grad():
                self._peaks.mul_(settings.relocation.peak_decay)
                torch.maximum(self._peaks, gaussians.opacities(), out=self._peaks)
                if self._relocation_due():
                    self._relocate()
        value = float(loss.detach())
        if not math.isfinite(value):
            raise divergence(self.stage.name, self.step, self.stage.steps, f"the loss is {value}")
        return value

    def finish(self) -> None:
        """All steps that are left."""
        while self.step < self.stage.steps:
            self.advance()

    def require_finite(self) -> None:
        """Raise ValueError where a trained tensor, or a Gaussian of the next picture, is not finite: training has diverged."""
        with torch.no_grad():
            shown = as_drawn(self.stage.gaussians_at(self.data.examples[self._order[self.step]].parameters))
        found = first_infinite(self.stage.tensors) or first_infinite(shown)
        if found:
            raise divergence(self.stage.name, self.step, self.stage.steps, found)

    def validate(self) -> float | None:
        """Mean PSNR (dB) over the validation images, full frame, on white or their own background; None where there are none.

        Raises ValueError where training has diverged.
        """
        self.require_finite()
        if not self.data.validation:
            return None
        return mean_psnr(self.stage.gaussians_at, self.data.validation, self._rasterizer, self._background)

    def memory(self) -> LoopMemory:
        """What a run with the same stage, its tensors as they are now, settings and data goes on with."""
        moments = self._adam.moments()
        tensors = {f"moments.first.{name}": first for name, (first, _) in moments.items()}
        tensors |= {f"moments.second.{name}": second for name, (_, second) in moments.items()}
        tensors |= {"peaks": self._peaks}
        tensors |= self._screen_gradients.tensors() if len(self._screen_gradients) else {}
        tensors |= self._hard.tensors() if self._hard is not None else {}
        return LoopMemory(self.step, tensors)

    def _restore(self, memory: LoopMemory) -> None:
        self.step, tensors = memory.step, memory.tensors
        self._peaks.copy_(tensors["peaks"])
        if len(self._screen_gradients):
            self._screen_gradients.restore(tensors)
        if self._hard is not None:
            self._hard.restore(tensors)
        moments = {n: (tensors[f"moments.first.{n}"], tensors[f"moments.second.{n}"]) for n in self.stage.tensors}
        self._adam.restore(moments, self.step)

    def _drawn(self, gaussians: Gaussians, example: Example) -> Tensor:
        """The picture (H, W, 4) that is compared with an example."""
        try:
            return self._rasterizer.draw_over(gaussians, example.camera, self._background)
        except ValueError:
            self.require_finite()  # which says what is wrong with the training, where that's why
            raise

    def _relocation_due(self) -> bool:
        interval = self.settings.relocation.interval
        return bool(
            interval and self.step % interval == 0 and self.step <= self.settings.relocation.stop * self.stage.steps
        )

    def _relocate(self) -> None:
        random = generator(self.settings.seed, "relocation", self.step)
        wanted = (
            self._screen_gradients.above(self.settings.relocation.gradient_threshold)
            if len(self._screen_gradients)
            else None
        )
        relocation = plan_relocation(self._peaks, self.settings.relocation.dead_opacity, random, wanted)
        if relocation is not None:
            rows = {name: self.stage.tensors[name] for name in self.stage.per_gaussian}
            relocate(relocation, rows, self._adam.moments())
            self._peaks[relocation.moved] = self._peaks[relocation.sources]
        self._screen_gradients.forget()
