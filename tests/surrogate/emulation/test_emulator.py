"""Emulators predict fields at parameters of no member, say how well, and are stored."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from surrogate.appearance.scale import ValueScale
from surrogate.emulation import FieldEmulator
from tests.support.ensembles_of_fields import ORIGIN, SHAPE, SPACING, places, smooth, some_points

UNSEEN = some_points(12, seed=5)
Fields = np.ndarray


def emulated(
    count: int = 30, fields: Callable[[Fields], Fields] = smooth, scale: ValueScale | None = None
) -> FieldEmulator:
    points = some_points(count)
    return FieldEmulator.fit(points, fields(points), SPACING, ORIGIN, scale)


def steps(points: Fields) -> Fields:
    """Fields that jump with the first parameter."""
    return np.where(points[:, 0, None, None, None] > 0.0, smooth(points), smooth(-points)).astype(np.float32)


def test_fields_of_unseen_parameters_are_predicted() -> None:
    emulator = emulated()
    truth = smooth(UNSEEN)
    errors = [np.sqrt(((emulator.at(p).values - t) ** 2).mean()) for p, t in zip(UNSEEN, truth, strict=True)]
    assert np.mean(errors) < 0.02 * truth.std()
    assert emulator.relative_error < 0.05
    assert emulator.at(UNSEEN[0]).values.dtype == np.float32


def test_intervals_hold_for_unseen_parameters() -> None:
    emulator, truth = emulated(20, steps), steps(some_points(40, seed=6))
    inside = []
    for point, field in zip(some_points(40, seed=6), truth, strict=True):
        found = emulator.at(point)
        inside.append(np.abs(found.values - field) <= 1.645 * found.deviations)
    assert 0.8 < np.mean(inside) < 0.98


@pytest.mark.parametrize("scaled", [False, True])
def test_samples_are_those_of_the_field(scaled: bool) -> None:
    scale = ValueScale(np.array([8.0, 9.9, 10.0, 12.0])) if scaled else None
    emulator = emulated(scale=scale)
    if scaled:
        object.__setattr__(emulator, "scale", scale)  # whichever was chosen
    field = emulator.at(UNSEEN[0])
    values, deviations = emulator.sample(UNSEEN[0], places().reshape(-1, 3))
    np.testing.assert_allclose(values, field.values.ravel(), rtol=1e-5)
    np.testing.assert_allclose(deviations, field.deviations.ravel(), rtol=1e-3, atol=1e-6)  # type: ignore[union-attr]
    halfway, _ = emulator.sample(UNSEEN[0], [places()[2, 3, 4] + np.array(SPACING) / 2.0])
    np.testing.assert_allclose(halfway, field.values[2:4, 3:5, 4:6].mean(), rtol=1e-5)
    outside, spread = emulator.sample(UNSEEN[0], [[100.0, 0.0, 0.0]])
    assert np.isnan(outside).all()
    assert np.isnan(spread).all()


@pytest.mark.parametrize("scale", [None, ValueScale(np.array([-50.0, 0.0, 60.0]))])
def test_derivatives_are_those_of_finite_differences(scale: ValueScale | None) -> None:
    emulator = emulated()
    object.__setattr__(emulator, "scale", scale)
    point, step = np.array([0.3, -0.2]), 2e-2
    numeric = [(emulator.at(point + s).values - emulator.at(point - s).values) / (2 * step) for s in step * np.eye(2)]
    found = emulator.derivative(point)
    assert found.shape == (2, *SHAPE)
    np.testing.assert_allclose(found, numeric, rtol=0, atol=2e-3 * np.abs(found).max())


def test_a_scale_is_modelled_where_it_predicts_better() -> None:
    def powers(points: Fields) -> Fields:
        return np.exp(3.0 * (smooth(points) - 10.0) + 4.0 * points[:, 0, None, None, None]).astype(np.float32)

    knots = np.geomspace(powers(some_points(40)).min(), powers(some_points(40)).max(), 40)
    assert emulated(fields=powers, scale=ValueScale(knots)).scale is not None
    assert emulated(scale=ValueScale(np.array([8.0, 12.0]))).scale is None


def test_an_emulator_that_is_read_again_is_the_same(tmp_path: Path) -> None:
    def with_holes(points: Fields) -> Fields:
        fields = smooth(points)
        fields[:, :, 2, 3] = np.nan
        for member, point in zip(fields, points, strict=True):
            member[places()[..., 0] > 0.2 * point[0]] = np.nan
        return fields

    for emulator in (emulated(), emulated(fields=with_holes)):
        emulator.save(tmp_path / "first")
        loaded = FieldEmulator.load(tmp_path / "first")
        loaded.save(tmp_path / "again")
        for name in ("model.safetensors", "model.json"):
            assert (tmp_path / "first" / name).read_bytes() == (tmp_path / "again" / name).read_bytes()
        expected, found = emulator.at(UNSEEN[1]), loaded.at(UNSEEN[1])
        np.testing.assert_array_equal(found.values, expected.values)
        np.testing.assert_array_equal(found.deviations, expected.deviations)
        np.testing.assert_array_equal(found.holes, expected.holes)
        assert loaded.megabytes == emulator.megabytes


@pytest.mark.parametrize(
    ("change", "complaint"),
    [
        (lambda record: record.update(schema=99), "its schema is 99"),
        (lambda record: record.pop("shape"), "'shape' is missing"),
        (lambda record: record.update(shape=[8, 10, 13]), "mean must have the shape"),
        (lambda record: record.update(shape=[2**40, 10, 12]), "mean must have the shape"),
        (lambda record: record.update(shape=[8, 10, "12"]), "three whole numbers"),
        (lambda record: record.update(spacing=[0.0, 1.0, 1.0]), "spacing"),
        (lambda record: record["groups"].append(0), "groups"),
        (lambda record: record.update(groups=[99] * len(record["groups"])), "groups must be whole numbers below"),
        (lambda record: record.update(factor=float("nan")), "factor"),
        (lambda record: record.update(scale=[1.0, 0.0]), "increasing"),
        (lambda record: record.update(outline={}), "is missing"),
        (lambda record: record["tensors"].update(sha256="0"), "does not belong to the record"),
        (lambda record: record["encodings"].update(mean="pickle"), "a tensor in 'pickle'"),
    ],
)
def test_damage_is_named(tmp_path: Path, change: Callable[[dict[str, object]], object], complaint: str) -> None:
    emulated(10).save(tmp_path)
    record = json.loads((tmp_path / "model.json").read_text())
    change(record)
    (tmp_path / "model.json").write_text(json.dumps(record))
    with pytest.raises(ValueError, match=complaint):
        FieldEmulator.load(tmp_path)
