"""Rules of all variations: impossible ones are refused, JSON restores them, and mismatches are named."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from catalogs.vocabulary.appearance import Isosurface
from catalogs.vocabulary.parameters import SPLITS, Parameter, ParameterSpace
from catalogs.vocabulary.variations import (
    KINDS,
    POINT_PARAMETERS,
    Variation,
    VariationSetting,
    isovalue_family,
    transfer_function_family,
    variation_from_json,
    variation_kind,
)
from tests.support.variation_bases import BASE, ISOVALUES, STEPS


def space_of(*names: str) -> ParameterSpace:
    return ParameterSpace(tuple(Parameter(name, -1.0, 1.0) for name in names))


ONE, TWO = VariationSetting("a", (0.1,), "train"), VariationSetting("b", (0.2,), "train")


@pytest.mark.parametrize(
    ("kind", "names", "settings", "message"),
    [
        ("shading", ("isovalue",), (ONE, TWO), "kind.*'shading'"),
        ("isovalue", ("value",), (ONE, TWO), r"isovalue, got value"),
        ("transfer_function", ("isovalue",), (ONE, TWO), "c1_value.*got"),
        ("isovalue", ("isovalue",), (), "dvr has no training settings"),
        ("isovalue", ("isovalue",), (replace(ONE, split="test"),), "dvr has no training settings"),
        ("isovalue", ("isovalue",), (ONE, replace(TWO, values=(1.0, 2.0))), "dvr must have 1 values"),
        ("isovalue", ("isovalue",), (ONE,), "at least two isovalues"),
        ("isovalue", ("isovalue",), (ONE, replace(TWO, values=(0.1,))), "at least two isovalues.*all different"),
        ("isovalue", ("isovalue",), (ONE, replace(TWO, appearance="dvr")), "dvr is among the settings"),
    ],
)
def test_an_impossible_variation_is_refused(
    kind: Any, names: tuple[str, ...], settings: tuple[VariationSetting, ...], message: str
) -> None:
    with pytest.raises(ValueError, match=message):
        variation_kind(kind)("dvr", space_of(*names), settings)


def test_an_impossible_setting_is_refused() -> None:
    with pytest.raises(ValueError, match=r"split of a .*'trial'"):
        VariationSetting("a", (0.1,), "trial")
    with pytest.raises(ValueError, match=r"of a must be finite.*nan"):
        VariationSetting("a", (float("nan"),), "train")


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
    settings = tuple(VariationSetting(draw(names), v, split) for v, split in rows)
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
    assert problem == "the base dvr is not a volume rendering with four opacity points"


def test_settings_are_asked_for_by_their_parameters() -> None:
    functions, isovalues = (
        transfer_function_family(BASE, **STEPS).variation,
        isovalue_family("dvr", train=(1, 2)).variation,
    )
    for variation in (functions, isovalues):
        assert variation.continuous
        assert variation.argument_names == variation.space.names
        for setting in variation.settings:
            assert tuple(variation.arguments(setting).values()) == setting.values
            assert variation.values_of(variation.arguments(setting)) == setting.values
    assert functions.values_of({"c2_value": 0.05}) == (0.0, 0.0, 0.05, 0.0)
    with pytest.raises(ValueError, match="finite"):
        isovalues.values_of({"isovalue": float("nan")})


def test_each_kind_says_what_it_is() -> None:
    said = {kind: (form.name, form.plural, form.continuous, form.edits_base) for kind, form in KINDS.items()}
    assert said == {
        "isovalue": ("isovalue", "isovalues", True, False),
        "transfer_function": ("transfer function", "transfer functions", True, True),
        "field": ("field", "other fields", False, False),
    }
