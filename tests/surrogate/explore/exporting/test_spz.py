"""Gaussians as SPZ, read as its README says."""

from __future__ import annotations

import gzip
import struct
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from surrogate.explore.exporting.splats import Splats
from surrogate.explore.exporting.spz import spz_bytes
from tests.support.surrogates import some_surrogate

Array = NDArray[Any]


def splats(color_columns: int = 3, far: float = 0.0) -> Splats:
    made = Splats.of(some_surrogate(color_columns).at(Re=1830.0, time=0.4))
    return replace(made, means=made.means - made.means.mean(axis=0) + far)


def read(content: bytes) -> tuple[int, dict[str, Array]]:
    """Fractional bits, and the attributes by name."""
    data = gzip.decompress(content)
    magic, version, count, degree, fractional, flags, reserved = struct.unpack_from("<IIIBBBB", data)
    assert (magic, version, flags, reserved) == (0x5053474E, 3, 0, 0)
    place, parts = 16, []
    for width in (9, 1, 3, 3, 4, 3 * ((degree + 1) ** 2 - 1)):
        parts.append(np.frombuffer(data, np.uint8, count * width, place).reshape(count, width).astype(np.int64))
        place += count * width
    assert place == len(data)
    low, middle, high = parts[0].reshape(count, 3, 3).transpose(2, 0, 1)
    fixed = low | middle << 8 | high << 16
    return fractional, {
        "means": np.where(fixed >= 1 << 23, fixed - (1 << 24), fixed) / 2.0**fractional,
        "opacities": parts[1][:, 0] / 255.0,
        "base": 0.5 + 0.28209479177387814 * (parts[2] / 255.0 - 0.5) / 0.15,
        "scales": np.exp(parts[3] / 16.0 - 10.0),
        "quats": np.array([quaternion(int.from_bytes(bytes(row.astype(np.uint8)), "little")) for row in parts[4]]),
        "rest": ((parts[5] - 128.0) / 128.0).reshape(count, -1, 3),
    }


def quaternion(packed: int) -> list[float]:
    """The unit quaternion w, x, y, z: 2 bits for the largest of x, y, z, w, then 10 for each of the others, in this order."""
    largest, values = packed >> 30, [0.0] * 4
    for component in reversed([i for i in range(4) if i != largest]):
        size = (packed & 511) / 511.0 / 2.0**0.5
        values[component] = -size if packed >> 9 & 1 else size
        packed >>= 10
    values[largest] = (1.0 - sum(value * value for value in values)) ** 0.5
    x, y, z, w = values
    return [w, x, y, z]


@pytest.mark.parametrize(("columns", "far"), [(3, 0.0), (12, 0.0), (3, 1e5), (3, -5e6)])
def test_all_comes_back_within_its_steps(columns: int, far: float) -> None:
    own = splats(columns, far)
    fractional, found = read(spz_bytes(own))
    largest = np.abs(own.means).max()
    assert largest < 2.0 ** (23 - fractional) <= 2.0 * largest or fractional == 23
    assert np.abs(found["means"] - own.means).max() <= 0.5 / 2.0**fractional + 1e-9
    assert np.abs(np.log(found["scales"] / own.scales)).max() <= 1 / 32 + 1e-9
    assert np.abs(found["opacities"] - own.opacities).max() <= 0.5 / 255.0 + 1e-9
    assert np.abs(found["base"] - own.coefficients[:, 0]).max() <= 0.5 / 255.0 * 0.2821 / 0.15 + 1e-6
    assert np.abs((found["quats"] * own.quats).sum(1)).min() > 1.0 - 1e-5
    assert found["rest"].shape == (len(own), columns // 3 - 1, 3)
    if columns == 12:
        assert np.abs(found["rest"] - own.coefficients[:, 1:].clip(-1.0, 127 / 128)).max() <= 0.5 / 128 + 1e-9


@pytest.mark.parametrize(
    ("factor", "far", "error"), [(1.0, 1e8, r"places up to 8,388,608"), (1e6, 0.0, r"sizes from 4.5e-05 to 365")]
)
def test_what_the_format_can_not_hold_is_refused(factor: float, far: float, error: str) -> None:
    own = splats(3, far)
    with pytest.raises(ValueError, match=error):
        spz_bytes(replace(own, scales=own.scales * factor))
