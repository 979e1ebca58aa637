import time
from pathlib import Path

import pytest

from research.studies.ablation.timing import (
    FEWEST_STEPS,
    StepTimes,
    measure_step_times,
    scheduled,
    steps_of,
    with_steps,
)
from surrogate.settings import TrainingSettings
from surrogate.training.run import train
from tests.support.blobs import Blobs

VIEW_SPLITS = ("train", "train", "train", "validation", "test")
SMALL = Blobs(count=4, size=16)
SCENE = TrainingSettings(
    gaussians=60,
    canonical_steps=100,
    deformation_steps=300,
    visualization_steps=0,
    color_degree=0,
    fit_to_need=False,
    validation_images=0,
)


def test_steps_fill_the_time_and_are_shared_out_as_before() -> None:
    times = StepTimes(2.0, 0.01, 0.03)
    planned = scheduled(SCENE, 12.0, times)
    assert steps_of(planned) == (100, 300, 0)
    assert times.seconds(planned) == pytest.approx(12.0)
    twice = scheduled(SCENE, 22.0, times)
    assert steps_of(twice) == (200, 600, 0)
    assert twice.changed(canonical_steps=100, deformation_steps=300) == SCENE


@pytest.mark.parametrize(
    "stages", [(0, 400, 0), (400, 0, 0), (1, 399, 0), (399, 1, 0), (0, 0, 400), (1, 398, 1), (1, 1, 398), (100, 0, 300)]
)
@pytest.mark.parametrize("steps", [0, 5, 1000])
def test_a_stage_that_is_there_stays_and_no_other_appears(stages: tuple[int, int, int], steps: int) -> None:
    names = ("canonical_steps", "deformation_steps", "visualization_steps")
    planned = with_steps(SCENE.changed(**dict(zip(names, stages, strict=True))), steps)
    assert sum(steps_of(planned)) == max(steps, FEWEST_STEPS)
    assert [bool(count) for count in steps_of(planned)] == [bool(count) for count in stages]
    if steps > 5:
        assert steps_of(planned) == pytest.approx([count * steps / 400 for count in stages], abs=2.5)


def test_a_start_that_takes_all_the_time_is_said() -> None:
    with pytest.raises(
        ValueError, match="it takes 70 s before the first step, and the budget is 60 s: --seconds allows more"
    ):
        scheduled(SCENE, 60.0, StepTimes(70.0, 0.01, 0.01))


def test_training_takes_about_as_long_as_its_pace_says(make_catalog, tmp_path: Path) -> None:
    catalog = make_catalog(SMALL, view_splits=VIEW_SPLITS)
    times = measure_step_times(SCENE, catalog, 0.2)
    planned = scheduled(SCENE, 0.5, times._replace(start=0.0))
    started = time.process_time()
    train(planned, catalog, tmp_path / "surrogate")
    assert times.canonical > 0
    assert times.deformation > 0
    assert 0.1 < time.process_time() - started < 5.0  # other things to do make a machine's caches slower, too


def test_a_stage_that_is_not_there_takes_no_time(make_catalog) -> None:
    times = measure_step_times(SCENE.changed(canonical_steps=0), make_catalog(SMALL, view_splits=VIEW_SPLITS), 0.1)
    assert times.canonical == 0.0
    assert times.deformation > 0.0
