"""Gaussians as SPZ, Niantic's compressed format, version 3.

Source: github.com/nianticlabs/spz, "File Format" as of version 3, and `packGaussians` of src/cc/load-spz.cc.  Version 4
needs Zstandard, which few viewers read yet; all read version 3.
"""

from __future__ import annotations

import gzip
import math
import struct

import numpy as np
from numpy.typing import NDArray

from surrogate.explore.exporting.splats import Splats

MAGIC, VERSION = 0x5053474E, 3
POSITION_BITS = 23  # of 24, beside the sign
MOST_FRACTIONAL = 23
COLOR_SCALE = 0.15
MOST_CUT = 0.01  # of sizes, which the format can't hold
COMPONENT = 511  # of a quaternion, 9 bits beside the sign

Array = NDArray[np.float64]


def spz_bytes(splats: Splats) -> bytes:
    """The Gaussians in world units about the origin of the world, axes as they are (taken as right, up, back).

    Fixed point has 24 bits a coordinate, with as many fractional ones as fit.  Logarithms of scales go in steps of 1/16, which are
    6 %, from exp(-10) to exp(5.9).  Opacities, colours and harmonics have 8 bits, quaternions 10 a component.  Raises ValueError
    for places that this can't hold, and where it can't hold more than 1 % of the sizes; fewer are cut.
    """
    far = float(np.abs(splats.means).max(initial=1e-6))
    fractional = min(MOST_FRACTIONAL, POSITION_BITS - 1 - math.floor(math.log2(far)))
    if fractional < 0:
        raise ValueError(f"SPZ holds places up to {2**POSITION_BITS:,} from the origin, got {far:.4g}: choose .glb")
    steps = (np.log(splats.scales) + 10.0) * 16.0
    if np.mean((steps < 0.0) | (steps > 255.0)) > MOST_CUT:
        raise ValueError(
            f"SPZ holds sizes from {math.exp(-10.0):.2g} to {math.exp(5.9):.3g} in world units, and those here go from "
            f"{splats.scales.min():.2g} to {splats.scales.max():.3g}: choose .glb, or smaller units"
        )
    header = struct.pack("<IIIBBBB", MAGIC, VERSION, len(splats), splats.degree, fractional, 0, 0)
    parts = (
        _fixed(splats.means * 2.0**fractional),
        _bytes(splats.opacities * 255.0),
        _bytes((splats.harmonics[:, 0] * COLOR_SCALE + 0.5) * 255.0),
        _bytes(steps),
        _smallest_three(splats.quats[:, [1, 2, 3, 0]]),
        _bytes(splats.harmonics[:, 1:] * 128.0 + 128.0),
    )
    return gzip.compress(header + b"".join(part.tobytes() for part in parts), mtime=0)


def _bytes(values: Array) -> NDArray[np.uint8]:
    return np.floor(values + 0.5).clip(0.0, 255.0).astype(np.uint8)


def _fixed(values: Array) -> NDArray[np.uint8]:
    """Three bytes of each, little-endian, two's complement."""
    whole = np.rint(values).clip(-(2**POSITION_BITS), 2**POSITION_BITS - 1).astype("<i4")
    return np.ascontiguousarray(whole.view(np.uint8).reshape(*whole.shape, 4)[..., :3])


def _smallest_three(quats: Array) -> NDArray[np.uint32]:
    """Unit quaternions (N, 4) x, y, z, w without the largest component: its number, and sign and size of the others."""
    largest = np.abs(quats).argmax(axis=1)
    flipped = np.take_along_axis(quats, largest[:, None], axis=1)[:, 0] < 0.0
    sizes = np.floor(COMPONENT * np.abs(quats) * math.sqrt(2.0) + 0.5).astype(np.uint32)
    packed = largest.astype(np.uint32)
    for component in range(4):
        sign = ((quats[:, component] < 0.0) ^ flipped).astype(np.uint32)
        longer = (packed << 10) | (sign << 9) | sizes[:, component]
        packed = np.where(largest == component, packed, longer)
    return packed.astype("<u4")
