"""Minimal work of splatting, and the time that this machine needs for it at least.

Counted term by term from the loops over blocks of pixels in native/kernels/src/tiles.inc, per (pixel, Gaussian) pair
that is drawn. A fused multiply-add is two floating-point operations (flops) but occupies a vector unit once, as does
every other arithmetic instruction. The floor therefore counts instructions at the measured rate of fused multiply-adds.
Loads, stores and bit masks are not counted, nor are pixels of a block outside the Gaussian: the floor is below what any
kernel can reach.
"""

from __future__ import annotations

import subprocess
import tempfile
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

from research.benchmarks.splatting.compiling import WIDTHS, compiled

SOURCE = Path(__file__).with_name("peak.cpp")
REFERENCE_LOOP = 1e9  # fused multiply-adds of one float each

# (fused multiply-adds, other arithmetic instructions) per pair, in the order of the source.
_WEIGHT_TERMS: Mapping[str, tuple[int, int]] = {
    "u, v: the block's offset added": (0, 2),
    "power = peak - u u - v v": (2, 0),
    "power and transmittance compared with their floors": (0, 2),
    "exp2: fraction, polynomial of degree 5, exponent": (5, 2),
    "alpha capped": (0, 1),
    "weight = alpha transmittance": (0, 1),
}
FORWARD_TERMS: Mapping[str, tuple[int, int]] = {
    **_WEIGHT_TERMS,
    "transmittance less weight": (0, 1),
    "three colors": (3, 0),
}
BACKWARD_TERMS: Mapping[str, tuple[int, int]] = {
    **_WEIGHT_TERMS,
    "worth = color . gradient + gradient by alpha": (3, 0),
    "gain = weight worth": (0, 1),
    "transmittance less weight, what is to come less gain": (0, 2),
    "gain - alpha after / (1 - alpha)": (0, 4),
    "compared with the cap": (0, 1),
    "h u, h v": (0, 2),
    "sums of h, h u, h v": (0, 3),
    "sums of h u u, h u v, h v v": (3, 0),
    "sums of weight gradient, three colors": (3, 0),
}
# Per Gaussian, in double precision (native/kernels/src/projection.inc): one double takes the room of two floats.
PROJECTION = 215  # project_batch 173, make_splats about 42
PROJECTION_BACKWARD = 465  # project_batch again, batch_backward about 290
PARAMETER_BYTES = 56  # 14 floats of a Gaussian
PIXEL_BYTES = 16  # colour and alpha


@dataclass(frozen=True)
class Work:
    """`flops`; `instructions`, in floats (an instruction on a vector of 16 counts 16); `bytes` that must be moved."""

    flops: float
    instructions: float
    bytes: float

    def __add__(self, other: Work) -> Work:
        return Work(self.flops + other.flops, self.instructions + other.instructions, self.bytes + other.bytes)


class Peak(NamedTuple):
    """Peak rates of the idle machine: 10^9 flops per second, 10^9 bytes per second."""

    gigaflops: float
    gigabytes: float

    @classmethod
    def measure(cls, instruction_set: str, threads: int, seconds: float) -> Peak:
        """Run a fixed loop of fused multiply-adds, and stream through memory, for `seconds` each."""
        with tempfile.TemporaryDirectory() as folder:
            width = f"-DGS_WIDTH={WIDTHS[instruction_set]}"
            program = compiled(SOURCE, Path(folder) / "peak", instruction_set, width, "-pthread")
            said = subprocess.run([program, str(threads), str(seconds)], capture_output=True, text=True, check=True)
        return cls(*map(float, said.stdout.split()))

    def loop_ms(self) -> float:
        """Milliseconds of the reference loop: 10^9 fused multiply-adds."""
        return 2.0 * REFERENCE_LOOP / self.gigaflops / 1e6

    def floor_ms(self, work: Work) -> float:
        """Least milliseconds for `work`: at the peak rate of arithmetic, or of memory where that takes longer."""
        return max(2.0 * work.instructions / self.gigaflops, work.bytes / self.gigabytes) / 1e6

    def share(self, work: Work, milliseconds: float) -> float:
        """Flops per second of `work` done in that time, as a part of the peak."""
        return work.flops / milliseconds / 1e6 / self.gigaflops


def forward_work(interactions: int, gaussians: int, pixels: int) -> Work:
    """To draw: read the parameters, project, composite, write the picture."""
    moved = PARAMETER_BYTES * gaussians + PIXEL_BYTES * pixels
    return _pairs(FORWARD_TERMS, interactions) + _projection(PROJECTION, gaussians) + Work(0, 0, moved)


def backward_work(interactions: int, gaussians: int, pixels: int) -> Work:
    """To differentiate: read parameters, picture and its gradient, composite anew, write a gradient per parameter."""
    moved = 2 * PARAMETER_BYTES * gaussians + 2 * PIXEL_BYTES * pixels
    return _pairs(BACKWARD_TERMS, interactions) + _projection(PROJECTION_BACKWARD, gaussians) + Work(0, 0, moved)


def _pairs(terms: Mapping[str, tuple[int, int]], interactions: int) -> Work:
    fused, others = (sum(column) for column in zip(*terms.values(), strict=True))
    return Work((2 * fused + others) * interactions, (fused + others) * interactions, 0)


def _projection(doubles: int, gaussians: int) -> Work:
    """Work of projections; most of it consists of multiplications and additions that fuse in pairs."""
    return Work(2 * doubles * gaussians, doubles * gaussians, 0)
