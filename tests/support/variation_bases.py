"""A base transfer function, and the steps and isovalues by which it is varied."""

from __future__ import annotations

from typing import Any

import numpy as np

from catalogs.vocabulary.appearance import TransferFunction, VolumeRendering

COLORS = ((-1.0, 0.0, 0.0, 1.0), (3.0, 1.0, 0.0, 0.0))
FUNCTION = TransferFunction(COLORS, ((-1.0, 0.0), (0.5, 0.2), (1.5, 0.5), (3.0, 1.0)), 0.3)
BASE = VolumeRendering("dvr", FUNCTION)
STEPS: dict[str, Any] = {"first_step": (0.25, 0.1), "second_step": (0.5, 0.25)}
SCALE = np.array([0.25, 0.1, 0.5, 0.25])
ISOVALUES = (2.0, 4.0, 8.0, 16.0)
