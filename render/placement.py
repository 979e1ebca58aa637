"""The grid's box moved and scaled into the unit sphere at the origin, and cameras with it.

Graphics hardware computes in single precision: boxes 1e22 cm wide or at coordinates of 1e6 m with metre details
would lose pixels or overflow.  Pictures do not depend on where and how large the world is.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from catalogs.cameras import Camera
from render.grids import Grid


@dataclass(frozen=True)
class Placement:
    """Where a grid lies inside the unit sphere: local = (world - center) / scale.

    Attributes
    ----------
    center : (3,) world units; the middle of the box.
    scale : world units per local unit; the bounding radius.
    spacing : (3,) local units.
    low, high : corners (3,) of the box, local units.
    """

    center: NDArray[np.float64]
    scale: float
    spacing: NDArray[np.float64]
    low: NDArray[np.float64]
    high: NDArray[np.float64]

    @classmethod
    def of(cls, grid: Grid) -> Placement:
        """The placement of `grid`."""
        low, high = grid.bounds
        half = (high - low) / 2 / grid.bounding_radius
        return cls(grid.center, grid.bounding_radius, np.array(grid.spacing) / grid.bounding_radius, -half, half)

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
