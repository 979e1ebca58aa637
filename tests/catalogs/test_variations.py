"""Families of appearances: the settings that are asked for, in their box, with the right coordinates for a network."""

from __future__ import annotations

import itertools
import json
import re
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from catalogs.appearance import Isosurface, TransferFunction, VolumeRendering
from catalogs.parameters import SPLITS, Parameter, ParameterSpace
from catalogs.variations import (
    POINT_PARAMETERS,
    Setting,
    Variation,
    displaced,
    field_variation,
    isovalue_family,
    transfer_function_family,
    variation_from_json,
    variation_kind,
)

COLORS = ((-1.0, 0.0, 0.0, 1.0), (3.0, 1.0, 0.0, 0.0))
FUNCTION = TransferFunction(COLORS, ((-1.0, 0.0), (0.5, 0.2), (1.5, 0.5), (3.0, 1.0)), 0.3)
BASE = VolumeRendering("dvr", FUNCTION)
STEPS: dict[str, Any] = {"first_step": (0.25, 0.1), "second_step": (0.5, 0.25)}
SCALE = np.array([0.25, 0.1, 0.5, 0.25])
ISOVALUES = (2.0, 4.0, 8.0, 16.0)


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


def test_isosurfaces_stand_at_their_values() -> None:
    style = {"color": [1.0, 0.5, 0.0], "specular": 0.0}
    family = isovalue_family("dvr", train=(8, 2, 4), validation=(3,), test=(5.5, 7), style=style, unit="1/s²")
    assert family.variation.named("train") == ("iso=8", "iso=2", "iso=4")
    assert [(s.values, s.split) for s in family.variation.settings[3:]] == [
        ((3.0,), "validation"),
        ((5.5,), "test"),
        ((7.0,), "test"),
    ]
    assert family.variation.space.parameters == (Parameter("isovalue", 2.0, 8.0, "1/s²"),)
    assert family.appearances[4] == Isosurface("iso=5.5", 5.5, (1.0, 0.5, 0.0), specular=0.0)
    assert family.variation.mismatches((BASE, *family.appearances)) == []


def test_close_isovalues_have_names_of_their_own() -> None:
    values = (1e6 + 1, 1e6 + 2, -1e-7, 0.1, 1 / 3)
    names = isovalue_family("dvr", train=values).variation.named("train")
    assert names == ("iso=1000001.0", "iso=1000002.0", "iso=-1e-07", "iso=0.1", "iso=0.3333333333333333")


BAD_ISOVALUES: dict[str, tuple[dict[str, Any], str]] = {
    "none": ({"train": ()}, r"at least two be trained, got \[\]"),
    "one": ({"train": (1.0,)}, r"at least two be trained, got \[1\.0\]"),
    "one twice": ({"train": (1.0, 2.0, 2.0)}, r"must differ.*2\.0, 2\.0"),
    "tested and trained": ({"train": (1.0, 2.0, 3.0), "test": (2.0,)}, "must differ"),
    "beyond": ({"train": (1.0, 2.0), "test": (2.5,)}, r"within the trained ones, 1 to 2.*2\.5"),
    "no number": ({"train": (1.0, float("nan"), 2.0)}, "nan"),
    "unknown style": ({"train": (1.0, 2.0), "style": {"colour": (1, 0, 0)}}, "colour"),
    "style of one": ({"train": (1.0, 2.0), "style": {"isovalue": 3.0}}, r"style.*not \['isovalue'\]"),
}


@pytest.mark.parametrize("case", BAD_ISOVALUES)
def test_an_impossible_isovalue_family_is_refused(case: str) -> None:
    options, message = BAD_ISOVALUES[case]
    with pytest.raises(ValueError, match=message):
        isovalue_family("dvr", **options)


def test_trained_isovalues_are_normalized_to_equal_distances() -> None:
    variation = isovalue_family("dvr", train=(8.0, 2.0, 16.0, 4.0), test=(3.0,)).variation
    found = [float(variation.normalize((value,))[0]) for value in ISOVALUES]
    assert found == pytest.approx([-1.0, -1.0 / 3.0, 1.0 / 3.0, 1.0])
    assert variation.normalize((3.0,)) == pytest.approx([-2.0 / 3.0])
    below, above = variation.normalize((1.0,)), variation.normalize((24.0,))
    assert below == pytest.approx([-1.0 - 1.0 / 3.0]), "the slope of the first interval goes on"
    assert above == pytest.approx([1.0 + 2.0 / 3.0]), "the slope of the last interval goes on"
    assert np.isnan(variation.normalize(None)).tolist() == [True]


