"""Surrogates of few Gaussians that follow everything, made by hand."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

from surrogate import Surrogate
from surrogate.settings import TrainingSettings
from tests.support.visualizations import base, of_functions, of_isovalue
from tests.support.visualizations import surrogate as made

TRAINING = {
    "appearance": "dvr",
    "fingerprint": "by hand",
    "seconds": 1.0,
    "steps": 10,
    "settings": TrainingSettings().to_json(),
    "curve": [],
}


def following() -> Surrogate:
    """One parameter p in [0, 1], any transfer function in any colours, any isovalue.

    At the base colours stay in [0, 1], so that stored pictures hold all of them.
    """
    fitted = base()
    fitted.gaussians.colors.clamp_(0.05, 0.95)
    fitted = fitted._replace(deformation=fitted.deformation.without("colors"))
    whole = made(fitted, of_functions(fitted), of_isovalue(fitted))
    return replace(whole, training=TRAINING)


@cache
def plain() -> Surrogate:
    """One parameter p in [0, 1] and nothing else."""
    return replace(made(base()), training=TRAINING)
