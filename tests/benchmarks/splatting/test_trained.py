"""Schedules that fit a time, importance that is a sum of weights, rounding that is as fine as it says."""

from __future__ import annotations

from typing import Any

import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from benchmarks.splatting.precisions import levels
from benchmarks.splatting.trained import FEWEST_STEPS, Pace, pace_of, scheduled
from surrogate.settings import TrainingSettings


def curve(start: float, canonical: float, deformation: float) -> list[dict[str, Any]]:
    points = [{"stage": "canonical", "step": n, "seconds": start + n * canonical} for n in (100, 200)]
    middle = start + 200 * canonical
    return points + [
        {"stage": "deformation", "step": 200 + n, "seconds": middle + n * deformation} for n in (100, 200, 300)
    ]


def test_pace_of_a_made_up_run() -> None:
    assert pace_of(curve(1.5, 0.01, 0.02)) == pytest.approx((1.5, 0.01, 0.02))


@given(st.floats(5.0, 500.0), st.floats(0.001, 0.02), st.floats(0.001, 0.02))
def test_schedule_takes_the_time_it_is_given(seconds: float, canonical: float, deformation: float) -> None:
    settings = scheduled(TrainingSettings(), seconds, Pace(1.0, canonical, deformation))
    if min(settings.canonical_steps, settings.deformation_steps) > FEWEST_STEPS:
        taken = 1.0 + settings.canonical_steps * canonical + settings.deformation_steps * deformation
        assert taken == pytest.approx(seconds, abs=2 * (canonical + deformation))
        ratio = settings.deformation_steps / settings.canonical_steps
        assert ratio == pytest.approx(5.0, rel=0.05)
    assert settings.validation_interval >= 1


def test_no_schedule_is_empty() -> None:
    settings = scheduled(TrainingSettings(), 0.5, Pace(1.0, 0.01, 0.01))
    assert settings.canonical_steps == settings.deformation_steps == FEWEST_STEPS


@pytest.mark.parametrize("bits", [1, 8, 16])
def test_levels_are_as_many_and_as_near_as_they_say(bits: int) -> None:
    tensor = torch.randn(5000, 3, dtype=torch.float64, generator=torch.Generator().manual_seed(0))
    tensor[:, 2] = 7.0
    rounded = levels(tensor, bits)
    spread = tensor.amax(0) - tensor.amin(0)
    assert ((rounded - tensor).abs() <= 0.5001 * spread / (2**bits - 1) + 1e-12).all()
    assert rounded[:, 0].unique().numel() <= 2**bits
    torch.testing.assert_close(rounded.amax(0), tensor.amax(0))
    assert (rounded[:, 2] == 7.0).all()
