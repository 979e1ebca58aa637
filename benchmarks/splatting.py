"""Time splatting, the image loss and a whole training step, with errors against the float64 twin beside the times.

    python benchmarks/splatting.py [--threads 1] [--instruction-sets avx512,avx2] [--quick]

Prints Markdown.  Each time is the fastest of many calls, with the median behind it; on one thread it is processor time, which
other work on the machine disturbs least.  Errors are the largest ones over pixels and Gaussians, relative to the largest
value, of a picture and of the gradients of a random functional of 400 of its pixels.
"""

from __future__ import annotations

import argparse
import os
import platform
import subprocess
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

import native
from catalogs.cameras import Camera
from surrogate.data import Example
from surrogate.deformation.bilinear import BilinearDeformation
from surrogate.gaussians import Gaussians
from surrogate.losses import image_loss, image_loss_reference
from surrogate.settings import TrainingSettings
from surrogate.simulate import simulation_stage
from surrogate.splatting import reference, render
from surrogate.stage_run import StageRun, TrainingData

PROJECT = Path(__file__).resolve().parent.parent
NEAR, DILATION, ALPHA_FLOOR = 0.02, 0.1, 1.0 / 255.0
DISTANCE = 4.3  # from the camera to the middle of the scene
CHECKED_PIXELS = 400


class Measured(NamedTuple):
    """Milliseconds of one call: the fastest, and the median."""

    fastest: float
    median: float

    def __str__(self) -> str:
        return f"{self.fastest:.2f} ({self.median:.2f})"


# ---- what is drawn -------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Workload:
    """`count` Gaussians with standard deviations and opacities drawn evenly from ranges, in px and [0, 1].

    They fill a slab that the frame shows whole, or, `shells`, lie on three nested spheres.
    """

    name: str
    size: int
    count: int
    sigmas: tuple[float, float]
    opacities: tuple[float, float]
    shells: bool = False

    def camera(self) -> Camera:
        position = (0.0, -DISTANCE, 0.3)
        return Camera.look_at(position, (0, 0, 0), vertical_fov_degrees=30.0, width=self.size, height=self.size)

    def tensors(self) -> list[Tensor]:
        """means, scales, quats, opacities, colors in float32."""
        random = np.random.default_rng(0)
        if self.shells:
            directions = random.normal(size=(self.count, 3))
            radii = random.choice([0.4, 0.7, 1.0], self.count)
            means = directions / np.linalg.norm(directions, axis=1, keepdims=True) * radii[:, None]
        else:
            means = random.uniform(-1, 1, (self.count, 3)) * [1.1, 0.58, 1.1]
        values = (
            means,
            random.uniform(*self.sigmas, (self.count, 3)) * DISTANCE / self.camera().fx,
            random.normal(size=(self.count, 4)),
            random.uniform(*self.opacities, self.count),
            random.uniform(0, 1, (self.count, 3)),
        )
        return [torch.from_numpy(value).float() for value in values]


WORKLOADS = (
    Workload("translucent", 256, 20_000, (2, 6), (0.02, 0.2)),
    Workload("translucent", 256, 60_000, (2, 6), (0.02, 0.2)),
    Workload("translucent", 512, 60_000, (2, 6), (0.02, 0.2)),
    Workload("thin", 256, 20_000, (0.6, 2.2), (0.02, 0.2)),
    Workload("opaque shells", 256, 20_000, (1, 3), (0.6, 0.99), shells=True),
    Workload("opaque shells", 512, 60_000, (2, 6), (0.6, 0.99), shells=True),
)


# ---- what is measured ----------------------------------------------------------------------------------------


def measured(call: Callable[[], object], repeats: int, threads: int) -> Measured:
    clock = time.thread_time if threads == 1 else time.perf_counter
    call()
    times = []
    for _ in range(repeats):
        started = clock()
        call()
        times.append((clock() - started) * 1e3)
    return Measured(min(times), float(np.median(times)))


