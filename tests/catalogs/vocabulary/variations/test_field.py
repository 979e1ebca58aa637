"""Fields: one of a few appearances, asked for by its name."""

from __future__ import annotations

import json
from typing import Any

import numpy as np
import pytest

from catalogs.vocabulary.appearance import ImportedImages
from catalogs.vocabulary.parameters import Parameter, ParameterSpace
from catalogs.vocabulary.variations import (
    VariationSetting,
    field_variation,
    variation_from_json,
    variation_kind,
)


def test_a_field_is_one_of_a_few() -> None:
    variation = field_variation("dvr", appearances=["speed-dvr", "surface"])
    assert variation.space.names == variation.named("train") == ("speed-dvr", "surface")
    assert variation.named("validation", "test") == ()
    assert [s.values for s in variation.settings] == [(1.0, 0.0), (0.0, 1.0)]
    assert [variation.normalize(s.values).tolist() for s in variation.settings] == [[1.0, 0.0], [0.0, 1.0]]
    assert np.isnan(variation.normalize(None)).tolist() == [True, True]
    for setting in variation.settings:
        assert variation.arguments(setting) == {"appearance": setting.appearance}
        assert variation.values_of(variation.arguments(setting)) == setting.values
    assert variation.values_of({"appearance": "dvr"}) is None
    with pytest.raises(ValueError, match=r"one of dvr, speed-dvr, surface, got 'speed'"):
        variation.values_of({"appearance": "speed"})
    assert variation_from_json(json.loads(json.dumps(variation.to_json()))) == variation
    assert not variation.continuous
    shown = [ImportedImages(name) for name in ("dvr", "speed-dvr", "surface")]
    assert variation.mismatches(shown) == []  # any appearance may stand for a field


@pytest.mark.parametrize("appearances", [[], ["dvr"], ["a", "a"], ["a", "dvr"], [["a"]], ["a", 1], 5, None])
def test_a_field_needs_others_beside_the_base(appearances: Any) -> None:
    with pytest.raises(ValueError, match="appearances must name some beside the base dvr, each once"):
        field_variation("dvr", appearances=appearances)


@pytest.mark.parametrize(
    "settings",
    [
        (VariationSetting("a", (1.0, 0.0), "train"), VariationSetting("b", (1.0, 0.0), "train")),
        (VariationSetting("a", (0.0, 1.0), "train"), VariationSetting("b", (1.0, 0.0), "train")),
        (VariationSetting("a", (1.0, 0.0), "train"), VariationSetting("b", (0.0, 1.0), "test")),
        (VariationSetting("a", (0.5, 0.0), "train"), VariationSetting("b", (0.0, 1.0), "train")),
    ],
    ids=["twice", "swapped", "not trained", "half"],
)
def test_a_field_that_is_no_choice_among_the_trained_is_refused(settings: tuple[VariationSetting, ...]) -> None:
    space = ParameterSpace((Parameter("a", 0.0, 1.0), Parameter("b", 0.0, 1.0)))
    with pytest.raises(ValueError, match="a 1 in its own place"):
        variation_kind("field")("dvr", space, settings)
    with pytest.raises(ValueError, match=r"has the parameters a, b, got a, c"):
        variation_kind("field")("dvr", ParameterSpace((Parameter("a", 0, 1), Parameter("c", 0, 1))), settings)
