"""Choices for the whole ensemble before its first member."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from catalogs.vocabulary.appearance import ImportedImages, VolumeRendering
from catalogs.vocabulary.parameters import Parameter, ParameterSpace
from catalogs.vocabulary.variations import isovalue_family
from insitu.hook.session import Session
from insitu.members.planning import Pilot, appearances_from_toml, combine_pilots, space_from
from render import SampleDistance
from tests.support.hooked import FUNCTION


def step(distance: float, decibels: float) -> SampleDistance:
    return SampleDistance(distance, decibels)


def test_several_pilots_give_the_widest_box_and_the_finest_step() -> None:
    pilots = [
        Pilot(((0, 0, 0), (1, 1, 1)), {"": (0.0, 5.0)}, {"a": step(0.2, 51.0), "b": step(0.1, 52.0)}),
        Pilot(((-1, 0, 0), (1, 3, 1)), {"": (1.0, 7.0)}, {"a": step(0.3, 53.0), "b": step(0.05, 54.0)}),
    ]
    combined = combine_pilots(pilots)
    assert combined.bounds == ((-1.0, 0.0, 0.0), (1.0, 3.0, 1.0))
    assert combined.ranges == {"": (0.0, 7.0)}
    assert combined.distances == {"a": step(0.2, 51.0), "b": step(0.05, 54.0)}


@pytest.mark.parametrize(
    "text",
    ["[[appearance", "x = 1", "appearance = 3", '[[appearance]]\nkind = "volume"', '[[appearance]]\nkind = "solid"'],
)
def test_a_wrong_appearance_file_is_named(tmp_path: Path, text: str) -> None:
    (tmp_path / "look.toml").write_text(text)
    with pytest.raises(ValueError, match=r"look\.toml"):
        appearances_from_toml(tmp_path / "look.toml")


RE = Parameter("Re", 100.0, 200.0)
NU = Parameter("nu", 1e-4, 1e-2, "m²/s", "log")


@pytest.mark.parametrize(
    ("space", "parameters"),
    [
        ({"Re": (100, 200)}, (RE,)),
        ({"Re": np.array([100, 200])}, (RE,)),
        ({"Re": [100, 200], "nu": NU}, (RE, NU)),
        ({"v": (0, 1, "m/s")}, (Parameter("v", 0.0, 1.0, "m/s"),)),
        (NU, (NU,)),
        ([RE, NU], (RE, NU)),
        (ParameterSpace((RE, NU)), (RE, NU)),
        ({}, ()),
    ],
)
def test_a_space_is_given_in_many_ways(space: Any, parameters: tuple[Parameter, ...]) -> None:
    found = space_from(space)
    assert found is not None
    assert found.parameters == parameters


@pytest.mark.parametrize(
    ("space", "message"),
    [
        ({"a": 1}, r"space must be \{name: \(low, high\)\}.*, got \(1,\) for 'a'"),
        ({"a": (1,)}, "got .* for 'a'"),
        ({"a": (1, 2, "m", "log")}, "got .* for 'a'"),
        ({"a": "12"}, "space must be"),
        ({"a": (1, "x")}, "parameter a: high, one of its bounds, must be a finite number, got 'x'"),
        ({"a": (2, 1)}, "parameter a needs bounds low < high, got 2, 1"),
        ({"a": RE}, "space names parameter 'Re' 'a'"),
        ({5: (0, 1)}, "got the name 5"),
        ("Re", "space must be"),
        ([("Re", 0, 1)], "space must be"),
        (5, "space must be .*, got space=5"),
    ],
)
def test_what_is_no_space_is_named(space: Any, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        space_from(space)


FAMILY = isovalue_family("dvr", train=(0.2, 0.4))
VOLUME = VolumeRendering("dvr", FUNCTION)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"space": {"a": 1}}, r"space must be \{name: \(low, high\)\}"),
        ({"appearances": "dvr"}, r"appearances must be VolumeRendering\(name, transfer_function\).*, got 'dvr'"),
        ({"appearances": ["dvr"]}, "appearances must be .*, got 'dvr'"),
        ({"appearances": {"dvr": FUNCTION}}, "appearances must be"),
        ({"appearances": 5}, "appearances must be .*, got 5"),
        ({"appearances": FUNCTION}, r"a TransferFunction is not yet an appearance: .* VolumeRendering\("),
        ({"appearances": [VOLUME, FUNCTION]}, "a TransferFunction is not yet an appearance"),
        ({"appearances": FAMILY}, r"appearances=\[base, \*family\.appearances\] and variations=\[family\.variation\]"),
        ({"appearances": ImportedImages("photo")}, "'photo' is of images made elsewhere"),
        ({"variations": [FAMILY]}, r"variations must be Variation objects, .*: pass its \.variation"),
        ({"variations": "isovalue"}, "variations must be Variation objects, got 'i'"),
        ({"views": 252}, r"views must be a ViewPlan\(frequency, width, height\), got 252"),
        ({"bounds": "all"}, "bounds must be .*, got all"),
        ({"bounds": ((0, 0), (1, 1))}, "bounds must be"),
        ({"target_decibels": "high"}, "target_decibels must be a finite number, got 'high'"),
        ({"target_decibels": -1}, "target_decibels must lie between 0 and 58.*got -1"),
        ({"sample_distance": "fine"}, r"sample_distance \(world units\) must be a finite number, got 'fine'"),
        ({"sample_distance": {"dvr": 0}}, r"sample_distance \(world units\) must be positive, got 0"),
        ({"image_format": "jpg"}, r"image_format must be one of exr, png, got 'jpg'"),
        ({"provenance": {"a": {1, 2}}}, "provenance must hold JSON values"),
        ({"fields": "Q"}, "fields must be units by the names of fields"),
        ({"nan": "keep"}, r"nan must be one of refuse, transparent, got 'keep'"),
    ],
)
def test_arguments_of_a_wrong_kind_are_named_with_the_remedy(
    tmp_path: Path, arguments: dict[str, Any], message: str
) -> None:
    with pytest.raises(ValueError, match=message) as caught:
        Session(tmp_path / "a.cdb", **arguments)
    assert len(str(caught.value)) < 400
    assert list(tmp_path.iterdir()) == []
