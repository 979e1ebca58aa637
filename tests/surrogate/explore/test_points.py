"""Settings belong to the appearances and variations that their parameters say."""

from __future__ import annotations

import math

import pytest

from surrogate.explore.points import appearances_of, values_of, variation_of
from tests.support.models import following, plain


def test_displacements_that_are_left_out_are_zero() -> None:
    variation, values = variation_of({"c2_value": 0.2}, following().variations)
    assert variation is not None
    assert (variation.kind, values) == ("transfer_function", (0.0, 0.0, 0.2, 0.0))


@pytest.mark.parametrize(
    "visualization", [{"isovalue": math.inf}, {"isovalue": 0.3, "c1_value": 0.0}, {"appearance": "speed"}]
)
def test_what_no_variation_has_is_refused(visualization: dict[str, float | str]) -> None:
    with pytest.raises(ValueError, match=r"must be|no variation"):
        variation_of(visualization, following().variations)


def test_the_base_comes_first_of_the_appearances() -> None:
    names = appearances_of(following())
    assert next(iter(names.items())) == ("dvr", {})
    assert following().base_appearance == "dvr"


def test_no_members_have_no_values() -> None:
    assert values_of(plain().space, []).shape == (0, 1)
