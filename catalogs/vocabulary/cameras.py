"""Pinhole cameras in OpenCV axes, and the fixed set of viewpoints around a volume.

A camera maps world points to pixels by the pinhole model (Hartley & Zisserman, "Multiple View Geometry", section 6.1).
With ``(x, y, z)`` in camera axes (x right, y down, z forward), ``u = fx * x / z + cx`` and ``v = fy * y / z + cy``.
The centre of pixel (column i, row j)
lies at ``(i + 0.5, j + 0.5)``.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from itertools import combinations
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from catalogs.vocabulary.numbers import count, finite, positive

OBLIQUE = (0.52, -0.74, 0.43)  # direction to the camera of a first image: in front of the volume, a little above
POLE = 3  # number of the corner (0, -1, phi), where the order of viewpoints begins
CHECKS = {"fx": positive, "fy": positive, "cx": finite, "cy": finite, "width": count, "height": count}
PARALLEL_LIMIT = 0.99  # |direction . up| beyond which another up vector is taken


@dataclass(frozen=True, eq=False)
class Camera:
    """A pinhole camera.

    Attributes
    ----------
    world_to_camera : (4, 4) float64, rigid, world units, OpenCV axes.
    fx, fy : focal lengths in pixels.
    cx, cy : principal point in pixels; the image centre is (width / 2, height / 2).
    width, height : image size in pixels.

    Examples
    --------
    >>> from catalogs import Camera
    >>> camera = Camera.look_at((0, -4, 0), (0, 0, 0), vertical_fov_degrees=30, width=200, height=100)
    >>> pixels, depths = camera.project([[0, 0, 0], [0, 0, 1]])
    >>> pixels.round(1).tolist(), depths.round(1).tolist()
    ([[100.0, 50.0], [100.0, 3.3]], [4.0, 4.0])
    """

    world_to_camera: NDArray[np.float64]  # [4, 4]
    fx: float
    fy: float
    cx: float
    cy: float
    width: int
    height: int

    def __post_init__(self) -> None:
        matrix = np.array(self.world_to_camera, dtype=np.float64)
        if matrix.shape != (4, 4) or not np.isfinite(matrix).all():
            raise ValueError(f"world_to_camera must be a finite 4x4 matrix, got shape {matrix.shape}")
        if not _is_rotation(matrix[:3, :3].tolist()):
            raise ValueError("world_to_camera must hold a rotation (orthonormal, right-handed) in its upper 3x3 block")
        for name, check in CHECKS.items():
            object.__setattr__(self, name, check(getattr(self, name), f"a camera's {name}"))
        matrix.setflags(write=False)
        object.__setattr__(self, "world_to_camera", matrix)

    def __repr__(self) -> str:
        place, toward = (", ".join(f"{x:.4g}" for x in vector) for vector in (self.position, self.forward))
        return f"<Camera at ({place}), looking along ({toward}), {self.width}x{self.height} pixels>"

    @classmethod
    def look_at(
        cls,
        position: ArrayLike,
        target: ArrayLike,
        *,
        vertical_fov_degrees: float,
        width: int,
        height: int,
        up: ArrayLike = (0.0, 0.0, 1.0),
    ) -> Camera:
        """A camera at `position` (3,) looking at `target` (3,), square pixels, centred principal point.

        `up` (3,) points to the top of the image; if the viewing direction is within about 8 degrees of it, +y (then +x) is used.
        """
        position = np.asarray(position, dtype=np.float64)  # [3]
        forward = np.asarray(target, dtype=np.float64) - position  # [3]
        distance = float(np.linalg.norm(forward))
        if not distance > 0:
            raise ValueError(f"position and target coincide at {position.tolist()}")
        forward = forward / distance
        up = upward(forward, up)
        right = np.cross(forward, up)  # [3]
        right /= np.linalg.norm(right)
        rotation = np.stack([right, np.cross(forward, right), forward])  # [3, 3]
        matrix = np.eye(4)
        matrix[:3, :3] = rotation
        matrix[:3, 3] = -rotation @ position
        focal = height / (2.0 * math.tan(math.radians(vertical_fov_degrees) / 2.0))
        return cls(matrix, focal, focal, width / 2.0, height / 2.0, width, height)

    @property
    def rotation(self) -> NDArray[np.float64]:
        """World-to-camera rotation, (3, 3); its rows are right, down and forward in world axes."""
        return self.world_to_camera[:3, :3]

    @property
    def position(self) -> NDArray[np.float64]:
        """Camera centre in world units, (3,)."""
        return -self.rotation.T @ self.world_to_camera[:3, 3]

    @property
    def forward(self) -> NDArray[np.float64]:
        """Unit viewing direction in world axes, (3,)."""
        return self.rotation[2]

    @property
    def up(self) -> NDArray[np.float64]:
        """Unit vector towards the top of the image in world axes, (3,)."""
        return -self.rotation[1]

    @property
    def vertical_fov_degrees(self) -> float:
        """Full vertical field of view, 2 atan(height / 2 fy)."""
        return math.degrees(2.0 * math.atan(self.height / (2.0 * self.fy)))

    def project(self, points: ArrayLike) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Pixel coordinates (N, 2) and depths along `forward` (N,) of world points (N, 3)."""
        points = np.asarray(points, dtype=np.float64)  # [N, 3]
        local = points @ self.rotation.T + self.world_to_camera[:3, 3]  # [N, 3]
        depth = local[:, 2]  # [N]
        with np.errstate(divide="ignore", invalid="ignore"):
            pixels = local[:, :2] / depth[:, None] * [self.fx, self.fy] + [self.cx, self.cy]  # [N, 2]
        return pixels, depth

    def rays(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Origin (3,) and unit directions (height, width, 3), world axes, through every pixel centre."""
        columns = (np.arange(self.width) + 0.5 - self.cx) / self.fx  # [W]
        rows = (np.arange(self.height) + 0.5 - self.cy) / self.fy  # [H]
        local = np.stack(np.broadcast_arrays(columns[None, :], rows[:, None], 1.0), axis=-1)  # [H, W, 3]
        directions = local @ self.rotation  # [H, W, 3]
        return self.position, directions / np.linalg.norm(directions, axis=-1, keepdims=True)

    def resized(self, width: int, height: int) -> Camera:
        """The same view at another image size: intrinsics scale with it."""
        across, down = width / self.width, height / self.height
        return Camera(
            self.world_to_camera, self.fx * across, self.fy * down, self.cx * across, self.cy * down, width, height
        )

    def to_json(self) -> dict[str, Any]:
        """Plain JSON values that `from_json` turns back into the same camera, bit for bit."""
        return {**vars(self), "world_to_camera": self.world_to_camera.tolist()}

    @classmethod
    def from_json(cls, record: Mapping[str, Any]) -> Camera:
        """The camera of a `to_json` record; raises KeyError or ValueError on a malformed one."""
        fx, fy, cx, cy = (float(record[name]) for name in ("fx", "fy", "cx", "cy"))
        return cls(record["world_to_camera"], fx, fy, cx, cy, int(record["width"]), int(record["height"]))


def _is_rotation(rows: list[list[float]]) -> bool:
    """True for three rows that are orthonormal to a thousandth and right-handed; numpy takes five times as long."""
    (a, b, c), (d, e, f), (g, h, i) = rows
    products = (a * d + b * e + c * f, a * g + b * h + c * i, d * g + e * h + f * i)
    squares = (a * a + b * b + c * c, d * d + e * e + f * f, g * g + h * h + i * i)
    wrong = max(*map(abs, products), *(abs(square - 1.0) for square in squares))
    return wrong <= 1e-3 and a * (e * i - f * h) + b * (f * g - d * i) + c * (d * h - e * g) >= 0.0


def upward(direction: ArrayLike, up: ArrayLike = (0.0, 0.0, 1.0)) -> NDArray[np.float64]:
    """`up` (3,), or +y, then +x, where `direction` (3,) is nearly parallel to it."""
    direction = np.asarray(direction, dtype=np.float64)
    for candidate in (up, (0.0, 1.0, 0.0), (1.0, 0.0, 0.0)):
        candidate = np.asarray(candidate, dtype=np.float64)
        candidate = candidate / np.linalg.norm(candidate)
        if abs(float(direction @ candidate)) <= PARALLEL_LIMIT * float(np.linalg.norm(direction)):
            return candidate
    raise ValueError(f"no up vector for direction {direction.tolist()}")


def icosphere(frequency: int = 5) -> NDArray[np.float64]:
    """Unit vectors (10 * frequency**2 + 2, 3): vertices of the geodesic icosahedron.

    Each face of an icosahedron with vertices at the cyclic permutations of (0, +-1, +-phi) is split into
    the square of `frequency` triangles.  They are projected to the sphere (class I geodesic polyhedron; Goldberg 1937).
    Frequency 5 gives the method's 252 viewpoints.  Orientation and order are fixed: ring by ring of edges from the corner
    (0, -1, phi), each ring by azimuth around it.  So the even and the odd viewpoints each cover the sphere evenly: at frequency 5
    no view is further than 14.1 degrees from one of the other half.

    Examples
    --------
    >>> from catalogs import icosphere
    >>> icosphere().shape, icosphere(frequency=2).shape
    ((252, 3), (42, 3))
    """
    if frequency < 1:
        raise ValueError(f"frequency must be at least 1, got {frequency}")
    golden = (1.0 + math.sqrt(5.0)) / 2.0
    signs = [(one, phi) for one in (-1.0, 1.0) for phi in (-golden, golden)]
    corners = np.array([axes for a, b in signs for axes in ((0, a, b), (b, 0, a), (a, b, 0))], dtype=float)  # [12, 3]
    distances = np.linalg.norm(corners[:, None] - corners[None], axis=-1)  # [12, 12]
    adjacent = np.isclose(distances, 2.0)
    cosines = corners @ corners[POLE] / (1.0 + golden**2)  # 1, 0.447, -0.447 or -1
    heights = np.searchsorted([-0.5, 0.0, 0.5], -cosines)  # [12], edges of the icosahedron from the pole
    faces = [[a, b, c] for a, b, c in combinations(range(12), 3) if adjacent[[a, b, a], [b, c, c]].all()]
    shares = np.array([(frequency - i - j, i, j) for i in range(frequency + 1) for j in range(frequency + 1 - i)])
    points = np.concatenate([shares @ corners[face] for face in faces])
    rings = np.concatenate([shares @ heights[face] for face in faces])  # edges of the polyhedron from the pole
    points /= np.linalg.norm(points, axis=1, keepdims=True)
    _, first = np.unique(np.round(points, 9) + 0.0, axis=0, return_index=True)
    points, rings = points[first], rings[first]
    right = np.array([1.0, 0.0, 0.0])
    around = points @ np.stack([right, np.cross(corners[POLE], right)], axis=1)  # [N, 2], as seen from above the pole
    around = np.round(around / [1.0, math.hypot(1.0, golden)], 9) + 0.0
    azimuths = np.round(np.arctan2(around[:, 1], around[:, 0]), 9)
    return points[np.lexsort((azimuths, rings))]


def orbit(
    center: ArrayLike,
    radius: float,
    *,
    width: int,
    height: int,
    fill: float = 0.9,
    vertical_fov_degrees: float = 30.0,
    frequency: int = 5,
) -> list[Camera]:
    """Cameras on the icosphere around a sphere of `radius` (world units) at `center` (3,), looking inwards.

    At their distance the sphere's silhouette fills the fraction `fill` of the shorter side of the frame.

    Examples
    --------
    >>> from catalogs import orbit
    >>> cameras = orbit((0, 0, 0), radius=1.0, width=128, height=128, frequency=2)
    >>> len(cameras)
    42
    """
    if not radius > 0:
        raise ValueError(f"radius must be positive, got {radius}")
    if not 0 < fill <= 1:
        raise ValueError(f"fill must lie in (0, 1], got {fill}")
    half = math.tan(math.radians(vertical_fov_degrees) / 2.0) * min(1.0, width / height)
    distance = radius / math.sin(math.atan(fill * half))
    center = np.asarray(center, dtype=np.float64)
    return [
        Camera.look_at(place, center, vertical_fov_degrees=vertical_fov_degrees, width=width, height=height)
        for place in center + distance * icosphere(frequency)
    ]


def spherical_angles(direction: ArrayLike) -> tuple[float, float]:
    """(phi, theta) in degrees of the unit vector `direction` (3,) from the centre to the camera.

    phi is the azimuth from +x towards +y in (-180, 180]; theta the polar angle from +z in [0, 180].
    """
    x, y, z = np.asarray(direction, dtype=np.float64)
    return math.degrees(math.atan2(y, x)), math.degrees(math.atan2(math.hypot(x, y), z))


def view_splits(count: int) -> list[str]:
    """Split of each viewpoint: even indices test, odd train, every ninth odd one validation."""
    return ["test" if i % 2 == 0 else "validation" if i % 18 == 9 else "train" for i in range(count)]
