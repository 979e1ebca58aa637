"""Requests of the explorer's page, good and wrong ones."""

from __future__ import annotations

import math
from typing import Any

from surrogate.explore.request import (
    MOST_SETTINGS,
    MOST_SIDE,
)

CAMERA = {"position": [3.0, 1.0, 0.5], "target": [0.5, 0.0, 0.0], "up": [0, 0, 1], "field": 30}


def message(**changes: Any) -> dict[str, Any]:
    good = {
        "settings": [{"parameters": {"p": 0.25}, "visualization": {}, "color_map": ""}],
        "camera": CAMERA,
        "size": [64, 48],
        "background": "#ff8000",
        "form": "png",
    }
    return {**good, **changes}


WRONG: list[tuple[dict[str, Any], str]] = [
    ({"settings": None}, "settings must be a list"),
    ({"settings": []}, "settings must be a list"),
    ({"settings": [{}] * (MOST_SETTINGS + 1)}, "settings must be a list"),
    ({"settings": ["p"]}, "a setting must be an object"),
    ({"settings": [{"parameters": {}}]}, "parameters must be exactly"),
    ({"settings": [{"parameters": {"p": 0.5, "q": 1}}]}, "parameters must be exactly"),
    ({"settings": [{"parameters": {"p": "0.5"}}]}, "p must be a number"),
    ({"settings": [{"parameters": {"p": True}}]}, "p must be a number"),
    ({"settings": [{"parameters": {"p": math.nan}}]}, "p must be finite"),
    ({"settings": [{"parameters": {"p": 10**400}}]}, "p must be finite"),
    ({"settings": [{"parameters": {"p": 1e30}}]}, "too far outside its bounds"),
    ({"settings": [{"parameters": {1: 0.5}}]}, "named values"),
    (
        {"settings": [{"parameters": {"p": 0.5}, "visualization": {"isovalue": 0.3, "c1_value": 0}}]},
        "visualization must",
    ),
    ({"settings": [{"parameters": {"p": 0.5}, "visualization": {"__class__": 0.3}}]}, "visualization must be"),
    ({"settings": [{"parameters": {"p": 0.5}, "visualization": {"isovalue": math.inf}}]}, "isovalue must be finite"),
    ({"settings": [{"parameters": {"p": 0.5}, "color_map": "../../etc/passwd"}]}, "color_map must be one of"),
    ({"settings": [{"parameters": {"p": 0.5}, "color_map": ["viridis"]}]}, "color_map must be one of"),
    (
        {"settings": [{"parameters": {"p": 0.5}, "visualization": {"isovalue": 0.3}, "color_map": "viridis"}]},
        "belongs to a transfer function",
    ),
    (
        {"settings": [{"parameters": {"p": 0.5}, "visualization": {"c1_value": 0.75, "c2_value": -0.75}}]},
        "strictly increasing",
    ),
    *(
        ({"settings": [{"parameters": {"p": 0.5}, "clip": clip}]}, said)
        for clip, said in [
            ([0, 0, 0, 1, 1, 1], "only an emulated field can be cut or sliced"),
            ([0, 0, 0, 1, 1], "must be 6 numbers"),
            ([0, 0, 0, 1, 1, math.nan], "clip, both corners in a row,"),
            ([0, 0, 0, 1, 1, math.inf], "clip, both corners in a row,"),
            ([0, 0, 0, 1, 1, 10**400], "clip, both corners in a row,"),
            ([0, 0, 0, 1, 1, "1"], "clip, both corners in a row,"),
            ([0, 0, 0, 1, 1, True], "clip, both corners in a row,"),
            ([0, 0, 1, 1, 1, 0.5], "a box goes from a place to a higher one"),
            ([0] * 100_000, "clip must be a short list"),
            ("0,0,0,1,1,1", "clip must be a short list"),
            ({"low": 0}, "clip must be a short list"),
            ([[0, 0, 0], [1, 1, 1]], "must be 6 numbers"),
            (0, "clip must be a short list"),
        ]
    ),
    *(
        ({"settings": [{"parameters": {"p": 0.5}, "slice": plane}]}, said)
        for plane, said in [
            (["x", 0.5], "only an emulated field can be cut or sliced"),
            (["w", 0.5], "slice must be x, y or z and a place"),
            (["xy", 0.5], "slice must be x, y or z and a place"),
            ([["x"], 0.5], "slice must be x, y or z and a place"),
            ([{}, 0.5], "slice must be x, y or z and a place"),
            (["x"], "slice must be x, y or z and a place"),
            (["x", math.nan], "slice"),
            (["x", "0.5"], "slice"),
            ("x=0.5", "slice must be a short list"),
            (False, "slice must be a short list"),
        ]
    ),
    ({"camera": None}, "camera must be an object"),
    ({"camera": {**CAMERA, "position": [1, 2]}}, "camera.position must be a list of 3"),
    ({"camera": {**CAMERA, "position": [1, 2, math.nan]}}, "camera.position must be finite"),
    ({"camera": {**CAMERA, "position": [1e30, 2, 3]}}, "half sizes of the volume away"),
    ({"camera": {**CAMERA, "target": CAMERA["position"]}}, "not a camera"),
    ({"camera": {**CAMERA, "up": [0, 0, 0]}}, "camera.up must have a length"),
    ({"camera": {**CAMERA, "field": 0}}, "camera.field must lie in"),
    ({"camera": {**CAMERA, "field": 180}}, "camera.field must lie in"),
    ({"size": [64]}, "size must be a list of 2"),
    ({"size": [10**6, 10**6]}, "a side of a picture has"),
    ({"size": [64.5, 64]}, "a side of a picture has"),
    ({"size": [0, 64]}, "a side of a picture has"),
    ({"size": [-64, 64]}, "a side of a picture has"),
    ({"settings": [message()["settings"][0]] * 2, "size": [MOST_SIDE, MOST_SIDE]}, "are more than"),
    ({"background": "red"}, "a colour is written #rrggbb"),
    ({"background": "#ff800"}, "a colour is written #rrggbb"),
    ({"background": "#ff8000\n"}, "a colour is written #rrggbb"),
    ({"background": 7}, "a colour is written #rrggbb"),
    ({"form": "svg"}, "form must be jpeg or png"),
    ({"form": ["png"]}, "form must be jpeg or png"),
    ({"difference": 1}, "difference must be true or false"),
    ({"difference": True}, "a difference is between two"),
    ({"truth": True, "settings": [message()["settings"][0]] * 2}, "the truth stands beside one"),
]
