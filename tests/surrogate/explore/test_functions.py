"""Transfer functions from outside: what is drawn is what `under` draws, and what is none is refused in a sentence."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner

from catalogs.vocabulary.appearance import TransferFunction
from surrogate.explore.exporting.commands import export
from surrogate.explore.exporting.sweep import Axis, Sweep, check
from surrogate.explore.functions import FARTHEST, MOST_POINTS, function_of, record_of_function
from surrogate.explore.request import MessageError, frame_request, setting_of
from surrogate.explore.setting import Setting
from surrogate.storage.picture_records import record_of
from tests.support.field_blobs import FUNCTION
from tests.support.models import following, plain
from tests.support.requests import message

POINTS = [[0.0, 0.0], [0.25, 0.9], [1.0, 0.1], [2.5, 0.4], [3.0, 1.0]]
FUNCTIONS: dict[str, dict[str, Any]] = {
    "opacity": {"opacity_points": POINTS},
    "two points": {"opacity_points": [[1.0, 1.0], [1.001, 0.0]]},
    "colours": {"opacity_points": POINTS, "color_points": [[0.0, 1, 0, 0], [3.0, 0, 0, 1]]},
    "distance": {"opacity_points": POINTS, "opacity_unit_distance": 0.5},
    "beyond the ends": {"opacity_points": [[-3.0, 0.5], [7.0, 0.1]]},
    "many": {"opacity_points": [[i / 64, (i % 3) / 2] for i in range(MOST_POINTS)]},
}


@pytest.mark.parametrize("record", FUNCTIONS.values(), ids=FUNCTIONS)
@pytest.mark.parametrize("color_map", ["", "viridis"])
def test_a_function_is_drawn_as_the_surrogate_draws_under_it(record: dict[str, Any], color_map: str) -> None:
    surrogate = following()
    asked = setting_of({"parameters": {"p": 0.5}, "function": record, "color_map": color_map}, surrogate)
    function = function_of(record, FUNCTION)
    assert function.opacity_points == tuple(map(tuple, record["opacity_points"]))
    if color_map:
        function = replace(function, color_points=asked.transfer_function(surrogate).color_points)
    camera = frame_request(message(), surrogate).camera
    expected = surrogate.under(function, p=0.5).render(camera)
    np.testing.assert_array_equal(asked.member(surrogate).render(camera), expected)
    assert function_of(json.loads(json.dumps(record_of_function(function))), FUNCTION) == function


WRONG: dict[str, tuple[Any, str]] = {
    "text": ("x", "an object of opacity_points"),
    "nothing": ({}, "an object of opacity_points"),
    "other names": ({"opacity_points": POINTS, "shaded": True}, "an object of opacity_points"),
    "one point": ({"opacity_points": [[0, 0]]}, "at least two points"),
    "too many": ({"opacity_points": [[i, 0] for i in range(MOST_POINTS + 1)]}, "at most 256 opacity_points, got 257"),
    "too many colours": (
        {"opacity_points": POINTS, "color_points": [[i, 0, 0, 0] for i in range(MOST_POINTS + 1)]},
        "at most 256 color_points",
    ),
    "unsorted": ({"opacity_points": [[1, 0], [0, 1]]}, "strictly increasing"),
    "twice": ({"opacity_points": [[1, 0], [1, 1]]}, "strictly increasing"),
    "opaque": ({"opacity_points": [[0, 0], [1, 1.5]]}, r"in \[0, 1\]"),
    "NaN": ({"opacity_points": [[0, 0], [math.nan, 1]]}, "finite"),
    "a number for points": ({"opacity_points": 3}, "at least two points"),
    "far": ({"opacity_points": [[0, 0], [3 * FARTHEST + 10, 1]]}, "too far from the values 0 to 3 of this run"),
    "no distance": ({"opacity_points": POINTS, "opacity_unit_distance": 0}, "opacity_unit_distance"),
}


@pytest.mark.parametrize(("record", "said"), WRONG.values(), ids=WRONG)
def test_what_is_no_function_is_refused(record: Any, said: str) -> None:
    with pytest.raises(MessageError, match=said) as refused:
        setting_of({"parameters": {"p": 0.5}, "function": record}, following())
    assert len(str(refused.value)) <= 300


def test_a_function_stands_alone_and_needs_values() -> None:
    record = {"parameters": {"p": 0.5}, "function": {"opacity_points": POINTS}}
    with pytest.raises(MessageError, match="stands alone"):
        setting_of({**record, "visualization": {"c1_value": 0.1}}, following())
    with pytest.raises(MessageError, match="follows no transfer functions"):
        setting_of(record, plain())


def test_control_points_of_the_base_are_not_swept_under_another_function() -> None:
    function = function_of({"opacity_points": POINTS}, FUNCTION)
    swept = Sweep(Setting({"p": 0.5}, function=function), Axis("c1_value", -0.1, 0.1, 3))
    with pytest.raises(ValueError, match="has no c1_value, which belong to the base"):
        check(swept, following())


def test_the_command_takes_a_function_and_pictures_keep_it(tmp_path: Path) -> None:
    following().save(tmp_path / "surrogate")
    (tmp_path / "function.json").write_text(json.dumps({"opacity_points": POINTS}))
    for options, name in ((("--function", "function.json"), "first.png"), (("--like", "first.png"), "again.exr")):
        paths = [str(tmp_path / part) if "." in part else part for part in options]
        done = CliRunner().invoke(export, [str(tmp_path), "--size", "24", *paths, "-o", str(tmp_path / name)])
        assert done.exit_code == 0, done.output
        function = TransferFunction(**record_of(tmp_path / name)["function"])
        assert function.opacity_points == tuple(map(tuple, POINTS))
    (tmp_path / "function.json").write_text("{")
    asked = [str(tmp_path), "--function", str(tmp_path / "function.json"), "-o", str(tmp_path / "a.png")]
    refused = CliRunner().invoke(export, asked)
    assert refused.exit_code
    assert "holds no transfer function in JSON" in refused.output