def drawing_times(workload: Workload, instruction_set: str, threads: int, repeats: int) -> tuple[Measured, Measured]:
    camera, arrays = workload.camera(), [t.numpy() for t in workload.tensors()]
    random = np.random.default_rng(1)
    color = random.normal(size=(workload.size, workload.size, 3)).astype(np.float32)
    alpha = random.normal(size=(workload.size, workload.size)).astype(np.float32)

    def draw() -> object:
        intrinsics = (camera.fx, camera.fy, camera.cx, camera.cy, camera.width, camera.height)
        constants = (NEAR, DILATION, ALPHA_FLOOR, threads, instruction_set)
        return native.forward(*arrays, camera.world_to_camera, *intrinsics, *constants)

    drawing = draw()
    forward = measured(draw, repeats, threads)
    return forward, measured(lambda: native.backward(drawing, color, alpha, threads), repeats, threads)


class Twin(NamedTuple):
    """The twin's answer for a few pixels."""

    pixels: NDArray[np.int64]  # [P], indices of the flattened frame
    weights: Tensor  # [P, 4] of the functional
    picture: Tensor  # [P, 4]
    gradients: tuple[Tensor, ...]
    depth: float  # Gaussians drawn per pixel, where any is


def ask_twin(workload: Workload) -> Twin:
    random = np.random.default_rng(2)
    camera = workload.camera()
    chosen = np.sort(random.choice(workload.size**2, CHECKED_PIXELS, replace=False))
    weights = torch.from_numpy(random.normal(size=(CHECKED_PIXELS, 4)))
    leaves = [t.double().requires_grad_() for t in workload.tensors()]
    means, scales, quats, opacities, colors = leaves
    gradients = [torch.zeros_like(leaf) for leaf in leaves]
    parts, drawn, covered = [], 0, 0
    for pixels, weight in zip(
        reference.pixel_centers(camera)[chosen].double().split(16), weights.split(16), strict=True
    ):
        splats = reference.project(
            means, scales, quats, opacities, colors, camera, near=NEAR, dilation=DILATION, floor=ALPHA_FLOOR
        )
        alphas = reference.alphas_at(pixels, splats, ALPHA_FLOOR)
        part = reference.composite(alphas, splats.colors)
        for total, gradient in zip(gradients, torch.autograd.grad((part * weight).sum(), leaves), strict=True):
            total += gradient
        parts.append(part.detach())
        drawn += int((alphas > 0).sum())
        covered += int((alphas > 0).any(dim=1).sum())
    return Twin(chosen, weights, torch.cat(parts), tuple(gradients), drawn / max(covered, 1))


def errors(workload: Workload, twin: Twin, instruction_set: str, threads: int) -> tuple[float, float]:
    """Largest error of the picture, and of any gradient relative to the largest of its kind."""
    leaves = [t.requires_grad_() for t in workload.tensors()]
    constants = {"near": NEAR, "dilation": DILATION, "alpha_floor": ALPHA_FLOOR}
    picture = render(*leaves, workload.camera(), **constants, threads=threads, instruction_set=instruction_set)  # type: ignore[arg-type,call-arg]
    flat = torch.cat([picture.color, picture.alpha[..., None]], dim=2).flatten(0, 1)[torch.from_numpy(twin.pixels)]
    gradients = torch.autograd.grad((flat * twin.weights.float()).sum(), leaves)
    pairs = zip(gradients, twin.gradients, strict=True)
    by_kind = [float((got - wanted).abs().max() / wanted.abs().max()) for got, wanted in pairs]
    return float((flat - twin.picture).detach().abs().max()), max(by_kind)


