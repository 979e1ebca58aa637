"""The directions and distances from which stored images look at the volume, and whether another camera lies within them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from catalogs.vocabulary.cameras import Camera
from surrogate.evaluation.scoring import spread

# A picture in which the same errors fill 1.2 times the width has a PSNR that is 20 log10(1.2) = 1.6 dB lower.
FACTOR = 1.2  # nearer or farther than any stored camera
ASIDE = 0.25  # of half of the picture's shorter side: how far the volume may stand off the centre, beside that of stored ones
LEAST_ANGLE = math.radians(1.0)  # between views that are the same
MOST_CAMERAS = 5000


@dataclass(frozen=True, eq=False, repr=False)
class Views:
    """The stored cameras, seen from the volume's middle.

    Attributes
    ----------
    middle : (3,) world coordinates.
    distances : smallest and largest, from the camera's plane to the middle, world units.
    sizes : smallest and largest, half of what the picture's shorter side shows at the middle, world units.
    aside : the largest share of that by which the middle stands off the picture's centre.
    gap : the largest angle between the direction of a camera and that of its nearest neighbour, radians.
    """

    middle: NDArray[np.float64]
    distances: tuple[float, float]
    sizes: tuple[float, float]
    aside: float
    gap: float
    _tree: KDTree  # of unit vectors towards the cameras

    @classmethod
    def of(cls, cameras: Sequence[Camera], middle: NDArray[np.float64]) -> Views | None:
        """Those of the cameras that look towards the middle, evenly chosen ones of very many; None without any."""
        rows = np.array([_view_of(cameras[i], middle) for i in spread(len(cameras), MOST_CAMERAS)])  # [K, 6]
        rows = rows[rows[:, 3] > 0] if len(rows) else rows.reshape(0, 6)
        if not len(rows):
            return None
        directions = np.unique(rows[:, :3].round(6), axis=0)  # [D, 3]
        tree = KDTree(directions)
        steps = tree.query(directions, k=2)[0][:, 1] if len(directions) > 1 else np.zeros(1)
        low, high = rows[:, 3:].min(axis=0).tolist(), rows[:, 3:].max(axis=0).tolist()
        return cls(middle, (low[0], high[0]), (low[1], high[1]), high[2], _angle(float(steps.max())), tree)

    def to_json(self) -> dict[str, Any]:
        """JSON values by attribute, with the `directions` (D, 3) from the middle towards the cameras."""
        directions = np.asarray(self._tree.data).round(6).tolist()
        ranges = {"distances": list(self.distances), "sizes": list(self.sizes)}
        return {
            "middle": self.middle.tolist(),
            **ranges,
            "aside": self.aside,
            "gap": self.gap,
            "directions": directions,
        }

    def cover(self, camera: Camera) -> bool:
        """True if some stored camera sees about what `camera` sees."""
        *direction, distance, size, aside = _view_of(camera, self.middle)
        if distance <= 0:  # it looks away
            return False
        nearer = min(distance / self.distances[0], size / self.sizes[0]) < 1.0 / FACTOR
        farther = max(distance / self.distances[1], size / self.sizes[1]) > FACTOR
        apart = _angle(float(self._tree.query(direction)[0]))
        return not (nearer or farther or aside > self.aside + ASIDE or apart > max(self.gap, LEAST_ANGLE) + 1e-6)


def _view_of(camera: Camera, middle: NDArray[np.float64]) -> tuple[float, ...]:
    """Unit vector towards the camera (3), distance, half of the shorter side at that distance, and the share aside."""
    towards = camera.rotation @ middle + camera.world_to_camera[:3, 3]  # [3], in camera axes
    away = -(camera.rotation.T @ towards) / max(float(np.linalg.norm(towards)), 1e-300)  # [3]
    distance = float(towards[2])
    size = distance * min(camera.width / camera.fx, camera.height / camera.fy) / 2.0
    return (*away.tolist(), distance, size, float(np.hypot(*towards[:2])) / size if size > 0 else math.inf)


def _angle(chord: float) -> float:
    """Between unit vectors that lie so far from each other."""
    return 2.0 * math.asin(min(1.0, chord / 2.0))
