"""Clip boxes and slices from outside, as pages, records of pictures and commands have them: checked before anything is drawn."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from catalogs.vocabulary.numbers import finite, row
from native.ray_casting.cuts import AXES, Cut


def cut_of(record: Mapping[str, Any]) -> Cut | None:
    """The cut of a setting's JSON values: `clip`, both corners in a row, x, y, z each, and `slice`, an axis and a place.

    World units; None where both are absent or null.  Raises ValueError naming what is wrong.
    """
    clip, plane = record.get("clip"), record.get("slice")
    if clip is None and plane is None:
        return None
    x, y, z, *high = (0.0,) * 6 if clip is None else row(_listed(clip, "clip"), 6, "clip, both corners in a row,")
    box = None if clip is None else ((x, y, z), (high[0], high[1], high[2]))
    if plane is None:
        return Cut(box)
    parts = _listed(plane, "slice")
    if len(parts) != 2 or parts[0] not in (*AXES,):
        raise ValueError("slice must be x, y or z and a place")
    return Cut(box, (AXES.index(parts[0]), finite(parts[1], "slice")))


def record_of_cut(cut: Cut | None) -> dict[str, Any]:
    """JSON values of which `cut_of` makes the cut; none for no cut."""
    if cut is None:
        return {}
    clip = {} if cut.box is None else {"clip": [*cut.box[0], *cut.box[1]]}
    return clip | ({} if cut.plane is None else {"slice": [AXES[cut.plane[0]], cut.plane[1]]})


def cut_in(clip: str, plane: str) -> dict[str, Any]:
    """The same JSON values of the options --clip X0,Y0,Z0,X1,Y1,Z1 and --slice AXIS=PLACE; raises ValueError for other texts."""
    record: dict[str, Any] = {}
    if clip:
        try:
            record["clip"] = [float(part) for part in clip.split(",")]
        except ValueError:
            raise ValueError(f"--clip takes X0,Y0,Z0,X1,Y1,Z1, got {clip!r}") from None
    if plane:
        axis, _, place = plane.partition("=")
        try:
            record["slice"] = [axis, float(place)]
        except ValueError:
            raise ValueError(f"--slice takes AXIS=PLACE, such as z=0.5, got {plane!r}") from None
    return record


def _listed(value: Any, name: str) -> list[Any]:
    if not isinstance(value, list | tuple) or len(value) > 6:
        raise ValueError(f"{name} must be a short list")
    return list(value)
