"""A run of one parameter whose field changes ever faster: hard to predict where the parameter is large."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

import insitu
from catalogs.vocabulary.appearance import VolumeRendering
from catalogs.vocabulary.parameters import Parameter, ParameterSpace
from catalogs.vocabulary.scene import ViewPlan
from tests.support.finished_runs import finish
from tests.support.hooked import FUNCTION, blob

TRAINED = np.linspace(0.0, 1.0, 14)
VALIDATED, TESTED = (0.11, 0.34, 0.57, 0.81), (0.04, 0.2, 0.42, 0.5, 0.65, 0.73, 0.88, 0.96)
SIDE = 12


def moving(p: float) -> Any:
    """A field that changes ever faster with p: hard to predict where p is large."""
    wave = np.sin(np.linspace(0.0, 9.0, SIDE) + 12.0 * p**3)
    return (blob(size=SIDE) * (0.7 + 0.3 * wave)).astype(np.float32)


def run_in(folder: Path) -> Path:
    """Make it in a folder: a catalog beside an emulated field."""
    space = ParameterSpace((Parameter("p", 0.0, 1.0),))
    views = ViewPlan(frequency=1, width=32, height=32)
    with insitu.Session(
        folder / "catalog.cdb", space=space, appearances=[VolumeRendering("dvr", FUNCTION)], views=views
    ) as session:
        for split, values in (("train", TRAINED), ("validation", VALIDATED), ("test", TESTED)):
            for p in values:
                session.render_member(moving(p), {"p": float(p)}, spacing=(1.1 / (SIDE - 1),) * 3, split=split)
    return finish(folder, only_field=True)