@given(st.lists(st.floats(-1e3, 1e3), min_size=2, max_size=2, unique=True))
def test_normalized_isovalues_are_in_their_order(values: list[float]) -> None:
    low, high = sorted(values)
    variation = isovalue_family("dvr", train=ISOVALUES).variation
    if high - low > 1e-9:
        assert variation.normalize((low,))[0] < variation.normalize((high,))[0]


def test_displacements_are_normalized_to_steps() -> None:
    variation = transfer_function_family(BASE, **STEPS).variation
    assert variation.normalize(None).tolist() == [0.0] * 4
    assert variation.normalize((0.25, -0.1, 0.25, 0.5)) == pytest.approx([1.0, -1.0, 0.5, 2.0])


def space_of(*names: str) -> ParameterSpace:
    return ParameterSpace(tuple(Parameter(name, -1.0, 1.0) for name in names))


ONE, TWO = Setting("a", (0.1,), "train"), Setting("b", (0.2,), "train")


@pytest.mark.parametrize(
    ("kind", "names", "settings", "message"),
    [
        ("shading", ("isovalue",), (ONE, TWO), "kind.*'shading'"),
        ("isovalue", ("value",), (ONE, TWO), r"\('isovalue',\), got \('value',\)"),
        ("transfer_function", ("isovalue",), (ONE, TWO), "c1_value.*got"),
        ("isovalue", ("isovalue",), (), "dvr has no training settings"),
        ("isovalue", ("isovalue",), (replace(ONE, split="test"),), "dvr has no training settings"),
        ("isovalue", ("isovalue",), (ONE, replace(TWO, values=(1.0, 2.0))), "dvr must have 1 values"),
        ("isovalue", ("isovalue",), (ONE,), "at least two isovalues"),
        ("isovalue", ("isovalue",), (ONE, replace(TWO, values=(0.1,))), "at least two isovalues.*all different"),
        ("isovalue", ("isovalue",), (ONE, replace(TWO, appearance="dvr")), "dvr stands among the settings"),
    ],
)
def test_an_impossible_variation_is_refused(
    kind: Any, names: tuple[str, ...], settings: tuple[Setting, ...], message: str
) -> None:
    with pytest.raises(ValueError, match=message):
        variation_kind(kind)("dvr", space_of(*names), settings)


def test_an_impossible_setting_is_refused() -> None:
    with pytest.raises(ValueError, match=r"split of a .*'trial'"):
        Setting("a", (0.1,), "trial")
    with pytest.raises(ValueError, match=r"of a must be finite.*nan"):
        Setting("a", (float("nan"),), "train")


numbers = st.floats(allow_nan=False, allow_infinity=False)
names = st.text("abcdefgh=-.", min_size=1, max_size=8).filter(lambda name: name != "dvr")


@st.composite
def variations(draw: st.DrawFn) -> Variation:
    kind = draw(st.sampled_from(["isovalue", "transfer_function"]))
    parameters = ("isovalue",) if kind == "isovalue" else POINT_PARAMETERS
    values = st.tuples(*[numbers] * len(parameters))
    trained = draw(st.lists(values, min_size=2, max_size=5, unique=True))
    others = draw(st.lists(st.tuples(values, st.sampled_from(SPLITS[1:])), max_size=4))
    rows = [*((v, "train") for v in trained), *others]
    settings = tuple(Setting(draw(names), v, split) for v, split in rows)
    low = draw(st.floats(-1e6, 1e6))
    space = ParameterSpace(tuple(Parameter(name, low, low + 1.0, draw(st.text(max_size=3))) for name in parameters))
    return variation_kind(kind)("dvr", space, settings)


@given(variations())
def test_json_round_trip(variation: Variation) -> None:
    assert variation_from_json(json.loads(json.dumps(variation.to_json()))) == variation


def test_families_come_back_from_json_to_the_bit() -> None:
    for family in (isovalue_family("dvr", train=(0.1, 1 / 3)), transfer_function_family(BASE, **STEPS)):
        read = variation_from_json(json.loads(json.dumps(family.variation.to_json())))
        assert read == family.variation
        assert read.mismatches((BASE, *family.appearances)) == []


