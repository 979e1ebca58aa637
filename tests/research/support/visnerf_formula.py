"""ViSNeRF's field, written out in float64."""

from __future__ import annotations

import math

import numpy as np
import torch
from numpy.typing import NDArray

from research.studies.baselines.visnerf_field import (
    Quantity,
    ViSNeRFArchitecture,
    ViSNeRFField,
)

UNEVEN = ViSNeRFArchitecture((5, 4, 3), (3, 6))
QUANTITIES: tuple[Quantity, ...] = ("density", "color")


def field_of(architecture: ViSNeRFArchitecture, seed: int = 0, spread: float = 1.0) -> ViSNeRFField:
    """A field of normal numbers, whose densities and colours vary strongly."""
    random = np.random.default_rng(seed)
    first = architecture.initial(random)
    tensors = {name: torch.from_numpy(random.normal(size=t.shape)).float() for name, t in first.items()}
    networks = {name: t * spread / math.sqrt(t.shape[-1]) for name, t in tensors.items() if ".weights" in name}
    return ViSNeRFField(tensors | networks, architecture)


def in_float64(field: ViSNeRFField) -> dict[str, NDArray[np.float64]]:
    return {name: tensor.double().numpy() for name, tensor in field.tensors.items()}


def lerp(values: NDArray[np.float64], at: float) -> NDArray[np.float64]:
    """Values (C, L) between -1 and 1, linearly interpolated: (C,)."""
    return np.array([np.interp(at, np.linspace(-1.0, 1.0, values.shape[1]), row) for row in values])


def bilerp(plane: NDArray[np.float64], column: float, row: float) -> NDArray[np.float64]:
    return lerp(np.stack([lerp(rows, column) for rows in plane.transpose(1, 0, 2)], axis=1), row)


def expected_components(
    tensors: dict[str, NDArray[np.float64]], kind: str, point: NDArray[np.float64]
) -> NDArray[np.float64]:
    x, y, z = point
    return (
        bilerp(tensors[f"{kind}.plane_xy"], x, y) * lerp(tensors[f"{kind}.line_z"][..., 0], z)
        + bilerp(tensors[f"{kind}.plane_xz"], x, z) * lerp(tensors[f"{kind}.line_y"][..., 0], y)
        + bilerp(tensors[f"{kind}.plane_yz"], y, z) * lerp(tensors[f"{kind}.line_x"][..., 0], x)
    )


def expected_outputs(
    field: ViSNeRFField,
    kind: str,
    point: NDArray[np.float64],
    parameters: NDArray[np.float64],
    direction: NDArray[np.float64],
) -> NDArray[np.float64]:
    """A network's output before its activation, written out in float64."""
    tensors = in_float64(field)
    vectors = [lerp(tensors[f"{kind}.vector_{j}"][..., 0], p) for j, p in enumerate(parameters)]
    known = np.concatenate([expected_components(tensors, kind, point), *vectors])
    features = tensors[f"{kind}.basis.weights"] @ known

    def waves(values: NDArray[np.float64]) -> list[float]:
        both = [factor * value for value in values for factor in (1, 2)]
        return [math.sin(v) for v in both] + [math.cos(v) for v in both]

    if kind == "density":
        inputs = [*point, *features, *waves(point), *waves(features)]
    else:
        inputs = [*features, *direction, *waves(features), *waves(direction)]
    hidden = np.array(inputs)
    for layer in (1, 2, 3):
        weights, biases = tensors[f"{kind}.layer_{layer}.weights"], tensors[f"{kind}.layer_{layer}.biases"]
        hidden = weights @ (np.maximum(hidden, 0.0) if layer > 1 else hidden) + biases
    return hidden
