"""Families of transfer functions: the settings that are asked for, in their box."""

from __future__ import annotations

import itertools
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from catalogs.vocabulary.appearance import TransferFunction, VolumeRendering
from catalogs.vocabulary.parameters import SPLITS
from catalogs.vocabulary.variations import (
    POINT_PARAMETERS,
    displaced,
    transfer_function_family,
)
from tests.support.variation_bases import BASE, COLORS, FUNCTION, SCALE, STEPS


def test_the_training_functions_are_the_64_joint_and_the_12_single_displacements() -> None:
    """Written out on its own: both points by {-, 0, +}² without zero, and each coordinate alone by -1, 1/2 and 1 steps."""
    pairs = [(a, b) for a in (-1, 0, 1) for b in (-1, 0, 1) if a or b]
    joint = {(*first, *second) for first in pairs for second in pairs}
    single = {tuple(np.eye(4)[axis] * step) for axis in range(4) for step in (-1, 0.5, 1)}
    assert (len(joint), len(single), len(joint | single)) == (64, 12, 76)
    settings = transfer_function_family(BASE, **STEPS).variation.settings
    trained = [tuple((np.array(s.values) / SCALE).round(6)) for s in settings if s.split == "train"]
    assert len(trained) == 76
    assert set(trained[:64]) == joint
    assert set(trained[64:]) == single
    assert not any(s.values == (0.0,) * 4 for s in settings)


def test_every_setting_is_the_base_with_its_points_moved() -> None:
    family = transfer_function_family(BASE, **STEPS)
    assert [a.name for a in family.appearances] == [s.appearance for s in family.variation.settings]
    for setting, appearance in zip(family.variation.settings, family.appearances, strict=True):
        assert isinstance(appearance, VolumeRendering)
        points = np.array(appearance.transfer_function.opacity_points)
        assert (np.diff(points[:, 0]) > 0).all()
        assert ((points[:, 1] >= 0) & (points[:, 1] <= 1)).all()
        moved = points - np.array(FUNCTION.opacity_points)
        np.testing.assert_allclose(moved[1:3].ravel(), setting.values, atol=1e-12)
        assert not moved[[0, 3]].any()
        assert appearance.transfer_function.color_points == COLORS
    assert family.variation.mismatches((BASE, *family.appearances)) == []


def test_unseen_settings_lie_in_the_box_apart_from_the_trained_ones() -> None:
    variation = transfer_function_family(BASE, **STEPS, validation=30, test=50, unit="m").variation
    assert variation.space.names == POINT_PARAMETERS
    assert [(p.low, p.high, p.unit) for p in variation.space.parameters] == [
        (-0.25, 0.25, "m"),
        (-0.1, 0.1, ""),
        (-0.5, 0.5, "m"),
        (-0.25, 0.25, ""),
    ]
    places = {split: [s.values for s in variation.settings if s.split == split] for split in SPLITS}
    assert {split: len(values) for split, values in places.items()} == {"train": 76, "validation": 30, "test": 50}
    assert len(set(itertools.chain(*places.values()))) == 156
    normalized = np.array([variation.normalize(s.values) for s in variation.settings])
    assert np.abs(normalized).max() == 1.0
    unseen = np.array([variation.normalize(values) for split in ("validation", "test") for values in places[split]])
    assert np.abs(unseen).max() < 1.0
    assert np.abs(unseen.mean(axis=0)).max() < 0.25
    assert np.abs(unseen.std(axis=0) - 1.0 / np.sqrt(3.0)).max() < 0.15


def test_a_seed_draws_the_unseen_settings_and_nothing_else() -> None:
    first, again, other = (transfer_function_family(BASE, **STEPS, seed=seed) for seed in (4, 4, 5))
    assert first == again
    assert first.variation.settings[:76] == other.variation.settings[:76]
    assert not {s.values for s in first.variation.settings[76:]} & {s.values for s in other.variation.settings[76:]}


def test_settings_have_names_that_sort_as_they_stand() -> None:
    variation = transfer_function_family(BASE, **STEPS, validation=2, test=1).variation
    assert variation.named("train")[0] == "dvr-train-01"
    assert variation.named("test", "validation") == ("dvr-validation-01", "dvr-validation-02", "dvr-test-01")
    assert variation.named(*SPLITS) == tuple(s.appearance for s in variation.settings)
    assert variation.setting("dvr-train-76") == variation.settings[75]
    assert variation.setting("dvr") is None


