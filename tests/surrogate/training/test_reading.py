"""The time that reading images takes beside the steps."""

from __future__ import annotations

import pytest

from surrogate.training.reading import Reading


def seconds(reading: Reading, steps: int, step: float, *, kept: bool) -> float:
    """Of some steps, by what each reads: early images once where they are kept, late ones again and again."""
    of_disk = 1.0 - reading.in_memory / reading.images
    if not kept:
        return steps * (step + of_disk * reading.load)
    late = reading.late * steps * of_disk * reading.load
    return steps * step + late + (1.0 - reading.late) * reading.images * of_disk * reading.load


@pytest.mark.parametrize("kept", [0.0, 0.5, 1.0])
@pytest.mark.parametrize("in_memory", [0, 60, 100])
@pytest.mark.parametrize("images", [100, 10_000])
def test_as_many_steps_as_fit_with_what_they_read(kept: float, in_memory: int, images: int) -> None:
    reading = Reading(images, in_memory, 0.02, 1.0 - 0.7 * kept)
    steps, _ = reading.steps(60.0, 0.01, 1.0)
    either = [seconds(reading, steps, 0.01, kept=way) for way in (False, True)]
    assert min(either) <= 60.0
    assert min(seconds(reading, steps + 1, 0.01, kept=way) for way in (False, True)) > 60.0
    assert reading.before == pytest.approx(0.02 * in_memory)


def test_choices_take_their_share() -> None:
    reading = Reading(100, 100, 0.02, 1.0)
    assert reading.steps(60.0, 0.01, 1.25) == (4_800, 0.01)
