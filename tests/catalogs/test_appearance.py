"""Transfer functions and isosurfaces: what they mean, and what is refused."""

from __future__ import annotations

import json
from dataclasses import asdict

import numpy as np
import pytest

from catalogs.appearance import (
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
        with pytest.raises(ValueError, match="appearance 'look': field must be the name") as caught:
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
    with pytest.raises(ValueError, match=r"\['named', 'other'\] name the field that they show, \['silent'\] do not"):
        check_fields([named, silent, other])
