"""A simulation of three parameters in a microsecond: a blob that p changes much, q less, and r not at all."""

from __future__ import annotations

from typing import Any

import numpy as np

from catalogs.vocabulary.parameters import Parameter, ParameterSpace
from tests.support.hooked import blob

SPACE = ParameterSpace(
    (Parameter("p", 0.0, 1.0), Parameter("q", 1.0, 100.0, "m", scale="log"), Parameter("r", 0.0, 1.0))
)
SIDE = 12
SPACING = (1.1 / (SIDE - 1),) * 3


def shown(p: float, q: float, r: float) -> Any:
    """The field (12, 12, 12)."""
    wave = np.sin(np.linspace(0.0, 6.0, SIDE) + 2.0 * p)
    return (blob(size=SIDE) * (0.7 + 0.3 * wave + 0.05 * np.log10(q))).astype(np.float32)
