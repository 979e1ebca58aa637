"""Transfer functions and isosurfaces: what they mean, and what is refused."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import asdict

import numpy as np
import pytest

from catalogs.vocabulary.appearance import (
    Appearance,
    ImportedImages,
    Isosurface,
    TransferFunction,
    VolumeRendering,
    appearance_from_json,
    appearance_to_json,
    check_fields,
    field_of,
    shown_fields,
)

FUNCTION = TransferFunction(((0.0, 0.0, 0.0, 1.0), (2.0, 1.0, 0.5, 0.0)), ((-1.0, 0.2), (1.0, 0.6), (4.0, 0.0)), 0.3)


def test_piecewise_linear_and_constant_beyond() -> None:
    assert FUNCTION.colors([-5.0, 0.5, 9.0]).tolist() == [[0, 0, 1], [0.25, 0.125, 0.75], [1, 0.5, 0]]
    assert FUNCTION.opacities([[-9.0, 0.0], [2.5, 9.0]]) == pytest.approx(np.array([[0.2, 0.4], [0.3, 0.0]]))
    assert FUNCTION.bounds == (-1.0, 4.0)


@pytest.mark.parametrize(
    "appearance",
    [
        VolumeRendering("dvr", FUNCTION, shaded=True),
        Isosurface("iso", -40.0, color=(0.1, 0.2, 0.3)),
        ImportedImages("x", "by hand"),
    ],
)
def test_json_round_trip(appearance: Appearance) -> None:
    assert appearance_from_json(json.loads(json.dumps(appearance_to_json(appearance)))) == appearance


@pytest.mark.parametrize(
    ("colors", "opacities", "distance"),
    [
        (((0, 0, 0, 0),), ((0, 0), (1, 1)), 1.0),
        (((0, 0, 0, 0), (0, 1, 1, 1)), ((0, 0), (1, 1)), 1.0),
        (((0, 0, 0, 0), (1, 1, 1, 1)), ((1, 0), (0, 1)), 1.0),
        (((0, 0, 0, 0), (1, 1, 1, 2)), ((0, 0), (1, 1)), 1.0),
        (((0, 0, 0, 0), (1, 1, 1, 1)), ((0, 0), (1, -0.1)), 1.0),
        (((0, 0, 0, 0), (1, 1, 1, 1)), ((0, 0), (float("nan"), 1)), 1.0),
        (((0, 0, 0, 0), (1, 1, 1, 1)), ((0, 0), (1, 1)), 0.0),
        (((0, 0, 0), (1, 1, 1)), ((0, 0), (1, 1)), 1.0),
    ],
)
def test_impossible_transfer_functions_are_refused(colors: tuple, opacities: tuple, distance: float) -> None:
    with pytest.raises(ValueError, match=r"points|distance"):
        TransferFunction(colors, opacities, distance)


@pytest.mark.parametrize(
    ("record", "named"),
    [
        ({"kind": "fog", "name": "a"}, "fog"),
        ({"kind": "isosurface", "name": "a"}, "isovalue"),
        ({"kind": "isosurface", "name": "a", "isovalue": 1.0, "shiny": 1}, "shiny"),
        ({"kind": "volume", "name": "a"}, "transfer_function"),
        ({"name": "a"}, "None"),
    ],
)
def test_malformed_records_are_named(record: dict[str, object], named: str) -> None:
    with pytest.raises(ValueError, match=named):
        appearance_from_json(record)


ENDS = ((0, 0, 0, 0), (1, 1, 1, 1)), ((0, 0), (1, 1))


@pytest.mark.parametrize(
    ("made", "message"),
    [
        (lambda: Isosurface("iso", 0.5, color="red"), r"appearance 'iso': color, .*, must be 3 numbers, got 'red'"),
        (lambda: Isosurface("iso", 0.5, color=(1, 0)), r"'iso': color, .*, must be 3 numbers, got 2: \(1, 0\)"),
        (lambda: Isosurface("iso", 0.5, color=(255, 0, 0)), r"'iso': color must lie in \[0, 1\], got 255"),
        (lambda: Isosurface("iso", 0.5, color=("r", 0, 0)), "must be a finite number, got 'r'"),
        (lambda: Isosurface("iso", "0.5"), "appearance 'iso': isovalue must be a finite number, got '0.5'"),
        (lambda: Isosurface("iso", float("nan")), "appearance 'iso': isovalue must be a finite number, got nan"),
        (lambda: Isosurface("iso", np.array([0.5])), "appearance 'iso': isovalue must be a finite number"),
        (lambda: Isosurface("iso", 0.5, ambient=-0.1), "appearance 'iso': ambient must not be negative, got -0.1"),
        (lambda: Isosurface("iso", 0.5, specular_power=None), "specular_power must be a finite number, got None"),
        (lambda: Isosurface(5, 0.5), "the name of an appearance must be text, got 5"),
        (lambda: Isosurface("", 0.5), "the name of an appearance must be text, got ''"),
        (lambda: VolumeRendering("dvr", "hot"), "'dvr': transfer_function must be a TransferFunction, got 'hot'"),
        (lambda: VolumeRendering("dvr", None), "'dvr': transfer_function must be a TransferFunction, got None"),
        (lambda: VolumeRendering("dvr", FUNCTION, shaded="yes"), "'dvr': shaded must be True or False, got 'yes'"),
        (lambda: VolumeRendering(None, FUNCTION), "the name of an appearance must be text, got None"),
        (lambda: ImportedImages("x", 5), "appearance 'x': note must be text, got 5"),
        (lambda: TransferFunction(*ENDS, "far"), "opacity_unit_distance must be a finite number, got 'far'"),
        (lambda: TransferFunction("hot", ENDS[1], 1.0), "color_points must be at least two points of 4 numbers"),
        (lambda: TransferFunction(ENDS[0], (0, 1), 1.0), "each of opacity_points must be 2 numbers, got 0"),
        (lambda: TransferFunction(ENDS[0], ((0, "a"), (1, 1)), 1.0), "must be a finite number, got 'a'"),
        (lambda: TransferFunction(ENDS[0], ((0, 0), (np.inf, 1)), 1.0), "must be a finite number, got inf"),
    ],
)
def test_what_could_not_be_drawn_or_written_down_is_refused_when_made(
    made: Callable[[], Appearance], message: str
) -> None:
    with pytest.raises(ValueError, match=message):
        made()


def test_numbers_of_numpy_become_plain_ones_that_json_can_hold() -> None:
    points = np.array([[0, 0, 0, 0], [1, 1, 1, 1]], np.float32), np.array([[0, 0], [1, 1]], np.int64)
    function = TransferFunction(*points, np.float32(0.5))  # type: ignore[arg-type]
    appearances = (
        VolumeRendering("dvr", function, shaded=np.True_),  # type: ignore[arg-type]
        Isosurface("iso", np.float32(0.25), np.array([1, 0, 0]), np.float16(0.5), specular_power=np.int8(3)),  # type: ignore[arg-type]
    )
    for appearance in appearances:
        assert appearance_from_json(json.loads(json.dumps(appearance_to_json(appearance)))) == appearance


# Literally what was written before appearances could name a field: plans and fingerprints of trained runs are compared with it.
BEFORE_FIELDS = {
    '{"kind": "volume", "name": "dvr", "transfer_function": {"color_points": [[0.0, 0.0, 0.0, 1.0], [2.0, 1.0, 0.5, 0.0]], '
    '"opacity_points": [[-1.0, 0.2], [1.0, 0.6], [4.0, 0.0]], "opacity_unit_distance": 0.3}, "shaded": false}': (
        VolumeRendering("dvr", FUNCTION)
    ),
    '{"kind": "isosurface", "name": "iso", "isovalue": 0.25, "color": [0.85, 0.85, 0.85], "ambient": 0.15, '
    '"diffuse": 0.75, "specular": 0.2, "specular_power": 20.0}': Isosurface("iso", 0.25),
    '{"kind": "imported", "name": "x", "note": "by hand"}': ImportedImages("x", "by hand"),
}


@pytest.mark.parametrize("text", BEFORE_FIELDS)
def test_without_a_field_the_record_is_what_it_was_byte_for_byte(text: str) -> None:
    assert json.dumps(appearance_to_json(BEFORE_FIELDS[text])) == text
    assert appearance_from_json(json.loads(text)) == BEFORE_FIELDS[text]


@pytest.mark.parametrize("field", ["speed", "|u| in m/s", "Größe"])
def test_a_field_is_recorded(field: str) -> None:
    for appearance in (VolumeRendering("dvr", FUNCTION, field=field), Isosurface("iso", 1.0, field=field)):
        record = json.loads(json.dumps(appearance_to_json(appearance)))
        assert record["field"] == field == field_of(appearance)
        assert appearance_from_json(record) == appearance
    assert field_of(ImportedImages("x")) == ""


@pytest.mark.parametrize("field", [" speed", "speed\n", "a\tb", " ", 3, None, ["speed"]])
def test_what_names_no_field_is_refused(field: object) -> None:
    for record in (
        {"kind": "volume", "name": "look", "transfer_function": asdict(FUNCTION), "field": field},
        {"kind": "isosurface", "name": "look", "isovalue": 1.0, "field": field},
    ):
        with pytest.raises(ValueError, match="appearance 'look': field must be a printable name") as caught:
            appearance_from_json(record)
        assert repr(field) in str(caught.value)
    with pytest.raises(ValueError, match="'field'"):
        appearance_from_json({"kind": "imported", "name": "x", "field": "speed"})


def test_fields_are_named_by_all_appearances_or_by_none() -> None:
    silent, named = Isosurface("silent", 1.0), Isosurface("named", 1.0, field="speed")
    other, picture = VolumeRendering("other", FUNCTION, field="q"), ImportedImages("picture")
    assert shown_fields([named, other, named, picture]) == ("speed", "q")
    assert shown_fields([silent, picture]) == ("",)
    assert shown_fields([picture]) == shown_fields([]) == ()
    for appearances in ([silent, picture], [named, other, picture], [picture], []):
        check_fields(appearances)
    with pytest.raises(ValueError, match="named, other name the field that they show, silent do not"):
        check_fields([named, silent, other])
