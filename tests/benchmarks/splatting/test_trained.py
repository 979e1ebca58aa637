"""Schedules that fit a time."""

from __future__ import annotations

from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

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
