"""A run of two parameters, of which its pictures show one."""

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

SIDE = 12
TRUE = 0.42


def shown(p: float) -> Any:
    """A field that p moves and q does not."""
    wave = np.sin(np.linspace(0.0, 6.0, SIDE) + 3.0 * p)
    return (blob(size=SIDE) * (0.7 + 0.3 * wave)).astype(np.float32)


def run_in(folder: Path) -> Path:
    """Make it in a folder: a catalog, with one test member at p = `TRUE`, beside an emulated field."""
    space = ParameterSpace((Parameter("p", 0.0, 1.0), Parameter("q", 1.0, 100.0, scale="log")))
    views = ViewPlan(frequency=1, width=32, height=32)
    random = np.random.default_rng(0)
    splits = {"train": np.linspace(0.0, 1.0, 12), "validation": [0.11, 0.34, 0.57, 0.81], "test": [TRUE]}
    appearances = [VolumeRendering("dvr", FUNCTION)]
    with insitu.Session(  # whose pictures err less than their 8 bits: what is off is then the surrogate's
        folder / "catalog.cdb", space=space, appearances=appearances, views=views, target_decibels=57.0
    ) as session:
        for split, values in splits.items():
            for p in values:
                parameters = {"p": float(p), "q": float(10.0 ** random.uniform(0.0, 2.0))}
                session.render_member(shown(p), parameters, spacing=(1.1 / (SIDE - 1),) * 3, split=split)
    return finish(folder, only_field=True)
