"""Small, strange and damaged ensembles: emulated as well as can be, or refused in one sentence."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from surrogate.emulation import FieldEmulator
from tests.support.ensembles_of_fields import ORIGIN, SPACING, places, smooth, some_points

Ensemble = tuple[np.ndarray, np.ndarray]  # points [M, P], fields [M, Z, Y, X]


def of(points: np.ndarray) -> Ensemble:
    return points, smooth(points)


def twice() -> Ensemble:
    points = some_points(8)
    return of(np.concatenate([points, points]))


def still() -> Ensemble:
    points = some_points(20)
    points[:, 1] = 0.4
    return of(points)


def jumping() -> Ensemble:
    points = some_points(20)
    return points, np.where(points[:, 0, None, None, None] > 0, smooth(points), 3.0).astype(np.float32)


def with_solid() -> Ensemble:
    points, fields = of(some_points(20))
    fields[:, 2:5, 3:6] = np.nan
    return points, fields


def constant() -> Ensemble:
    points = some_points(6)
    return points, np.full((6, 3, 4, 5), 7.0, np.float32)


def flat() -> Ensemble:
    points, fields = of(some_points(20))
    return points, fields[:, :1]


def without_parameters() -> Ensemble:
    return np.zeros((4, 0)), smooth(some_points(4))


def huge() -> Ensemble:
    points, fields = of(some_points(10))
    return points, fields * np.float32(1e30)


HARD: dict[str, Callable[[], Ensemble]] = {
    "three members": lambda: of(some_points(3)),
    "ten members, six parameters": lambda: of(some_points(10, 6)),
    "one parameter": lambda: of(some_points(8, 1)),
    "duplicates": twice,
    "all at one point": lambda: (np.zeros((5, 2)), smooth(some_points(5))),
    "a parameter that never varies": still,
    "discontinuous": jumping,
    "the same holes": with_solid,
    "constant": constant,
    "one layer": flat,
    "no parameters": without_parameters,
    "huge values": huge,
}


@pytest.mark.parametrize("name", HARD)
def test_hard_ensembles_are_emulated(name: str) -> None:
    points, fields = HARD[name]()
    emulator = FieldEmulator.fit(points, fields, SPACING, ORIGIN)
    fields = fields.astype(np.float64)
    predictions = [emulator.at(point) for point in points[:4]]
    spread = np.nanstd(fields)
    mean = np.nan_to_num(fields).mean(0)
    for found, truth in zip(predictions, fields, strict=False):
        assert np.isfinite(found.values).all()
        assert found.deviations is not None
        assert np.isfinite(found.deviations).all()
        seen = ~np.isnan(truth)
        assert (found.holes is None) == seen.all()
        off = np.abs(found.values - truth)[seen].max()
        assert off <= np.abs(mean - truth)[seen].max() + 0.05 * spread + 1e-6 * np.abs(truth[seen]).max()
    far = emulator.at(np.full(points.shape[1], 3.0))
    assert np.isfinite(far.values).all()
    assert np.isfinite(emulator.derivative(points[0])).all()
    assert np.isfinite(emulator.errors).all()
    assert np.isfinite(emulator.factor)


def test_a_constant_field_is_certain() -> None:
    points, fields = constant()
    found = FieldEmulator.fit(points, fields, SPACING, ORIGIN).at(points[0])
    np.testing.assert_array_equal(found.values, fields[0])
    np.testing.assert_array_equal(found.deviations, 0.0)


def test_holes_that_move_are_predicted() -> None:
    def ensemble(points: np.ndarray) -> np.ndarray:
        fields = smooth(points)
        for member, point in zip(fields, points, strict=True):
            center = np.array(ORIGIN) + np.array(SPACING) * (5.5, 4.5, 3.5) + 0.3 * np.array([point[0], point[1], 0.0])
            member[((places() - center) ** 2).sum(-1) < 0.5**2] = np.nan
        return fields

    points, unseen = some_points(30), some_points(6, seed=3)
    emulator = FieldEmulator.fit(points, ensemble(points), SPACING, ORIGIN)
    for point, truth in zip(unseen, ensemble(unseen), strict=True):
        found = emulator.at(point)
        assert found.holes is not None
        wrong = found.holes != np.isnan(truth)
        assert wrong.sum() <= 0.2 * np.isnan(truth).sum()
        center = np.array(ORIGIN) + np.array(SPACING) * (5.5, 4.5, 3.5) + 0.3 * np.array([point[0], point[1], 0.0])
        assert np.isnan(emulator.sample(point, [center])).all()


def changed(fields: np.ndarray, value: float) -> np.ndarray:
    fields[1, 0, 0, 0] = value
    return fields


@pytest.mark.parametrize(
    ("points", "fields", "complaint"),
    [
        (some_points(2), smooth(some_points(2)), "needs 3 members or more to learn from, got 2"),
        (some_points(5), smooth(some_points(4)), "one row for each of the 4 fields"),
        (some_points(4) * np.nan, smooth(some_points(4)), "points must be finite"),
        (some_points(4), smooth(some_points(4))[:, 0], r"fields must be an array \[member, z, y, x\]"),
        (some_points(4), changed(smooth(some_points(4)), np.inf), "member 1 has infinite values"),
        (
            some_points(4),
            changed(smooth(some_points(4)), 0.0) * [[[[1]]], [[[1]]], [[[np.nan]]], [[[1]]]],
            "member 2 has no",
        ),
    ],
)
def test_what_is_no_ensemble_is_refused(points: np.ndarray, fields: np.ndarray, complaint: str) -> None:
    with pytest.raises(ValueError, match=complaint):
        FieldEmulator.fit(points, fields, SPACING, ORIGIN)


@pytest.mark.parametrize("point", [[0.0], [0.0, np.nan], [[0.0, 0.0]], "ab"])
def test_what_is_no_point_is_refused(point: object) -> None:
    emulator = FieldEmulator.fit(some_points(4), smooth(some_points(4)), SPACING, ORIGIN)
    with pytest.raises(ValueError, match="a point must be 2 finite numbers"):
        emulator.at(point)  # type: ignore[arg-type]
