"""One field from one file: numpy's .npy, or anything that pyvista reads (VTK, XDMF, EnSight, CGNS, ...)."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from render.datasets import to_grid

if TYPE_CHECKING:
    from render.grids import Grid


def read_field(
    path: str | os.PathLike[str],
    *,
    array: str | None = None,
    spacing: Sequence[float] | None = None,
    nan: str = "refuse",
) -> Grid:
    """The field stored in `path` as a grid.

    Parameters
    ----------
    array : which array of a VTK file; may be left out where there is only one.
    spacing : (x, y, z) world units, for .npy files, which hold (z, y, x) values and nothing else.
    nan : as in `render_member`.

    Raises FileNotFoundError, or ValueError naming the file and what is wrong with it.
    """
    path = Path(path)
    if not path.is_file():
        raise FileNotFoundError(f"there is no file {path}")
    try:
        if path.suffix == ".npy":
            return to_grid(np.load(path, mmap_mode="r", allow_pickle=False), spacing=spacing, nan=nan, warn=False)
        import pyvista

        return to_grid(pyvista.read(path), array=array, nan=nan, warn=False)
    except (ValueError, TypeError, OSError, EOFError, KeyError) as error:
        raise ValueError(f"{path}: {error}") from error
