"""Cost of the field-value loss per step on one core: blended values at places, their loss, and the gradients.

    python -m research.benchmarks.training.value_loss [--gaussians 20000] [--places 256]

Gaussians lie at random in [-1, 1]^3, with standard deviations that differ by up to e; so do the places.  Milliseconds are processor
time of this thread, the median and in brackets the fastest of many steps; "shapes" are means, scales and rotations.
"""

from __future__ import annotations

import os
import platform
import statistics
import time

import click
import torch
from torch import Tensor

from native import kernels
from research.benchmarks.timing import digits
from surrogate.training.value_loss import REACH, blended_values, value_loss

SCALES = (0.03, 0.05, 0.07, 0.1)
HEADER = (
    "| standard deviation | Gaussians that reach a place | forward, ms | backward by values, ms | by shapes too, ms |"
)


def carriers(count: int, scale: float) -> list[Tensor]:
    """Means, scales, quaternions, weights and values."""
    random = torch.Generator().manual_seed(0)
    scales = scale * torch.exp(torch.rand(count, 3, generator=random) - 0.5)
    means, quats = (torch.rand(count, n, generator=random) * 2.0 - 1.0 for n in (3, 4))
    weights, values = (torch.rand(count, generator=random) for _ in range(2))
    return [means, scales, quats, weights, values]


def step(tensors: list[Tensor], places: Tensor, truth: Tensor) -> tuple[float, float]:
    """Milliseconds of the forward and the backward pass."""
    started = time.thread_time()
    loss = value_loss(blended_values(*tensors, places), truth)
    between = time.thread_time()
    loss.backward()
    return 1e3 * (between - started), 1e3 * (time.thread_time() - between)


def passes(tensors: list[Tensor], places: Tensor, steps: int, shapes: bool) -> list[str]:
    """Times of the forward and the backward pass, "median (fastest)"."""
    learnt = [t.clone().requires_grad_(shapes or number == 4) for number, t in enumerate(tensors)]
    truth = torch.rand(len(places))
    step(learnt, places, truth)
    taken = [step(learnt, places, truth) for _ in range(steps)]
    return [f"{digits(statistics.median(ms))} ({digits(min(ms))})" for ms in zip(*taken, strict=True)]


@click.command()
@click.option("--gaussians", default=20_000, show_default=True)
@click.option("--places", default=256, show_default=True)
@click.option("--steps", default=100, show_default=True)
def main(gaussians: int, places: int, steps: int) -> None:
    """Print the table."""
    torch.set_num_threads(1)
    where = torch.rand(places, 3, generator=torch.Generator().manual_seed(1)) * 2.0 - 1.0
    click.echo(f"{HEADER}\n|{' --- |' * 5}")
    for scale in SCALES:
        tensors = carriers(gaussians, scale)
        reached = kernels.blend([tensor.numpy() for tensor in tensors], where.numpy(), REACH).pairs / max(1, places)
        forward, by_values = passes(tensors, where, steps, False)
        _, by_all = passes(tensors, where, steps, True)
        click.echo(f"| {scale:g} | {reached:.0f} | {forward} | {by_values} | {by_all} |")
    load = " ".join(f"{value:.0f}" for value in os.getloadavg())
    click.echo(
        f"\n{gaussians:,} Gaussians, {places} places, {os.cpu_count()} cores ({platform.machine()}), load {load}"
    )


if __name__ == "__main__":
    main()
