"""The two ways to draw a field: VTK, and the ray caster of `native`."""

from __future__ import annotations

from catalogs.vocabulary.appearance import Appearance, Isosurface, VolumeRendering
from catalogs.vocabulary.scene import BACKENDS
from catalogs.vocabulary.words import joined_names
from render.grids import Grid

MOST_SAMPLES = 1 << 29  # of a field, with a layer around it: what the ray caster counts to


def backend_of(grid: Grid, appearance: Appearance, wanted: str = "auto", usual: str = "") -> str:
    """The way in which an appearance of `grid` is drawn: "vtk" or "cpu", the ray caster; "" for one that draws itself.

    "auto" takes the `usual` way of a catalog.  Without one volumes are cast, which took from a third to all of VTK's time
    on software OpenGL, and isosurfaces are VTK's.  What can't be cast here is VTK's.

    Raises ValueError for another word, and for "cpu" where the ray caster can't draw `grid`.
    """
    if wanted not in BACKENDS:
        raise ValueError(f"backend must be one of {joined_names(BACKENDS)}, got {wanted!r}")
    if not isinstance(appearance, VolumeRendering | Isosurface):
        return ""
    choice = wanted if wanted != "auto" else usual or ("cpu" if isinstance(appearance, VolumeRendering) else "vtk")
    problem = _problem(grid) if choice == "cpu" else ""
    if problem and wanted == "cpu":
        raise ValueError(f"backend 'cpu' can't draw this field: {problem}; backend 'vtk' can")
    return "vtk" if problem else choice


def _problem(grid: Grid) -> str:
    """A reason why the ray caster can't draw a field, "" without one."""
    nz, ny, nx = grid.shape
    if (nz + 2) * (ny + 2) * (nx + 2) > MOST_SAMPLES:
        return f"it has {nx} x {ny} x {nz} samples, more than {MOST_SAMPLES:,}"
    try:
        from native import kernels  # noqa: F401
    except ImportError as error:
        return str(error)
    return ""
