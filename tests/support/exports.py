"""Requests of exports that are refused, and why."""

from __future__ import annotations

from typing import Any

SWEEP = {"name": "p", "low": "", "high": "", "count": 3, "second": "", "secondCount": 2}


WRONG: list[tuple[dict[str, Any], str]] = [
    ({}, "kind must be one of"),
    ({"kind": "../../x"}, "kind must be one of"),
    ({"kind": ["png"]}, "kind must be one of"),
    ({"kind": "gif"}, "needs a sweep"),
    ({"kind": "gif", "sweep": [1]}, "needs a sweep"),
    ({"kind": "gif", "sweep": {"name": 3, "count": 3}}, "the name of a parameter"),
    ({"kind": "gif", "sweep": {"name": "p", "count": "3"}}, "the name of a parameter"),
    ({"kind": "gif", "sweep": {"name": "q", "count": 3}}, "q"),
    ({"kind": "sheet", "sweep": {"name": "p", "count": 10**9}}, "steps"),
    ({"kind": "sheet", "sweep": {**SWEEP, "low": 1e9}}, "too far outside"),
    ({"kind": "sheet", "sweep": {**SWEEP, "low": 0.5, "high": 0.5}}, "to a larger one"),
    ({"kind": "sheet", "sweep": {**SWEEP, "second": "p"}}, "two different parameters"),
    ({"kind": "png", "size": [10**6, 10**6]}, "a side of a picture"),
]
