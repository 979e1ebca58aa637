import numpy as np
import pytest

from surrogate.randomness import generator
from surrogate.training.sampling import HARD_BLOCK, HardExamples, ShuffledEpochs


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


def told(errors: list[float], power: float = 1.0, seed: int = 1) -> HardExamples:
    """Hard examples whose running errors are known; NaN for images that were never seen."""
    hard = HardExamples(len(errors), seed, power)
    for item, error in enumerate(errors):
        if not np.isnan(error):
            hard.tell(item, error)
    return hard


def visits(hard: HardExamples, blocks: int = 40) -> np.ndarray:
    """The fraction of visits to each image, at constant errors."""
    drawn = [hard[step] for step in range(blocks * HARD_BLOCK)]
    return np.bincount(drawn, minlength=len(hard.errors)) / len(drawn)


@pytest.mark.parametrize("power", [0.5, 1.0, 2.0])
def test_images_are_visited_in_proportion_to_a_power_of_their_errors(power: float) -> None:
    errors = [0.1, 0.2, 0.4, 0.3, 0.15]
    expected = np.array(errors) ** power
    np.testing.assert_allclose(visits(told(errors, power)), expected / expected.sum(), atol=0.01)


def test_an_image_that_was_never_seen_counts_as_the_worst() -> None:
    np.testing.assert_allclose(visits(told([0.1, np.nan, 0.3, np.nan])), np.array([1, 3, 3, 3]) / 10, atol=0.01)


def test_at_first_all_are_visited_alike() -> None:
    np.testing.assert_allclose(visits(told([np.nan] * 7)), 1 / 7, atol=0.01)
    assert sorted(visits(told([np.nan] * 100), blocks=1)) == [0.01] * 100


@pytest.mark.parametrize(
    "errors",
    [[0.0, 0.0, 0.0], [-1e-8, 0.0, 0.0], [-1e-8, -1e-7, -1e-8], [0.0, 0.0, np.nan], [1e-300] * 3, [1e300] * 3],
    ids=str,
)
@pytest.mark.parametrize("power", [0.5, 3.0])
def test_perfect_images_do_not_stop_anything(errors: list[float], power: float) -> None:
    """Rounding may even make a loss negative."""
    found = visits(told(errors, power))
    assert (found > 0.02).all()
    if np.ptp(np.nan_to_num(errors)) < 1e-6 and not np.isnan(errors).any():
        np.testing.assert_allclose(found, 1 / 3, atol=0.01)


@pytest.mark.parametrize("power", [1.0, 4.0])
def test_no_image_is_ever_forgotten(power: float) -> None:
    found = visits(told([0.0, 1e-9, 0.5, 0.5], power))
    assert (found[:2] > 0.015).all()
    assert (found[2:] > 0.4).all()


def test_every_image_of_many_is_seen_in_the_end() -> None:
    hard = HardExamples(700, 3, 1.0)
    seen = set()
    for step in range(8000):
        item = hard[step]
        seen.add(item)
        hard.tell(item, 1.0 if item < 20 else 0.01)
    assert len(seen) == 700


def test_what_has_become_easy_is_visited_less() -> None:
    hard = told([1.0, 1.0])
    for _ in range(6):
        hard.tell(0, 0.2)
    assert hard.errors[0] == pytest.approx(0.2 + 0.8 / 2**6)
    assert visits(hard)[0] < 0.2


def test_hard_examples_go_on_as_they_would_have() -> None:
    def walk(hard: HardExamples, start: int, end: int) -> list[int]:
        visited = []
        for step in range(start, end):
            visited.append(hard[step])
            hard.tell(visited[-1], 0.1 + (visited[-1] * 7 % 5))
        return visited

    whole = walk(HardExamples(30, 5, 1.0), 0, 450)
    for stop in (1, 99, 100, 101, 250, 300):
        first = HardExamples(30, 5, 1.0)
        before = walk(first, 0, stop)
        second = HardExamples(30, 5, 1.0)
        for name, tensor in second.tensors().items():
            tensor.copy_(first.tensors()[name])
        assert before + walk(second, stop, 450) == whole
    assert walk(HardExamples(30, 6, 1.0), 0, 450) != whole


@pytest.mark.parametrize(("count", "power"), [(0, 1.0), (3, 0.0), (3, -1.0), (3, float("nan"))])
def test_hard_examples_need_images_and_a_power(count: int, power: float) -> None:
    with pytest.raises(ValueError, match="need images and a positive power"):
        HardExamples(count, 0, power)
