"""Schedules that fit a time."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from research.benchmarks.splatting.trained import POINTS, planned
from research.studies.ablation.timing import StepTimes
from surrogate.settings import TrainingSettings

SETTINGS = TrainingSettings(visualization_steps=0)


@given(st.floats(5.0, 500.0), st.floats(0.001, 0.02), st.floats(0.001, 0.02))
def test_schedule_takes_the_time_it_is_given(seconds: float, canonical: float, deformation: float) -> None:
    settings = planned(SETTINGS, seconds, StepTimes(1.0, canonical, deformation))
    taken = 1.0 + settings.canonical_steps * canonical + settings.deformation_steps * deformation
    assert taken == pytest.approx(seconds, abs=2 * (canonical + deformation))
    assert settings.deformation_steps / settings.canonical_steps == pytest.approx(5.0, rel=0.05)


@pytest.mark.parametrize("steps", [5, 100, 12_345])
def test_a_curve_has_points_enough_to_be_drawn(steps: int) -> None:
    settings = planned(SETTINGS, float(steps), StepTimes(0.0, 1.0, 1.0))
    points = steps / settings.validation_interval
    assert min(steps, POINTS) <= points <= 1.1 * POINTS
    interval, stages = settings.validation_interval, {"canonical_steps": 2_000, "deformation_steps": 10_000}
    assert settings.changed(**stages) == SETTINGS.changed(validation_interval=interval, **stages)
