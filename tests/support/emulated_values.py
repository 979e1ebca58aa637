"""Values of Gaussians that follow a small emulated field, with and without a scale."""

from __future__ import annotations

import numpy as np
import torch

from catalogs.vocabulary.appearance import TransferFunction
from surrogate.appearance.scale import ValueScale
from surrogate.deformation.emulated_values import EmulatedValues
from surrogate.emulation.processes import Processes

COUNT, MODES, MEMBERS = 50, 4, 9
FUNCTION = TransferFunction(
    ((0.0, 0.0, 0.0, 1.0), (3.0, 1.0, 1.0, 1.0), (4.0, 1.0, 0.0, 0.0)), ((0.0, 0.1), (1.0, 0.0), (4.0, 0.9)), 1.0
)
SCALE = ValueScale.of_function(FUNCTION)


def processes() -> Processes:
    random = np.random.default_rng(0)
    points = random.uniform(-1.0, 1.0, (MEMBERS, 2)).astype(np.float32).astype(np.float64)
    coefficients = random.standard_normal((MEMBERS, MODES)).astype(np.float32).astype(np.float64)
    lengths = np.array([[0.5, 2.0], [1.0, 0.75]])
    return Processes(
        points, coefficients, lengths, np.array([1e-3, 1e-2], np.float32).astype(float), np.array([0, 0, 1, 1])
    )


def emulated(scale: ValueScale | None = SCALE) -> EmulatedValues:
    random = torch.Generator().manual_seed(1)
    means = 4.0 * torch.rand(COUNT, generator=random)
    return EmulatedValues(means, torch.randn(COUNT, MODES, generator=random), processes(), scale)
