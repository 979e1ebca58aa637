"""Transfer functions and isosurfaces: what they mean, and what is refused."""

from __future__ import annotations

import json

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
