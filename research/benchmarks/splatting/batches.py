"""Pictures a second of `Surrogate.render` for many pictures at once, against a loop over `at(...).render(...)`.

    python -m research.benchmarks.splatting.batches [MODEL] [--quick] [--machine "two cores"]

MODEL is the folder of a trained surrogate; without one, random Gaussians with a bilinear deformation are drawn.  Batches and loops
take turns, and each figure is the median of several rounds.  Writes the table in docs/results/batches.md; a minute or two.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import torch

from catalogs.vocabulary.cameras import Camera, orbit
from catalogs.vocabulary.parameters import Parameter, ParameterSpace
from native.threads import cores
from research.benchmarks.page import RESULTS, command_line, made_by, page_in, stopwatch, table, write_parts
from research.benchmarks.timing import measured_in_turn
from surrogate import Surrogate
from surrogate.deformation import BilinearDeformation
from surrogate.gaussians import Gaussians, Normalization
from surrogate.rasterizer import Rasterizer
from surrogate.settings import TrainingSettings

SIZES = (128,)  # pixels square
COUNTS = (1, 16, 256)  # pictures at once
GAUSSIANS = 10_000


def random_surrogate(count: int) -> Surrogate:
    """Gaussians in a ball that all move with two parameters, by a fixed seed."""
    random = np.random.default_rng(0)

    def drawn(*shape: int, scale: float = 1.0, middle: float = 0.0) -> torch.Tensor:
        return torch.from_numpy(random.normal(middle, scale, shape)).float()

    gaussians = Gaussians(
        drawn(count, 3, scale=0.35),
        drawn(count, 3, scale=0.3, middle=-3.3),
        drawn(count, 4),
        drawn(count, middle=-1.0),
        drawn(count, 12).sigmoid(),
    )
    deformation = BilinearDeformation.create(gaussians, 2, TrainingSettings())
    moving = deformation.tensors() | {"weights_out": drawn(*deformation.weights_out.shape, scale=0.05)}
    space = ParameterSpace((Parameter("a", 0.0, 1.0), Parameter("b", 0.0, 1.0)))
    still = Normalization(np.zeros(3), 1.0)
    return Surrogate(gaussians, deformation.with_tensors(moving), space, still, Rasterizer())


def measured(surrogate: Surrogate, sizes: Sequence[int], counts: Sequence[int], seconds: float) -> str:
    """The table: many members from one camera, and one member from many cameras."""
    rows = []
    for size in sizes:
        around = orbit(surrogate.normalization.center, 1.7 * surrogate.normalization.extent, width=size, height=size)
        for count in counts:
            values = surrogate.space.latin_hypercube(count, seed=0)  # [B, P]
            views = [around[k % len(around)] for k in range(count)]
            cases: dict[str, tuple[Any, list[Camera]]] = {"members": (values, views[:1])}
            if count > 1:
                cases |= {"views": (values[:1], views)}
            for name, (parameters, cameras) in cases.items():
                batch = partial(surrogate.render, parameters, cameras)
                single = partial(_loop, surrogate, parameters, cameras, count)
                fast, slow, _ = measured_in_turn([batch, single], seconds)
                ratio = f"{slow.median / fast.median:.2f}"
                pictures = [f"{1e3 * count / each.median:.0f}" for each in (fast, slow)]
                rows.append([f"{size}²", name, str(count), *pictures, ratio])
    header = ["picture", "differing", "B", "batch, pictures/s", "loop, pictures/s", "ratio"]
    return f"{len(surrogate.gaussians):,} Gaussians, {cores()} cores.\n\n{table(header, rows)}"


def _loop(surrogate: Surrogate, parameters: np.ndarray, cameras: Sequence[Camera], count: int) -> None:
    """The same images rendered singly: a member with many cameras is deformed once."""
    names = surrogate.space.names
    member = surrogate.at(**dict(zip(names, parameters[0].tolist(), strict=True)))
    for k in range(count):
        if k and len(parameters) > 1:
            member = surrogate.at(**dict(zip(names, parameters[k].tolist(), strict=True)))
        member.render(cameras[k % len(cameras)])


def main(arguments: Sequence[str] | None = None, say: Callable[[str], None] | None = None) -> None:
    """Write the table."""
    options = command_line("splatting.batches", __doc__)
    options.add_argument("model", nargs="?", type=Path, help="folder of a trained surrogate")
    options.add_argument("--quick", action="store_true", help="small and few: does it run?")
    options.add_argument("--machine", default="", help="the machine, in words")
    options.add_argument("--output", type=Path, default=RESULTS, help="folder that holds batches.md")
    given = options.parse_args(arguments)
    surrogate = Surrogate.load(given.model) if given.model else random_surrogate(200 if given.quick else GAUSSIANS)
    sizes, counts, seconds = ((16,), (1, 4), 0.01) if given.quick else (SIZES, COUNTS, 1.0)
    page = page_in(given.output, "batches.md")
    made = made_by("splatting.batches", on=given.machine)
    parts = {"batches": lambda: measured(surrogate, sizes, counts, seconds)}
    if write_parts(page, parts, made, say or stopwatch()):
        sys.exit(1)


if __name__ == "__main__":
    main()
