"""Errors of emulated numbers are those of fields that are known."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from surrogate.emulation import EmulatedField, EmulatedFields, FieldEmulator
from surrogate.emulation.measures import NUMBERS, SHARE
from surrogate.evaluation.numbers import NORMAL, VALUES, number_errors, numbers_of
from tests.support.ensembles_of_fields import ORIGIN, SPACING, smooth, some_points
from tests.support.field_catalogs import TESTED, rendered

OFF = 0.25


def predicted() -> EmulatedField:
    points = some_points(8)
    return FieldEmulator.fit(points, smooth(points), SPACING, ORIGIN).at([0.2, 0.1])


def known(field: EmulatedField, off: float = 0.0) -> EmulatedField:
    return replace(field, values=field.values - np.float32(off), posterior=None)


def test_errors_are_differences_over_the_spread() -> None:
    field = predicted()
    errors = number_errors([(field, known(field)), (field, known(field, OFF))], 2.0, 10.5)
    assert set(errors) == {VALUES, *NUMBERS}
    for name in (VALUES, "minimum", "maximum", "mean"):
        assert errors[name].error == pytest.approx(OFF / 2.0, rel=1e-4), name
        assert errors[name].relative == pytest.approx(OFF / 4.0, rel=1e-4)
        assert errors[name].members == 2
        assert errors[name].inside == pytest.approx(0.5)  # the error of the second is many deviations
    true = float((field.values - np.float32(OFF) > 10.5).mean())
    assert errors[SHARE].error == pytest.approx(abs(float((field.values > 10.5).mean()) - true) / 2.0)
    assert errors[SHARE].relative is None


def test_intervals_hold_what_their_deviations_say() -> None:
    field = predicted()
    random, deviations = np.random.default_rng(0), np.asarray(field.deviations)

    def pairs() -> Iterator[tuple[EmulatedField, EmulatedField]]:
        for _ in range(20):  # rough errors, which interpolation makes smaller
            noise = NORMAL * deviations * np.where(random.random(deviations.shape) < 0.9, 0.9, 3.0)
            yield field, replace(field, values=field.values + noise.astype(np.float32), posterior=None)

    assert 0.4 < number_errors(pairs(), 1.0, 0.0)[VALUES].inside < 0.9
    assert number_errors([(field, known(field))], 0.0, 0.0)[VALUES].relative is None


def test_holes_are_left_out() -> None:
    field = predicted()
    holes = np.zeros(field.values.shape, bool)
    holes[:4] = True
    truth = replace(known(field, OFF), holes=holes)
    assert number_errors([(field, truth)], 1.0, 0.0)[VALUES].error == pytest.approx(OFF, rel=1e-4)


def test_test_members_judge(tmp_path: Path) -> None:
    catalog = rendered(tmp_path / "a.cdb", surface=False)
    told: list[tuple[int, int]] = []
    [numbers] = numbers_of(EmulatedFields.fit(catalog), catalog.members, lambda *counts: told.append(counts))
    assert {error.members for error in numbers.errors.values()} == {len(TESTED)}
    assert numbers.errors[VALUES].relative is not None
    assert numbers.errors[VALUES].relative < 0.01
    assert told == [(0, 1)]
    bare = rendered(tmp_path / "b.cdb", surface=False, coarse_field=False)
    assert numbers_of(EmulatedFields.fit(catalog), bare.members) == []
