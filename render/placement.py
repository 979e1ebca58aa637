"""The grid's box moved and scaled into the unit sphere at the origin, and cameras with it.

Graphics hardware computes in single precision: boxes 1e22 cm wide or at coordinates of 1e6 m with metre details
would lose pixels or overflow.  Pictures do not depend on where and how large the world is.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from catalogs.vocabulary.cameras import Camera
from render.blocks import Lattice
from render.grids import Grid


@dataclass(frozen=True)
class Placement:
    """The place of a grid inside the unit sphere: local = (world - center) / scale.

    Attributes
    ----------
    center : (3,) world units; the middle of the box.
    scale : world units per local unit; the bounding radius.
    spacing, origin : (3,) local units, of the samples.
    low, high : corners (3,) of the box, local units.
    """

    center: NDArray[np.float64]
    scale: float
    spacing: NDArray[np.float64]
    origin: NDArray[np.float64]
    low: NDArray[np.float64]
    high: NDArray[np.float64]

    @classmethod
    def of(cls, grid: Grid, whole: Lattice | None = None) -> Placement:
        """The placement of `grid`; of a block of a `whole`, with whose box in the unit sphere."""
        low, high = grid.bounds if whole is None else whole.bounds
        center, radius = (low + high) / 2, float(np.linalg.norm(high - low)) / 2
        origin = (np.array(grid.origin) - center) / radius
        half = (high - low) / 2 / radius
        return cls(center, radius, np.array(grid.spacing) / radius, -half if whole is None else origin, -half, half)

    def local(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """World points (..., 3) in local units."""
        return (points - self.center) / self.scale

    def camera(self, camera: Camera) -> Camera:
        """The camera that sees the local box as `camera` sees the world's."""
        matrix = camera.world_to_camera.copy()
        matrix[:3, 3] = (camera.rotation @ self.center + camera.world_to_camera[:3, 3]) / self.scale
        return Camera(matrix, camera.fx, camera.fy, camera.cx, camera.cy, camera.width, camera.height)

    def clipping_range(self, camera: Camera) -> tuple[float, float]:
        """(near, far) distances, local units, around what lies in front of the local `camera`."""
        corners = np.array([[(self.low, self.high)[b >> k & 1][k] for k in range(3)] for b in range(8)])  # [8, 3]
        depths = camera.project(corners)[1]  # [8]
        far = max(float(depths.max()) + 1e-3, 1e-3)
        return max(float(depths.min()) - 1e-3, 1e-4 * far), far
