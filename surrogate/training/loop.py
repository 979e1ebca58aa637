"""One stage of training, step by step, with all the state that it must remember between steps."""

from __future__ import annotations

import math
from typing import Any

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
from surrogate.training.screen_gradients import Pulls
from surrogate.training.stages import Stage
from surrogate.training.validation import mean_psnr


class StageRun:
    """Optimizes a stage's tensors in place; `restore` continues where `tensors` and `record` were taken."""

    def __init__(self, stage: Stage, settings: TrainingSettings, data: TrainingData) -> None:
        self.stage, self.settings, self.data = stage, settings, data
        self.step = 0
        self._adam = Adam(stage.tensors, stage.rates)
        first = next(iter(stage.tensors.values()))
        count = len(stage.tensors["means"]) if stage.relocates else 0
        self._peaks = first.new_zeros(count, requires_grad=False)  # [N], decayed maximum of the deformed opacities
        by_gradient = count if settings.relocation.target == "gradient" else 0
        self._pulls = Pulls.none(by_gradient, first)
        images, power = len(data.examples), settings.loss.hard_example_power
        self._hard = HardExamples(images, settings.seed, power) if power else None
        self._order = self._hard or ShuffledEpochs(images, settings.seed)
        self._rasterizer = Rasterizer.of(settings)
        self._behind = WHITE if data.background is None else data.background

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
        if len(self._pulls):
            self._pulls.add(gaussians.means.detach(), self.stage.tensors["means"].grad, example.camera)
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

    def require_finite(self) -> None:
        """Raise ValueError where training has diverged: where not all that is trained, or that the next image shows, is finite."""
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
        return mean_psnr(self.stage.gaussians_at, self.data.validation, self._rasterizer, self._behind)

    def tensors(self) -> dict[str, Tensor]:
        """Everything that is remembered between steps, beside the step itself."""
        moments = self._adam.moments()
        return (
            dict(self.stage.tensors)
            | {f"moments.first.{name}": first for name, (first, _) in moments.items()}
            | {f"moments.second.{name}": second for name, (_, second) in moments.items()}
            | {"peaks": self._peaks}
            | (self._pulls.tensors() if len(self._pulls) else {})
            | (self._hard.tensors() if self._hard is not None else {})
        )

    def restore(self, tensors: dict[str, Tensor], step: int) -> None:
        """Take up the state of a run that had these `tensors()` after `step` steps."""
        self.step = step
        with torch.no_grad():
            for name, tensor in self.stage.tensors.items():
                tensor.copy_(tensors[name])
        self._peaks.copy_(tensors["peaks"])
        if len(self._pulls):
            self._pulls.restore(tensors)
        if self._hard is not None:
            self._hard.restore(tensors)
        moments = {n: (tensors[f"moments.first.{n}"], tensors[f"moments.second.{n}"]) for n in self.stage.tensors}
        self._adam.restore(moments, step)

    def _drawn(self, gaussians: Gaussians, example: Example) -> Tensor:
        """The picture (H, W, 4) that is compared with an example."""
        try:
            return self._rasterizer.draw_over(gaussians, example.camera, self._behind)
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
        wanted = self._pulls.above(self.settings.relocation.gradient_threshold) if len(self._pulls) else None
        relocation = plan_relocation(self._peaks, self.settings.relocation.dead_opacity, random, wanted)
        if relocation is not None:
            rows: dict[str, Any] = {name: self.stage.tensors[name] for name in self.stage.per_gaussian}
            relocate(relocation, rows, self._adam.moments())
            self._peaks[relocation.moved] = self._peaks[relocation.sources]
        self._pulls.forget()
