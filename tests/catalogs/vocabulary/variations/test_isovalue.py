"""Families of isosurfaces: at their values, and at equal distances for a network."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from catalogs.vocabulary.appearance import Isosurface
from catalogs.vocabulary.parameters import Parameter
from catalogs.vocabulary.variations import (
    isovalue_family,
)
from tests.support.variation_bases import BASE, ISOVALUES


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
