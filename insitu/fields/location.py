"""The place of a field's values: in the data that hold them, and in the world."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

Ghosts = int | Sequence[int | tuple[int, int]]


@dataclass(frozen=True)
class FieldLocation:
    """Arguments of the hook that say where a field lies, for all fields of a member.

    Attributes
    ----------
    spacing, origin : (x, y, z), world units, of arrays that do not say; `origin` is the place of the first sample.
    array : the array of a data set, where appearances name no field.
    dims : the axes of an array in its own order, such as ("x", "y", "z"); (z, y, x) by default.
    ghosts : layers around a block that are its neighbours' (see `insitu.Session.render_member`).
    nan : "refuse" NaN and infinity, or show them "transparent".
    """

    spacing: Sequence[float] | None = None
    origin: Sequence[float] | None = None
    array: str | None = None
    dims: Sequence[str] | None = None
    ghosts: Ghosts = 0
    nan: str = "refuse"
