"""One scalar field as simulations and readers hand it over."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray


@dataclass(frozen=True, eq=False)
class Field:
    """One scalar field on a uniform grid of point samples, ready to render.

    Attributes
    ----------
    values : (nz, ny, nx) float32.
    spacing, origin : of the points, in (x, y, z) order and world units; point (i, j, k) lies at
        ``origin + (i, j, k) * spacing`` and holds ``values[k, j, i]``.
    name, unit : of the quantity ("" where unknown or dimensionless).
    time : simulation time; None where unknown.

    Examples
    --------
    >>> import insitu
    >>> from blobs import simulate
    >>> from render import to_grid
    >>> field = insitu.Field(simulate(0.8, 0.3), spacing=(2 / 23,) * 3, origin=(-1, -1, -1), name="density", time=0.5)
    >>> to_grid(field).shape
    (24, 24, 24)
    """

    values: NDArray[np.float32]  # [nz, ny, nx]
    spacing: tuple[float, float, float]
    origin: tuple[float, float, float]
    name: str = ""
    unit: str = ""
    time: float | None = None

    def __repr__(self) -> str:
        nz, ny, nx = self.values.shape
        low, high = float(self.values.min()), float(self.values.max())
        unit = f" {self.unit}" if self.unit else ""
        time = "" if self.time is None else f", t = {self.time:g}"
        return f"Field({self.name} on {nx} x {ny} x {nz} points, {low:.4g} to {high:.4g}{unit}{time})"
