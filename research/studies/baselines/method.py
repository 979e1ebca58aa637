"""What every compared method takes and gives: pictures to learn from, a plan, and a training that can be asked for pictures."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Literal, Protocol

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from catalogs.vocabulary.cameras import Camera
from research.studies.baselines.state import State
from surrogate.evaluation.metrics import WHITE

Size = Literal["official", "small"]
Precision = Literal["float32", "bfloat16"]
PRECISIONS: tuple[Precision, ...] = ("float32", "bfloat16")


@dataclass(frozen=True, eq=False)
class TrainingImages:
    """All pictures that a method learns from, in normalized coordinates.

    Attributes
    ----------
    pixels : (M, H, W, 4) uint8, premultiplied RGBA; pictures without alpha have 255 there.
    cameras : all of one size; several pictures may share one.
    views : (M,) int64, the camera of each picture.
    parameters : (M, P) float32 in [-1, 1] over their bounds: those of the simulation, then those of the visualization.
    box : (2, 3) float32, low and high corner of the volume.
    background : (3,) behind opaque pictures; None where pictures have alpha: they are judged over white.
    points, point_colors : (K, 3) float32 each, where the hook sampled the volume by opacity and what colour it has there; None
        where nobody did.
    """

    pixels: NDArray[np.uint8]  # [M, H, W, 4]
    cameras: Sequence[Camera]
    views: Tensor  # [M]
    parameters: Tensor  # [M, P]
    box: Tensor  # [2, 3]
    background: tuple[float, float, float] | None = None
    points: Tensor | None = None  # [K, 3]
    point_colors: Tensor | None = None  # [K, 3]

    def __post_init__(self) -> None:
        count, height, width = self.pixels.shape[:3]
        if not count or len(self.views) != count or len(self.parameters) != count:
            raise ValueError(
                f"{count} pictures, {len(self.views)} views and {len(self.parameters)} parameters: one each"
            )
        other = {(c.height, c.width) for c in self.cameras} - {(height, width)}
        if other:
            raise ValueError(f"cameras of {other} pixels for pictures of {(height, width)}")

    def __len__(self) -> int:
        return len(self.pixels)

    @property
    def behind(self) -> tuple[float, float, float]:
        """The colour (3,) that pictures are judged over."""
        return WHITE if self.background is None else self.background

    def camera(self, picture: int) -> Camera:
        """The camera of a picture."""
        return self.cameras[int(self.views[picture])]

    def over(self, pictures: Sequence[int]) -> Tensor:
        """Some pictures over `behind`, (K, H, W, 3) float32 in [0, 1]."""
        chosen = torch.from_numpy(self.pixels[list(pictures)]).to(torch.float32) / 255.0  # [K, H, W, 4]
        return chosen[..., :3] + (1.0 - chosen[..., 3:]) * torch.tensor(self.behind)


@dataclass(frozen=True)
class Plan:
    """How long and how a method is trained.

    Attributes
    ----------
    steps : how many there will be; every schedule of the method is stretched or pressed to it.
    seed : of all that is drawn at random.
    rate : factor on all of the method's rates, which tuning chooses.
    size : "official" as published; "small" where a step of that takes seconds on a processor.
    precision : of the networks; grids, colours and sums are float32.
    threads : of torch, in training.
    """

    steps: int
    seed: int = 0
    rate: float = 1.0
    size: Size = "official"
    precision: Precision = "float32"
    threads: int = 1

    def __post_init__(self) -> None:
        if self.steps < 1 or self.threads < 1 or not self.rate > 0.0:
            given = f"{self.steps}, {self.threads} and {self.rate}"
            raise ValueError(f"a plan has at least one step and one thread, and a positive rate, got {given}")


Prepared = Mapping[str, Tensor]
Renderer = Callable[[Camera], NDArray[np.float32]]


class Fit(Protocol):
    """A method that is being trained."""

    def advance(self) -> float:
        """One of the planned steps; returns its loss."""

    def at(self, parameters: Tensor) -> Renderer:
        """What draws premultiplied RGBA pictures (H, W, 4) at normalized `parameters` (P,), for cameras in normalized coordinates.

        A method without alpha gives 1 there, and colours over the pictures' background.
        """

    def tensors(self) -> Mapping[str, Tensor]:
        """Everything that a model file would hold, by name."""

    def state(self) -> State:
        """All that its next steps depend on, beside pictures, plan and how many there were; its own tensors, not copies."""

    def restore(self, step: int, state: State) -> None:
        """Go on after `step` steps from what another training of the same pictures and plan had as its `state` there."""


@dataclass(frozen=True, eq=False)
class Method:
    """A method that is compared.

    Attributes
    ----------
    name : on the command line and in file names.
    title, source : in tables, and the publication.
    official_steps : of its training as published.
    begin : its training, before the first step.
    prepare : what it starts from, from pictures and a seed, learnt before the clock starts; None for nothing.
    """

    name: str
    title: str
    source: str
    official_steps: int
    begin: Callable[[TrainingImages, Plan, Prepared], Fit]
    prepare: Callable[[TrainingImages, int], Prepared] | None = None
