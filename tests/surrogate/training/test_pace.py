"""The speed of training on this machine, measured in a few steps."""

from __future__ import annotations

import itertools
from pathlib import Path

import pytest

from surrogate.settings import TrainingSettings
from surrogate.training.data import training_rows
from surrogate.training.pace import measure_pace
from surrogate.training.source import Source
from tests.support.results import make_catalog


@pytest.mark.slow
def test_speed_is_measured_on_a_few_images_by_the_clock_of_the_budget(tmp_path: Path) -> None:
    source = Source(TrainingSettings(gaussians=30), make_catalog(tmp_path, "blobs"))
    rows = [training_rows(source.catalog, [source.appearance])]
    ticks = itertools.count()
    ticking = measure_pace(source, rows, lambda: 0.5 * next(ticks))
    assert (ticking.step, ticking.draw, ticking.load) == (0.5, 0.5 / 6, 0.5 / 6)
    pace = measure_pace(source, rows)
    assert 0.0 < pace.draw < 1.0
    assert 0.0 < pace.step < 1.0
    assert (pace.varied, pace.mean_step) == ((), pace.step)
