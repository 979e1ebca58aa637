"""A method that learns the mean of all pictures: what comparisons are tested with, in no time."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import torch
from torch import Tensor

from research.studies.baselines.method import Fit, Method, Plan, Prepared, Renderer, TrainingImages
from research.studies.baselines.state import State


class MeanPicture:
    """The running mean of the pictures that were drawn so far; `loss` says what each step returns."""

    def __init__(self, pictures: TrainingImages, plan: Plan, prepared: Prepared, loss: Callable[[int], float]) -> None:
        self.pictures, self.plan, self.prepared, self._loss = pictures, plan, prepared, loss
        self.mean, self.steps = np.zeros(pictures.pixels.shape[1:], dtype=np.float32), 0

    def advance(self) -> float:
        """One more picture."""
        assert self.steps < self.plan.steps, "more steps than are planned"
        shown = self.pictures.pixels[self.steps % len(self.pictures)] / np.float32(255.0)
        self.steps += 1
        self.mean += self.plan.rate * (shown - self.mean) / self.steps
        return self._loss(self.steps)

    def at(self, parameters: Tensor) -> Renderer:
        """The mean, whatever is asked for."""
        assert parameters.shape == self.pictures.parameters.shape[1:]
        return lambda camera: self.mean

    def state(self) -> State:
        """The mean, and of how many."""
        return self.tensors()

    def restore(self, step: int, state: State) -> None:
        """Continue after this number of steps."""
        self.steps, self.mean = step, state["mean"].numpy().copy()

    def tensors(self) -> dict[str, Tensor]:
        """The mean."""
        return {"mean": torch.from_numpy(self.mean)}


def mean_method(
    name: str = "mean",
    loss: Callable[[int], float] = lambda _: 0.5,
    prepare: Callable[[TrainingImages, int], Prepared] | None = None,
) -> Method:
    """The method."""

    def begin(pictures: TrainingImages, plan: Plan, prepared: Prepared) -> Fit:
        return MeanPicture(pictures, plan, prepared, loss)

    return Method(name, "The mean", "nobody", 1000, begin, prepare)