def loss_row(channels: int, instruction_set: str, threads: int, repeats: int) -> str:
    random = np.random.default_rng(3)
    pictures = [random.random((256, 256, channels), dtype=np.float32) for _ in range(2)]
    taken = measured(lambda: native.image_loss(*pictures, 0.2, threads, instruction_set), repeats, threads)
    image, target = (torch.from_numpy(picture) for picture in pictures)
    slow, fast = image.double().requires_grad_(), image.clone().requires_grad_()
    wanted, got = image_loss_reference(slow, target.double()), image_loss(fast, target)
    (by_slow,), (by_fast,) = torch.autograd.grad(wanted, slow), torch.autograd.grad(got, fast)
    error = float((by_fast - by_slow).abs().max() / by_slow.abs().max())
    value_error = abs(got.item() - wanted.item())
    return f"| L1 + SSIM, 256² x {channels} | {instruction_set} | {taken} | {value_error:.0e} | {error:.0e} |"


def step_time(workload: Workload, repeats: int, threads: int) -> Measured:
    """One step of stage 2 as training takes it: bilinear deformation, picture, L1 + SSIM, gradients, Adam."""
    random = np.random.default_rng(4)
    means, scales, quats, opacities, colors = workload.tensors()
    gaussians = Gaussians(means, scales.log(), quats, opacities.logit(), colors)
    settings = TrainingSettings(relocation_interval=0)
    deformation = BilinearDeformation.create(gaussians, 1, settings)
    pixels = random.integers(0, 256, (workload.size, workload.size, 4), dtype=np.uint8)
    example = Example(workload.camera(), torch.tensor([0.3]), pixels)
    stage = simulation_stage(gaussians, deformation, settings)
    stage = replace(stage, rates=dict.fromkeys(stage.rates, 1e-12))  # the workload must stay what it is
    run = StageRun(stage, settings, TrainingData([example], [], None))
    return measured(run.advance, repeats, threads)


# ---- the page ------------------------------------------------------------------------------------------------


def machine() -> str:
    names = [line.split(":", 1)[1].strip() for line in _lines("/proc/cpuinfo") if line.startswith("model name")]
    return f"{names[0] if names else platform.processor() or platform.machine()}, {os.cpu_count()} cores"


def _lines(path: str) -> Sequence[str]:
    return Path(path).read_text().splitlines() if Path(path).exists() else ()


def commit() -> str:
    command = ["git", "log", "-1", "--format=%h", "--", "native", "surrogate"]
    return subprocess.run(command, cwd=PROJECT, capture_output=True, text=True).stdout.strip() or "unknown"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])  # type: ignore[union-attr]
    parser.add_argument("--threads", type=int, default=1)
    parser.add_argument("--repeats", type=int, default=40)
    parser.add_argument("--instruction-sets", default=",".join(native.instruction_sets()))
    parser.add_argument("--quick", action="store_true", help="the first workload only")
    arguments = parser.parse_args()
    threads, repeats = arguments.threads, arguments.repeats
    torch.set_num_threads(threads)
    if threads == 1 and hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})  # so that nothing else takes a second core
    sets = arguments.instruction_sets.split(",")
    print(f"{machine()}; {threads} thread(s); commit {commit()}; torch {torch.__version__}; milliseconds\n")
    print(
        "| workload | Gaussians per covered pixel | instruction set | forward | backward | sum | image error | gradient error |"
    )
    print("|---|---|---|---|---|---|---|---|")
    for workload in WORKLOADS[:1] if arguments.quick else WORKLOADS:
        twin = ask_twin(workload)
        for name in sets:
            forward, backward = drawing_times(workload, name, threads, repeats)
            image, gradient = errors(workload, twin, name, threads)
            print(
                f"| {workload.name} {workload.size}² {workload.count // 1000}k | {twin.depth:.0f} | {name} | {forward} | "
                f"{backward} | {forward.fastest + backward.fastest:.2f} | {image:.0e} | {gradient:.0e} |",
                flush=True,
            )
    print("\n| loss | instruction set | value and gradient | value error | gradient error |\n|---|---|---|---|---|")
    for channels in (3, 4):
        for name in sets:
            print(loss_row(channels, name, threads, repeats), flush=True)
    step = step_time(WORKLOADS[0], repeats, threads)
    print(f"\nA whole training step (256², 20k, best instruction set): {step}, {1e3 / step.fastest:.0f} steps/s")


if __name__ == "__main__":
    main()
