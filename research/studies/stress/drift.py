"""The drift of a float32 training run from one in float64.

Training amplifies every difference, because Adam's steps depend on the signs of gradients near zero. The distance
between the two runs is therefore compared with that of two float64 runs whose initial values differ in float32's last
place.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import torch
from torch import Tensor

from catalogs.vocabulary.cameras import Camera, icosphere
from surrogate.deformation import BilinearDeformation
from surrogate.evaluation.metrics import WHITE, decibels
from surrogate.gaussians import Gaussians
from surrogate.rasterizer import Rasterizer
from surrogate.settings import TrainingSettings
from surrogate.training.losses import image_loss, image_loss_reference
from surrogate.training.optimizer import Adam
from surrogate.training.stages import decay, simulation_stage

SIZE, GAUSSIANS, STEPS = 32, 60, 400
PARAMETERS = (-1.0, -0.5, 0.0, 0.5, 1.0)
SNAPSHOT_STEPS = (1, 10, 30, 100, 200, STEPS)  # the runs are compared after these steps
MOST_DECIBELS = 0.3  # between the final PSNR of the two precisions
MOST_TIMES = 3.0  # distance of float32 from float64 in units of the distance after a changed rounding


class Image(NamedTuple):
    """An image over white, its camera and parameter; tensors in float64."""

    camera: Camera
    parameter: Tensor  # [1]
    pixels: Tensor  # [H, W, 4]


@dataclass(frozen=True)
class DriftSnapshot:
    """State of a run: centres (N, 3) in float64, the mean loss since the last snapshot, and PSNR at held-out images."""

    step: int
    means: Tensor
    loss: float
    psnr: float


@dataclass(frozen=True)
class Drift:
    """Three runs on the same images in the same order."""

    exact: list[DriftSnapshot]  # float64, the reference backend
    rounded: list[DriftSnapshot]  # float32, the tested backend
    nudged: list[DriftSnapshot]  # float64, initial values rounded differently

    def distances(self) -> list[tuple[int, float, float]]:
        """For each snapshot: its step, and the root mean square distances of float32's and of the nudged centres from float64's."""
        return [
            (a.step, _distance(a.means, b.means), _distance(a.means, c.means))
            for a, b, c in zip(self.exact, self.rounded, self.nudged, strict=True)
        ]

    @property
    def complaints(self) -> tuple[str, ...]:
        """Signs of a drift in words; empty where float32 may be trusted."""
        apart, (_, far, nudged) = abs(self.exact[-1].psnr - self.rounded[-1].psnr), self.distances()[-1]
        reasons = []
        if not all(math.isfinite(snapshot.loss) for snapshot in self.rounded):
            reasons.append("the loss in float32 is not finite")
        if not apart <= MOST_DECIBELS:
            reasons.append(f"float32 ends {apart:.2f} dB from float64, more than {MOST_DECIBELS}")
        if not far <= MOST_TIMES * nudged:
            reasons.append(
                f"float32 ends {far / nudged:.0f} times as far from float64 as a nudge does, above {MOST_TIMES:g}"
            )
        return tuple(reasons)


def measure_drift(backend: str = "cpu", steps: int = STEPS) -> Drift:
    """Train the same small ensemble three times."""
    learn, judge = _images()
    nudge = torch.Generator().manual_seed(8)

    def otherwise(tensor: Tensor) -> Tensor:
        signs = torch.randint(0, 2, tensor.shape, generator=nudge, dtype=torch.int64) * 2.0 - 1.0
        return tensor * (1.0 + signs.double() * torch.finfo(torch.float32).eps)

    return Drift(
        _run(learn, judge, torch.float64, "reference", steps),
        _run(learn, judge, torch.float32, backend, steps),
        _run(learn, judge, torch.float64, "reference", steps, otherwise),
    )


def _run(
    learn: list[Image],
    judge: list[Image],
    dtype: torch.dtype,
    backend: str,
    steps: int,
    change: Callable[[Tensor], Tensor] = lambda tensor: tensor,
) -> list[DriftSnapshot]:
    settings = TrainingSettings(gaussians=GAUSSIANS, deformation_steps=steps, latent_size=4, hidden_width=16)
    gaussians = _start()
    deformation = BilinearDeformation.create(gaussians, 1, settings)
    gaussians = Gaussians(*(change(t.double()).to(dtype) for t in gaussians.tensors().values()))
    tensors: dict[str, Any] = {name: change(t.double()).to(dtype) for name, t in deformation.tensors().items()}
    stage = simulation_stage(gaussians, BilinearDeformation(**tensors, units=deformation.units.to(dtype)), settings)
    adam, rasterizer = Adam(stage.tensors, stage.rates, shared=stage.shared), Rasterizer(backend=backend)
    loss_of = image_loss_reference if dtype == torch.float64 else image_loss
    order, snapshots, losses = np.random.default_rng(0).permutation(steps) % len(learn), [], []

    def drawn(image: Image) -> Tensor:
        return rasterizer.draw_over(stage.gaussians_at(image.parameter.to(dtype)), image.camera, WHITE)

    for step in range(1, steps + 1):
        image = learn[order[step - 1]]
        loss = loss_of(drawn(image), image.pixels.to(dtype))
        loss.backward()
        adam.step(decay((step - 1) / steps))
        losses.append(float(loss.detach()))
        if step in SNAPSHOT_STEPS or step == steps:
            with torch.no_grad():
                means = stage.tensors["means"].double().clone()
                error = np.mean([float((drawn(i).double() - i.pixels).square().mean()) for i in judge])
            snapshots.append(DriftSnapshot(step, means, float(np.mean(losses)), decibels(float(error))))
            losses = []
    return snapshots


def _start() -> Gaussians:
    random = np.random.default_rng(2)
    columns = (
        random.uniform(-0.8, 0.8, (GAUSSIANS, 3)),
        np.full((GAUSSIANS, 3), math.log(0.1)),
        np.tile([1.0, 0.0, 0.0, 0.0], (GAUSSIANS, 1)),
        np.full(GAUSSIANS, -1.4),
        np.full((GAUSSIANS, 3), 0.5),
    )
    return Gaussians(*(torch.from_numpy(column).float() for column in columns))


def _images() -> tuple[list[Image], list[Image]]:
    """Training and held-out images of a dozen blobs that drift, swell and fade with one parameter, drawn in float64."""
    cameras = [
        Camera.look_at(5.0 * direction, (0.0, 0.0, 0.0), vertical_fov_degrees=32.0, width=SIZE, height=SIZE)
        for direction in icosphere(1)
    ]
    images = [_picture(camera, p) for p in PARAMETERS for camera in cameras]
    return [image for i, image in enumerate(images) if i % 5], images[::5]


def _picture(camera: Camera, p: float) -> Image:
    random = np.random.default_rng(5)
    means = random.uniform(-0.6, 0.6, (12, 3)) + p * random.uniform(-0.25, 0.25, (12, 3))
    columns = (
        means,
        np.log(random.uniform(0.12, 0.25, (12, 3))) + 0.3 * p,
        random.normal(size=(12, 4)),
        random.uniform(0.0, 2.0, 12) + 0.5 * p,
        random.random((12, 3)),
    )
    truth = Gaussians(*(torch.from_numpy(column) for column in columns))
    picture = Rasterizer(backend="reference").draw_over(truth, camera, WHITE)
    return Image(camera, torch.tensor([p], dtype=torch.float64), picture)


def _distance(a: Tensor, b: Tensor) -> float:
    return float((a - b).square().sum(dim=1).mean().sqrt())