@pytest.mark.parametrize("unit", [1e-12, 1e-5, 1.0, 1e9])
def test_small_units_keep_their_digits(unit: float) -> None:
    """Displacements are rounded for readers, but never to zero: densities may be of the order of 1e-10."""
    points = tuple((value * unit, opacity) for value, opacity in FUNCTION.opacity_points)
    colors = tuple((value * unit, *color) for value, *color in COLORS)
    base = replace(BASE, transfer_function=TransferFunction(colors, points, 0.3))  # type: ignore[arg-type]
    variation = transfer_function_family(base, first_step=(0.25 * unit, 0.1), second_step=(0.5 * unit, 0.25)).variation
    same = transfer_function_family(BASE, **STEPS).variation
    for a, b in zip(variation.settings, same.settings, strict=True):
        np.testing.assert_allclose(variation.normalize(a.values), same.normalize(b.values), rtol=0, atol=1e-6)


BAD_FUNCTIONS: dict[str, tuple[dict[str, Any], str]] = {
    "three points": ({"points": ((-1, 0), (1, 0.5), (3, 1))}, r"dvr.*four opacity points.*\(1\.0, 0\.5\)"),
    "open ends": ({"points": ((-1, 0.1), (0.5, 0.2), (1.5, 0.5), (3, 1))}, r"dvr.*opacity 0 and 1.*0\.1"),
    "no step": ({"first_step": (0.0, 0.1)}, r"first_step.*positive.*0\.0, 0\.1"),
    "backward step": ({"second_step": (0.5, -0.1)}, r"second_step.*positive.*-0\.1"),
    "endless step": ({"second_step": (float("inf"), 0.1)}, r"second_step.*positive.*inf"),
    "no number": ({"second_step": (float("nan"), 0.1)}, r"second_step.*positive.*nan"),
    "three steps": ({"first_step": (0.1, 0.1, 0.1), "second_step": (0.1,)}, r"first_step.*\(value, opacity\) each"),
    "two multiples": ({"single_steps": (-1.0, 1.0)}, r"single_steps must be three.*\(-1\.0, 1\.0\)"),
    "a multiple twice": ({"single_steps": (-1.0, 1.0, 1.0)}, "single_steps must be three different"),
    "a zero multiple": ({"single_steps": (-1.0, 0.0, 1.0)}, "none of them zero"),
    "out of the box": ({"single_steps": (-1.0, 0.5, 2.0)}, r"in \[-1, 1\]"),
    "points cross": ({"first_step": (0.6, 0.1)}, r"dvr-train-\d\d.*'c1_value': 0\.6.*increasing.*smaller steps"),
    "past the end": ({"second_step": (1.6, 0.1)}, r"dvr-train-\d\d.*'c2_value': -?1\.6.*smaller steps"),
    "too opaque": ({"second_step": (0.1, 0.6)}, r"dvr-train-\d\d.*'c2_opacity': -?0\.6.*\[0, 1\].*smaller steps"),
    "negative count": ({"validation": -1}, "validation and test count.*-1"),
}


@pytest.mark.parametrize("case", BAD_FUNCTIONS)
def test_an_impossible_transfer_function_family_is_refused(case: str) -> None:
    changes, message = BAD_FUNCTIONS[case]
    points = changes.get("points", FUNCTION.opacity_points)
    base = replace(BASE, transfer_function=TransferFunction(COLORS, points, 0.3))
    options = {**STEPS, **{name: value for name, value in changes.items() if name != "points"}}
    with pytest.raises(ValueError, match=message):
        transfer_function_family(base, **options)


def test_displaced_refuses_points_that_cross() -> None:
    moved = displaced(FUNCTION, (0.25, -0.1, 0.5, 0.25))
    assert moved.opacity_points == ((-1.0, 0.0), (0.75, 0.1), (2.0, 0.75), (3.0, 1.0))
    assert displaced(FUNCTION, (0.0,) * 4) == FUNCTION
    for crossing in ((1.0, 0, 0, 0), (0.6, 0, -0.6, 0), (-1.5, 0, 0, 0), (0, 0, 1.5, 0)):
        with pytest.raises(ValueError, match="strictly increasing"):
            displaced(FUNCTION, crossing)
    for opacity in ((0, -0.3, 0, 0), (0, 0, 0, 0.6)):
        with pytest.raises(ValueError, match=r"\[0, 1\]"):
            displaced(FUNCTION, opacity)


def test_displacements_are_normalized_to_steps() -> None:
    variation = transfer_function_family(BASE, **STEPS).variation
    assert variation.normalize(None).tolist() == [0.0] * 4
    assert variation.normalize((0.25, -0.1, 0.25, 0.5)) == pytest.approx([1.0, -1.0, 0.5, 2.0])
