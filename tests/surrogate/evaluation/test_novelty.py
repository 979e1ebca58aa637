"""The novelty of a transfer function, against integrals worked out by hand."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from catalogs.store.summary import FieldSummary
from catalogs.vocabulary.appearance import TransferFunction
from surrogate.evaluation.novelty import MAGNIFIED, SeenValues, extinctions, trained_functions
from tests.support.field_blobs import BLOBS, FUNCTION, FUNCTIONS, appearance_of, field_catalog
from tests.support.models import following, plain

GREY = ((0.0, 0.5, 0.5, 0.5), (4.0, 0.5, 0.5, 0.5))


def steps(*opacities: float, unit: float = 1.0) -> TransferFunction:
    """Of opacity `opacities[i]` from i to i + 1."""
    points = [(i + end, a) for i, a in enumerate(opacities) for end in (1e-9, 1.0 - 1e-9)]
    return TransferFunction(GREY, tuple(points), unit)


def member(*counts: int, low: float = 0.0, high: float = 4.0, clipped: float = 0.0) -> FieldSummary:
    """A field with the given counts of samples from 0 to 1, from 1 to 2, and further."""
    nothing = np.zeros((0, 3)), np.zeros(0), np.zeros(0, np.float32)
    return FieldSummary(low, high, clipped, np.array(counts), np.arange(len(counts) + 1.0), *nothing)


def depth(opacity: float) -> float:
    return -np.log(1.0 - opacity)


TRAINED = steps(0.0, 0.2, 0.5, 0.0)
EVEN = [member(1, 1, 1, 1)]


@pytest.mark.parametrize(
    ("asked", "members", "expected"),
    [
        pytest.param(TRAINED, EVEN, 0.0, id="itself"),
        pytest.param(steps(0.0, 0.1, 0.25, 0.0), EVEN, 0.0, id="thinner"),
        pytest.param(steps(0.0, 0.36, 0.75, 0.0), EVEN, 0.0, id="twice as dense"),
        pytest.param(steps(0.3, 0.0, 0.0, 0.0), EVEN, 1.0, id="only what was transparent"),
        pytest.param(steps(0.3, 0.0, 0.3, 0.0), EVEN, 0.5, id="half of it"),
        pytest.param(steps(0.3, 0.0, 0.3, 0.0), [member(3, 0, 1, 0)], 0.75, id="more of it in the field"),
        pytest.param(steps(0.3, 0.0, 0.3, 0.0), [member(0, 2, 2, 0)], 0.0, id="a field without it"),
        pytest.param(
            steps(0.3, 0.0, 0.3, 0.0), [member(3, 0, 1, 0), member(0, 0, 4, 0)], 0.375, id="mean over members"
        ),
        pytest.param(
            steps(0.0, 0.9, 0.0, 0.0), EVEN, 1.0 - MAGNIFIED * depth(0.2) / depth(0.9), id="far denser than it was"
        ),
        pytest.param(steps(0.0, 0.0, 0.0, 0.0), EVEN, 0.0, id="nothing at all"),
        pytest.param(
            steps(0.3, 0.0, 0.0, 0.0), [member(0, 0, 0, 0)], 0.0, id="a field beyond the histogram, shown to no one"
        ),
        pytest.param(
            steps(0.0, 0.0, 0.0, 0.4),
            [member(1, 1, 1, 0, high=9.0, clipped=0.4)],
            1.0,
            id="values beyond the histogram",
        ),
        pytest.param(steps(0.0, 0.0, 0.4, 0.0), [member(0, 0, 7, 0, low=2.5, high=2.5)], 0.0, id="a constant field"),
    ],
)
def test_new_is_what_no_trained_function_showed(asked: TransferFunction, members, expected: float) -> None:
    seen = SeenValues.of(members, [TRAINED])
    assert seen is not None
    assert seen.novelty(asked) == pytest.approx(expected, abs=1e-6)


def test_of_several_trained_functions_any_may_have_shown_a_value() -> None:
    seen = SeenValues.of(EVEN, [TRAINED, steps(0.3, 0.0, 0.0, 0.0)])
    assert seen is not None
    assert seen.novelty(steps(0.3, 0.3, 0.3, 0.0)) == pytest.approx(0.0, abs=1e-6)
    assert seen.novelty(steps(0.3, 0.3, 0.3, 0.3)) == pytest.approx(0.25, abs=1e-6)


def test_extinctions_are_per_world_unit() -> None:
    edges = np.arange(5.0)
    np.testing.assert_allclose(
        extinctions(steps(0.0, 0.2, 0.5, 0.0, unit=0.5), edges), [0, 2 * depth(0.2), 2 * depth(0.5), 0]
    )
    opaque = replace(TRAINED, opacity_points=((0.0, 1.0), (4.0, 1.0)))
    assert np.isfinite(extinctions(opaque, edges)).all()


def test_quantiles_are_of_what_is_visible() -> None:
    seen = SeenValues.of(EVEN, [TRAINED])
    assert seen is not None
    both = steps(0.0, 0.4, 0.4, 0.0)
    assert [seen.quantile(both, share) for share in (0.25, 0.5, 0.75)] == pytest.approx([1.5, 2.0, 2.5])
    with pytest.raises(ValueError, match="shows nothing of these members"):
        seen.quantile(steps(0.0, 0.0, 0.0, 0.0), 0.5)


def test_without_members_or_functions_nothing_is_known() -> None:
    assert SeenValues.of([], [TRAINED]) is None
    assert SeenValues.of(EVEN, []) is None


@pytest.mark.slow
def test_training_showed_its_own_functions_and_the_members_that_it_learnt_from(tmp_path: Path) -> None:
    catalog = field_catalog(tmp_path / "a.cdb", summaries=True)
    functions, field = trained_functions(catalog, following())
    trained = [setting for setting in FUNCTIONS.settings if setting.split == "train"]
    assert functions == [FUNCTION, *(appearance_of(setting).transfer_function for setting in trained)]
    assert field == ""
    assert trained_functions(catalog, plain())[0] == [FUNCTION]
    assert trained_functions(catalog, replace(plain(), training={"appearance": "unrelated"})) == ([], "")
    seen, alone = (SeenValues.of_training(catalog, surrogate) for surrogate in (following(), plain()))
    assert seen is not None
    assert alone is not None
    assert seen.frequency.sum() == pytest.approx(1.0)
    everywhere = replace(FUNCTION, opacity_points=((0.0, 0.5), (3.0, 0.5)))
    assert 0.0 <= seen.novelty(everywhere) <= alone.novelty(everywhere) <= 1.0
    share = np.mean([BLOBS.values < seen.quantile(everywhere, 0.5)])
    assert share == pytest.approx(0.5, abs=0.5 / len(BLOBS.values) + 0.05)
    assert SeenValues.of_training(field_catalog(tmp_path / "b.cdb"), plain()) is None  # without summaries
