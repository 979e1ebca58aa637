import numpy as np
import pytest

from surrogate.randomness import generator
from surrogate.training.sampling import ShuffledEpochs


def test_every_epoch_visits_every_image_once_in_another_order() -> None:
    order = ShuffledEpochs(50, seed=3)
    first, second = ([order[step] for step in range(start, start + 50)] for start in (0, 50))
    assert sorted(first) == sorted(second) == list(range(50))
    assert first != second


def test_a_step_is_drawn_alike_however_one_got_there() -> None:
    walked = ShuffledEpochs(7, seed=1)
    visited = [walked[step] for step in range(40)]
    assert [ShuffledEpochs(7, seed=1)[step] for step in range(40)] == visited
    assert [ShuffledEpochs(7, seed=2)[step] for step in range(40)] != visited


def test_generators_differ_by_seed_purpose_and_step() -> None:
    draws = [generator(s, p, i).random(4) for s in (0, 1) for p in ("order", "relocation") for i in (0, 1)]
    assert len(np.unique(np.concatenate(draws))) == 4 * len(draws)
    np.testing.assert_array_equal(generator(1, "order", 5).random(4), generator(1, "order", 5).random(4))


def test_no_images_is_an_error() -> None:
    with pytest.raises(ValueError, match="at least one image"):
        ShuffledEpochs(0, seed=0)
