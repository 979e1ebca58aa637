"""A small ensemble as the emulator of its fields: a blob that grows with p, in the box [0, 1]³."""

from __future__ import annotations

import numpy as np

from catalogs.vocabulary.appearance import VolumeRendering
from catalogs.vocabulary.parameters import Parameter, ParameterSpace
from surrogate.emulation import EmulatedFields, FieldEmulator
from surrogate.gaussians import Normalization
from surrogate.model import FieldModel
from tests.support.hooked import FUNCTION, blob

SIZE = 8
POINTS = np.linspace(-1.0, 1.0, 5)[:, None]


def some_field_model() -> FieldModel:
    """Its base is a volume rendering; p lies in [0, 1]."""
    fields = np.stack([blob(size=SIZE) * (1.0 + 0.3 * p) for p in POINTS[:, 0]])
    emulator = FieldEmulator.fit(POINTS, fields, (1.0 / (SIZE - 1),) * 3, (0.0, 0.0, 0.0))
    space = ParameterSpace((Parameter("p", 0.0, 1.0),))
    box = Normalization.of_box(((0.0, 0.0, 0.0), (1.0, 1.0, 1.0)))
    return FieldModel(EmulatedFields(space, {"": emulator}), (VolumeRendering("dvr", FUNCTION),), (), box)