def test_an_appearance_that_shows_something_else_is_named() -> None:
    functions, isovalues = transfer_function_family(BASE, **STEPS), isovalue_family("dvr", train=ISOVALUES)
    swapped = (BASE, replace(functions.appearances[1], name="dvr-train-01"), *functions.appearances[1:])
    (problem,) = functions.variation.mismatches(swapped)
    assert re.search(r"dvr-train-01 does not show .*'c1_value': -0\.25", problem)
    (problem,) = isovalues.variation.mismatches((BASE, Isosurface("iso=2", 2.1), *isovalues.appearances[1:]))
    assert problem == "iso=2 does not show {'isovalue': 2.0}"
    (problem,) = isovalues.variation.mismatches((BASE, replace(BASE, name="iso=2"), *isovalues.appearances[1:]))
    assert "iso=2" in problem
    (problem,) = functions.variation.mismatches((Isosurface("dvr", 1.0), *functions.appearances))
    assert problem == "the base dvr is no volume rendering of four opacity points"


def test_a_field_is_one_of_a_few() -> None:
    variation = field_variation("dvr", appearances=["speed-dvr", "surface"])
    assert variation.space.names == variation.named("train") == ("speed-dvr", "surface")
    assert variation.named("validation", "test") == ()
    assert [s.values for s in variation.settings] == [(1.0, 0.0), (0.0, 1.0)]
    assert [variation.normalize(s.values).tolist() for s in variation.settings] == [[1.0, 0.0], [0.0, 1.0]]
    assert np.isnan(variation.normalize(None)).tolist() == [True, True]
    for setting in variation.settings:
        assert variation.asked(setting) == {"appearance": setting.appearance}
        assert variation.values_of(variation.asked(setting)) == setting.values
    assert variation.values_of({"appearance": "dvr"}) is None
    with pytest.raises(ValueError, match=r"one of \['dvr', 'speed-dvr', 'surface'\], got 'speed'"):
        variation.values_of({"appearance": "speed"})
    assert variation_from_json(json.loads(json.dumps(variation.to_json()))) == variation
    assert not variation.continuous
    assert variation.mismatches([]) == []


def test_settings_are_asked_for_by_their_parameters() -> None:
    functions, isovalues = (
        transfer_function_family(BASE, **STEPS).variation,
        isovalue_family("dvr", train=(1, 2)).variation,
    )
    for variation in (functions, isovalues):
        assert variation.continuous
        assert variation.asked_names == variation.space.names
        for setting in variation.settings:
            assert tuple(variation.asked(setting).values()) == setting.values
            assert variation.values_of(variation.asked(setting)) == setting.values
    assert functions.values_of({"c2_value": 0.05}) == (0.0, 0.0, 0.05, 0.0)
    with pytest.raises(ValueError, match="finite"):
        isovalues.values_of({"isovalue": float("nan")})


@pytest.mark.parametrize("appearances", [[], ["dvr"], ["a", "a"], ["a", "dvr"], [["a"]], ["a", 1], 5, None])
def test_a_field_needs_others_beside_the_base(appearances: Any) -> None:
    with pytest.raises(ValueError, match="appearances must name some beside the base dvr, each once"):
        field_variation("dvr", appearances=appearances)


@pytest.mark.parametrize(
    "settings",
    [
        (Setting("a", (1.0, 0.0), "train"), Setting("b", (1.0, 0.0), "train")),
        (Setting("a", (0.0, 1.0), "train"), Setting("b", (1.0, 0.0), "train")),
        (Setting("a", (1.0, 0.0), "train"), Setting("b", (0.0, 1.0), "test")),
        (Setting("a", (0.5, 0.0), "train"), Setting("b", (0.0, 1.0), "train")),
    ],
    ids=["twice", "swapped", "not trained", "half"],
)
def test_a_field_that_is_no_choice_among_the_trained_is_refused(settings: tuple[Setting, ...]) -> None:
    space = ParameterSpace((Parameter("a", 0.0, 1.0), Parameter("b", 0.0, 1.0)))
    with pytest.raises(ValueError, match="a 1 in its own place"):
        variation_kind("field")("dvr", space, settings)
    with pytest.raises(ValueError, match=r"has the parameters \('a', 'b'\), got \('a', 'c'\)"):
        variation_kind("field")("dvr", ParameterSpace((Parameter("a", 0, 1), Parameter("c", 0, 1))), settings)
