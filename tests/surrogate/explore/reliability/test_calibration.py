"""Measurements are levelled to unseen members, and their error comes from leaving members and settings out."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from surrogate.explore.reliability.calibration import families_of
from surrogate.explore.setting import Setting
from tests.support.measured import expected, measured
from tests.support.models import following, plain


def test_training_members_are_levelled_to_validation_members() -> None:
    training = [measured("train", p, 40.0 + 10.0 * p) for p in np.linspace(0.0, 1.0, 41)]
    unseen = [measured("validation", p, 37.0 + 10.0 * p) for p in (0.3, 0.7)]
    (family,) = families_of([*training, *unseen], plain()).values()
    assert family.gap == pytest.approx(3.0, abs=0.2)
    for p in (0.1, 0.5, 0.9):
        found = expected([*training, *unseen]).at(Setting({"p": p}), plain()).psnr
        assert found == pytest.approx(37.0 + 10.0 * p, abs=0.3)


def test_without_validation_members_there_is_no_gap() -> None:
    (family,) = families_of([measured("train", p, 40.0) for p in (0.0, 1.0)], plain()).values()
    assert family.gap is None
    assert expected([measured("train", 0.0, 40.0)]).at(Setting({"p": 0.0}), plain()).psnr == 40.0


def test_the_gap_of_the_base_serves_families_that_have_none() -> None:
    surfaces = [replace(measured("train", p, 30.0, varied={"isovalue": 0.3}), appearance="iso=0.3") for p in (0.0, 1.0)]
    rows = [*(measured("train", p, 44.0) for p in (0.0, 0.5, 1.0)), measured("validation", 0.5, 40.0), *surfaces]
    assert expected(rows, following()).at(Setting({"p": 0.0}, {"isovalue": 0.3}), following()).psnr == pytest.approx(
        26.0
    )


def test_what_is_left_out_is_told_from_other_members_and_settings_only() -> None:
    rows = [measured("validation", p, psnr) for p, psnr in ((0.0, 30.0), (1.0, 40.0))]
    (family,) = families_of(rows, plain()).values()
    np.testing.assert_array_equal(family.left_out, [40.0, 30.0])
    assert family.error == 10.0
    same = [
        replace(measured("validation", p, 30.0, varied={"isovalue": 0.4}), appearance="iso=0.4") for p in (0.0, 1.0)
    ]
    (family,) = families_of(same, following()).values()
    assert np.isnan(family.left_out).all()
    assert family.error is None


def test_the_error_is_that_of_unseen_members_where_it_is_larger() -> None:
    training = [measured("train", p, 40.0) for p in np.linspace(0.0, 1.0, 41)]
    unseen = [measured("validation", p, psnr) for p, psnr in ((0.2, 30.0), (0.5, 35.0), (0.8, 40.0))]
    (family,) = families_of([*training, *unseen], plain()).values()
    assert family.error == pytest.approx(np.mean([7.5, 0.0, 7.5]))
