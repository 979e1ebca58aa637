"""One stage of training, step by step, with all the state that it must remember between steps."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from surrogate.appearance.field_gaussians import FieldGaussians
from surrogate.evaluation.metrics import WHITE, psnr
from surrogate.gaussians import Gaussians
from surrogate.randomness import generator
from surrogate.rasterizer import Rasterizer
from surrogate.settings import TrainingSettings
from surrogate.training.data import Example, TrainingData
from surrogate.training.downsampling import Downsampling
from surrogate.training.losses import image_loss
from surrogate.training.optimizer import Adam
from surrogate.training.ranks import ALONE, Ranks
from surrogate.training.relocation import PEAK_DECAY, STOP, plan_relocation, relocate
from surrogate.training.stages import Stage, decay
from surrogate.training.step_images import StepImages
from surrogate.training.value_loss import INTERVAL

LARGEST_SCALE = 1e4  # in half boxes: deformations that ran away passed it while all numbers were finite
FARTHEST = 10.0  # half boxes from the centre


@dataclass(frozen=True, eq=False, repr=False)
class LoopMemory:
    """The loop's memory after `step` steps of a stage, beside the trained tensors.

    `tensors` are Adam's moments and the steps of rows, and the recent largest opacities.
    """

    step: int
    tensors: Mapping[str, Tensor]

    def with_color_columns(self, count: int) -> LoopMemory:
        """The same for colours of `count` columns, those that are new without moments."""
        moments = {n: t for n, t in self.tensors.items() if n in ("moments.first.colors", "moments.second.colors")}
        wider = {n: torch.nn.functional.pad(t, (0, count - t.shape[1])) for n, t in moments.items()}
        return LoopMemory(self.step, {**self.tensors, **wider})


class Diverged(ValueError):
    """A training, or the pictures that it makes, are not finite any more."""


class StageRun:
    """Optimizes a stage's tensors in place, from its first step or from where another run's `memory()` was taken.

    Each step learns from `settings.batch` images, of which each of the processes `data.ranks` draws its share.  The gradient is the
    mean of theirs, and rates are multiplied by the square root of their number (Malladi et al. 2022, "On the SDEs and scaling rules
    for adaptive gradient algorithms").  `pausing` says whether any process asked for a pause in the last step.
    """

    def __init__(
        self, stage: Stage, settings: TrainingSettings, data: TrainingData, memory: LoopMemory | None = None
    ) -> None:
        self.stage, self.settings, self.data, self.pausing = stage, settings, data, False
        self.step = 0 if memory is None else memory.step
        self._adam = Adam(stage.tensors, stage.rates, self.step, stage.shared)
        first = next(iter(stage.tensors.values()))
        count = len(stage.tensors["means"]) if stage.per_gaussian else 0
        self._peaks = first.new_zeros(count, requires_grad=False)  # [N], decayed maximum of the deformed opacities
        self._images = StepImages(
            data.examples,
            settings.seed,
            settings.batch,
            data.ranks.share(settings.batch),
            Downsampling(settings.early_downsampling, stage.steps),
        )
        self._rasterizer = Rasterizer.of(settings)
        self._background = WHITE if data.background is None else data.background
        if memory is not None:
            for name, own in self.memory().tensors.items():
                own.copy_(memory.tensors[name])

    def advance(self, pause: bool = False) -> float:
        """One step: draw, compare, move, and relocate where it is due.  Returns the mean loss of its images.

        `pause` asks all processes for a pause after it.  Raises ValueError where training has diverged.
        """
        batch, ranks = self.settings.batch, self.data.ranks
        step = _Step.begin(batch, pause)
        failure: Exception | None = None
        try:
            for place in ranks.share(batch):
                self._learn(place, step)
        except Exception as error:  # which the others would else wait for
            if ranks.count == 1:
                raise
            failure = error
            step.failed[:] = 1.0
        self._add_up(step)
        if step.failed.any():
            ranks.raise_any(failure, Diverged)
        self.pausing = bool(step.pause.any())
        factor = decay(self.step / self.stage.steps, self.stage.final_factor)
        warmth = self.stage.warmth(self.step)
        self._adam.step(math.sqrt(batch) * factor, dict.fromkeys(self.stage.warming, warmth))
        self.step += 1
        if self.stage.per_gaussian:
            self._relocate(step.gaussians)
        value = sum(step.losses.tolist()) / batch
        if not math.isfinite(value):
            raise self._diverged(f"the loss is {value}")
        return value

    def _learn(self, place: int, step: _Step) -> None:
        """Add to the gradients, and to what the step knows, what one image of it says: that at `place` in the batch."""
        settings, example = self.settings, self._images.next(self.step, place)
        carriers = self.stage.carried_at(example.parameters)
        gaussians = carriers.drawn(self.stage.function_at(example.parameters))
        picture = self._render(gaussians, example)  # [H, W, 4]
        target = torch.from_numpy(example.compared()).to(picture.device)  # [H, W, 3 or 4]
        loss = image_loss(picture, target)
        if self.data.values is not None and self.step % INTERVAL == 0 and isinstance(carriers, FieldGaussians):
            value_loss = self.data.values.loss(carriers, example.member, self.step * settings.batch + place)
            loss = loss + INTERVAL * settings.field_value_weight * value_loss
        step.losses[place] = loss.detach()
        step.gaussians.append(gaussians)
        (loss / settings.batch).backward()

    def _add_up(self, step: _Step) -> None:
        """Let all processes know the sums of their gradients, and of what each knows of the step."""
        if self.data.ranks.count > 1:
            tensors = list(self.stage.tensors.values())
            moved = torch.tensor([float(tensor.grad is not None) for tensor in tensors])
            for tensor in tensors:
                tensor.grad = torch.zeros_like(tensor) if tensor.grad is None else tensor.grad
            sums = [*step.tensors(), moved]
            on_device = [tensor.to(tensors[0].device) for tensor in sums]
            self.data.ranks.add(*(tensor.grad for tensor in tensors if tensor.grad is not None), *on_device)
            for own, summed in zip(sums, on_device, strict=True):
                own.copy_(summed)
            for tensor, any_moved in zip(tensors, moved.tolist(), strict=True):
                tensor.grad = tensor.grad if any_moved else None

    def finish(self) -> None:
        """All steps that are left."""
        while self.step < self.stage.steps:
            self.advance()

    def require_finite(self) -> None:
        """Raise ValueError where training has diverged.

        A tensor, or a Gaussian of the next picture, is not finite; one that is seen is huge; or none is seen, where the picture
        is not faint.
        """
        example = self._images.at(self.step, 0)
        with torch.no_grad():
            gaussians = self.stage.gaussians_at(example.parameters)
        tensors, floor = as_drawn(gaussians), self._rasterizer.constants.alpha_floor
        problem = first_infinite(self.stage.tensors) or first_infinite(tensors) or first_huge(tensors, floor)
        if problem:
            raise self._diverged(problem)
        if not is_faint(example, self._background) and not is_visible(tensors, floor).any():
            raise self._diverged(f"no Gaussian is seen in a picture of {example.member}")

    def _diverged(self, what: str) -> Diverged:
        return Diverged(
            f"training diverged in stage {self.stage.name} at step {self.step:,} of {self.stage.steps:,}, where {what}: "
            f"lower the rates in the scene's [training] table, or as KEY=VALUE of a catalog into another folder (-o), such as "
            f"latent_rate={self.settings.latent_rate / 2:g} embedding_rate={self.settings.embedding_rate / 2:g}"
        )

    def validate(self) -> float | None:
        """Mean PSNR (dB) over the validation images, full frame, on white or their own background; None where there are none.

        Raises ValueError where training has diverged.
        """
        self.require_finite()
        if not self.data.validation:
            return None
        examples, ranks = self.data.validation, self.data.ranks
        return mean_psnr(self.stage.gaussians_at, examples, self._rasterizer, self._background, ranks)

    def memory(self) -> LoopMemory:
        """The memory with which a run of the same stage, tensors, settings and data goes on."""
        self.data.ranks.maximum(self._peaks)
        tensors = {"peaks": self._peaks}
        for name, moments in self._adam.moments().items():
            tensors |= {f"moments.{which}.{name}": tensor for which, tensor in moments.tensors().items()}
        return LoopMemory(self.step, tensors)

    def _render(self, gaussians: Gaussians, example: Example) -> Tensor:
        """The picture (H, W, 4) that is compared with an example."""
        try:
            return self._rasterizer.draw_over(gaussians, example.camera, self._background)
        except ValueError:
            self.require_finite()  # which says what is wrong with the training, where that's why
            raise

    @torch.no_grad()
    def _relocate(self, gaussians_of_images: Sequence[Gaussians]) -> None:
        """Take note of the opacities that were just drawn, and relocate dead Gaussians where that is due."""
        interval, peaks = self.settings.relocation_interval, self._peaks
        peaks.mul_(PEAK_DECAY)
        for gaussians in gaussians_of_images:
            torch.maximum(peaks, gaussians.opacities(), out=peaks)
        if not interval or self.step % interval or self.step > STOP * self.stage.steps:
            return
        self.data.ranks.maximum(peaks)  # until now each process knows what it drew itself
        random = generator(self.settings.seed, "relocation", self.step)
        relocation = self.data.ranks.by_first(lambda: plan_relocation(peaks, random))
        if relocation is not None:
            relocation = relocation.to(peaks.device)
            rows = {name: self.stage.tensors[name] for name in self.stage.per_gaussian}
            relocate(relocation, rows, self._adam.moments())
            peaks[relocation.moved] = peaks[relocation.sources]


@dataclass(frozen=True, eq=False, repr=False)
class _Step:
    """One process's share of a step of B images, until the sums over all processes are known.

    Attributes
    ----------
    gaussians : those of its own images.
    losses : of each image (B,).
    pause, failed : (1,), in how many processes a pause is asked for, and drawing failed.
    """

    gaussians: list[Gaussians]
    losses: Tensor
    pause: Tensor
    failed: Tensor

    @classmethod
    def begin(cls, batch: int, pause: bool) -> _Step:
        """Before the first image."""
        return cls([], torch.zeros(batch), torch.full((1,), float(pause)), torch.zeros(1))

    def tensors(self) -> list[Tensor]:
        """All that is added up."""
        return [self.losses, self.pause, self.failed]


def first_infinite(tensors: Mapping[str, Tensor]) -> str:
    """The first number that is not finite, such as "scales[3, 0] is inf"; "" where all are finite."""
    for name, tensor in tensors.items():
        broken = ~tensor.detach().isfinite()
        if broken.any():
            place = tuple(broken.nonzero()[0].tolist())
            return f"{name}{list(place) if place else ''} is {float(tensor.detach()[place])}"
    return ""


def is_visible(tensors: Mapping[str, Tensor], floor: float) -> Tensor:
    """Which of the Gaussians `as_drawn` are more opaque than `floor`, and not far away from the box, (N,)."""
    return (tensors["opacities"] > floor) & (
        tensors["means"].abs().amax(dim=1) < FARTHEST + tensors["scales"].amax(dim=1)
    )


def first_huge(tensors: Mapping[str, Tensor], floor: float) -> str:
    """The first scale that no box can need of what is seen, such as "scales[3, 0] is 2e+09 boxes"; "" where there is none.

    What is fainter than `floor`, a medium as a ball of the same volume, hardly shows: training may have made it huge, to no harm.
    """
    huge = (tensors["scales"] > LARGEST_SCALE) & is_visible(tensors, floor)[:, None]  # [N, 3]
    if not huge.any():
        return ""
    place = huge.nonzero()[0].tolist()
    return f"scales{place} is {float(tensors['scales'][*place]) / 2.0:.2g} boxes"


def is_faint(example: Example, background: Sequence[float]) -> bool:
    """True where the picture lies on average within a step of 8 bits of its background (3,): no Gaussian may be right there."""
    colors = np.asarray(example.compared()[..., :3], dtype=np.float64)  # [H, W, 3]
    return bool(np.abs(colors - 255.0 * np.asarray(background)).mean() <= 1.0)


@torch.no_grad()
def as_drawn(gaussians: Gaussians) -> dict[str, Tensor]:
    """All that must be finite to draw the Gaussians: a scale may be infinite though its logarithm is not."""
    return gaussians.tensors() | {"scales": gaussians.scales(), "opacities": gaussians.opacities()}


@torch.no_grad()
def mean_psnr(
    gaussians_at: Callable[[Tensor], Gaussians],
    examples: Sequence[Example],
    rasterizer: Rasterizer,
    background: Sequence[float],
    ranks: Ranks = ALONE,
) -> float:
    """Mean PSNR (dB) over images, full frame, over `background` (3,), pictures cut to [0, 1].

    `gaussians_at` gives the Gaussians at normalized parameters (P,).  Each of the processes `ranks` draws its share.
    """
    scores = torch.zeros(len(examples), dtype=torch.float64)  # [I], each known to the process that drew it
    for place in ranks.share(len(examples)):
        example = examples[place]
        picture = rasterizer.draw_over(gaussians_at(example.parameters), example.camera, background)  # [H, W, 4]
        target = np.divide(example.compared()[..., :3], 255.0, dtype=np.float32)  # [H, W, 3]
        scores[place] = psnr(target, picture[..., :3].clamp(0.0, 1.0).cpu().numpy())
    ranks.add(scores)
    return float(sum(scores.tolist()) / len(scores))
