"""Settings lie where their parameters say, as fractions of ranges, and only alike appearances are compared."""

from __future__ import annotations

import math
import warnings

import numpy as np
import pytest

from surrogate.explore.reliability.points import ISOSURFACES, base_name, fractions_of, point_of, variation_of
from surrogate.explore.setting import Setting
from tests.support.field_blobs import STEPS
from tests.support.models import following, plain


def test_a_whole_range_is_one() -> None:
    low, high = (point_of(Setting({"p": p}), plain()).values for p in (0.0, 1.0))
    np.testing.assert_allclose(high - low, [1.0])


def test_the_base_and_transfer_functions_are_one_family() -> None:
    at_base = point_of(Setting({"p": 0.5}), following())
    moved = point_of(Setting({"p": 0.5}, {"c1_value": STEPS[0]}), following())
    assert at_base.family == moved.family == base_name(following()) == "dvr"
    np.testing.assert_allclose(moved.values - at_base.values, [0, 0.5, 0, 0, 0])  # from the middle to the upper bound


def test_isosurfaces_are_another_family_and_trained_ones_lie_evenly() -> None:
    values = [0.1, 0.3, 0.55, 0.8]  # as trained
    places = [point_of(Setting({"p": 0.5}, {"isovalue": v}), following()) for v in values]
    assert {place.family for place in places} == {ISOSURFACES}
    np.testing.assert_allclose(np.diff([place.values[1] for place in places]), 1 / 3)


@pytest.mark.parametrize(
    ("setting", "outside"),
    [
        (Setting({"p": 1.0}), ()),
        (Setting({"p": 1.1}), ("p",)),
        (Setting({"p": -0.1}, {"isovalue": 0.9}), ("p", "isovalue")),
        (Setting({"p": 0.5}, {"c2_opacity": 0.31}), ("c2_opacity",)),
    ],
)
def test_what_is_out_of_bounds_is_named_without_a_warning(setting: Setting, outside: tuple[str, ...]) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert point_of(setting, following()).outside == outside


@pytest.mark.parametrize(
    "setting",
    [
        Setting({}),
        Setting({"p": 0.5, "q": 1.0}),
        Setting({"p": math.nan}),
        Setting({"p": 0.5}, {"isovalue": math.inf}),
        Setting({"p": 0.5}, {"isovalue": 0.3, "c1_value": 0.0}),
        Setting({"p": 0.5}, {"appearance": "speed"}),
    ],
)
def test_what_can_not_be_shown_has_no_place(setting: Setting) -> None:
    with pytest.raises(ValueError, match=r"must be|no variation"):
        point_of(setting, following())


def test_displacements_that_are_left_out_are_zero() -> None:
    variation, values = variation_of({"c2_value": 0.2}, [v.variation for v in following().visualizations])
    assert variation is not None
    assert (variation.kind, values) == ("transfer_function", (0.0, 0.0, 0.2, 0.0))


def test_no_members_have_no_fractions() -> None:
    assert fractions_of(plain().space, []).shape == (0, 1)
