"""Whatever a simulation holds its field in, as a grid to render."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from render.grids import Grid


def as_grid(
    field: Any,
    *,
    spacing: Sequence[float] | None = None,
    origin: Sequence[float] | None = None,
    array: str | None = None,
    nan: str = "refuse",
) -> Grid:
    """`field` as a regular grid of float32 point values.

    Parameters
    ----------
    field : a numpy array (z, y, x); any CPU array that speaks DLPack; a pyvista or VTK data set; or an object with
        `values` (z, y, x), `spacing` and `origin`, such as the bundled simulations return.
    spacing, origin : distance between points and place of the first one, (x, y, z), world units; for arrays.
    array : which array of a data set.
    nan : "refuse" NaN and infinity, or show them "transparent".

    Raises ValueError naming what is wrong; see `render.to_grid`.
    """
    from render import to_grid

    described = all(hasattr(field, name) for name in ("values", "spacing", "origin"))
    if described and not hasattr(field, "GetClassName"):
        spacing = field.spacing if spacing is None else spacing
        origin = field.origin if origin is None else origin
        field = field.values
    elif not isinstance(field, np.ndarray) and hasattr(field, "__dlpack__"):
        field = np.from_dlpack(field)
    return to_grid(field, spacing=spacing, origin=origin, array=array, nan=nan)
