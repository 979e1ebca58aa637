"""Interface of every compared method: training images, a plan, and a training that can render images."""

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
    """All training images of a method, in normalized coordinates.

    Attributes
    ----------
    pixels : (M, H, W, 4) uint8, premultiplied RGBA; images without alpha have 255 there.
    cameras : all of one size; several images may share one.
    views : (M,) int64, the camera of each image.
    parameters : (M, P) float32 in [-1, 1] over their bounds: those of the simulation, then those of the visualization.
    box : (2, 3) float32, low and high corner of the volume.
    background : (3,) behind opaque images; None where images have alpha, which are judged over white.
    visualization : the number of the last parameters that are the visualization's.
    points, point_colors : (K, 3) float32 each, points that the hook sampled by opacity, and their colours; None without
        any.
    """

    pixels: NDArray[np.uint8]  # [M, H, W, 4]
    cameras: Sequence[Camera]
    views: Tensor  # [M]
    parameters: Tensor  # [M, P]
    box: Tensor  # [2, 3]
    background: tuple[float, float, float] | None = None
    visualization: int = 0
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
        """The colour (3,) behind images when they are judged."""
        return WHITE if self.background is None else self.background

    def camera(self, picture: int) -> Camera:
        """The camera of an image."""
        return self.cameras[int(self.views[picture])]

    def over(self, pictures: Sequence[int]) -> Tensor:
        """Some images over `behind`, (K, H, W, 3) float32 in [0, 1]."""
        chosen = torch.from_numpy(self.pixels[list(pictures)]).to(torch.float32) / 255.0  # [K, H, W, 4]
        return chosen[..., :3] + (1.0 - chosen[..., 3:]) * torch.tensor(self.behind)


@dataclass(frozen=True)
class Plan:
    """Length and options of a method's training.

    Attributes
    ----------
    steps : number of steps, to which every schedule of the method is scaled.
    seed : seed of all random numbers.
    rate : tuned factor on all of the method's rates.
    size : "official" as published; "small" where such a step takes seconds on a processor.
    precision : of the networks; grids, colours and sums are float32.
    threads : torch threads in training.
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
    """A method in training."""

    def advance(self) -> float:
        """One training step; returns its loss."""

    def at(self, parameters: Tensor) -> Renderer:
        """A renderer of premultiplied RGBA images (H, W, 4) at normalized `parameters` (P,), for cameras in normalized coordinates.

        A method without alpha returns 1 there, and colours over the images' background.
        """

    def tensors(self) -> Mapping[str, Tensor]:
        """The tensors of a model file, by name."""

    def state(self) -> State:
        """All state that the next steps depend on, beside images, plan and step; its own tensors, not copies."""

    def restore(self, step: int, state: State) -> None:
        """Resume after `step` steps from the `state` of another training of the same images and plan."""


@dataclass(frozen=True, eq=False)
class Method:
    """A compared method.

    Attributes
    ----------
    name : name on the command line and in file names.
    title, source : title in tables, and the publication.
    official_steps : published number of training steps.
    begin : creates its training, before the first step.
    prepare : learns its initial tensors from images and a seed, before the clock starts; None for nothing.
    """

    name: str
    title: str
    source: str
    official_steps: int
    begin: Callable[[TrainingImages, Plan, Prepared], Fit]
    prepare: Callable[[TrainingImages, int], Prepared] | None = None
