"""Fields, appearances and cameras, ordinary and hostile, that rays are cast through."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from catalogs.vocabulary.appearance import TransferFunction, VolumeRendering
from catalogs.vocabulary.cameras import Camera, orbit
from native.ray_casting.fields import SampledField

RAINBOW = ((-1.0, 0.1, 0.2, 0.9), (-0.2, 0.2, 0.8, 0.8), (0.3, 0.9, 0.9, 0.1), (1.0, 0.9, 0.1, 0.0))
SMOOTH = TransferFunction(RAINBOW, ((-1.0, 0.0), (0.0, 0.1), (1.0, 0.8)), 0.4)
PEAKS = TransferFunction(
    RAINBOW[1:3],
    ((-0.5, 0.02), (-0.35, 0.02), (-0.3, 0.9), (-0.25, 0.02), (0.4, 0.02), (0.44, 0.95), (0.48, 0.05)),
    0.3,
)
CLEAR = TransferFunction(RAINBOW, ((0.3, 0.0), (0.5, 0.7), (0.7, 0.0)), 0.2)  # most is empty
OPAQUE = TransferFunction(RAINBOW, ((-1.0, 0.0), (0.2, 0.0), (0.25, 1.0)), 0.05)
MANY = TransferFunction(  # more knots than fit registers, some of which single precision does not tell apart
    tuple((v, 0.5 + 0.5 * np.sin(9 * v), 0.5 + 0.5 * np.cos(7 * v), v * v) for v in np.linspace(-0.9, 0.9, 70)),
    (
        *((v, 0.3 + 0.3 * np.sin(20 * v)) for v in np.linspace(-1, 0.1, 60)),
        (0.1 + 1e-12, 0.9),
        (0.2, 0.0),
        (0.2 + 1e-9, 0.5),
    ),
    0.5,
)


def gyroid() -> SampledField:
    """Of amplitude 1, 24 x 28 x 32 samples, spacings 1 : 1.2 : 0.8, off the origin."""
    z, y, x = np.mgrid[0:32, 0:28, 0:24] * np.array([0.08, 0.12, 0.1]).reshape(3, 1, 1, 1)
    a, b, c = 2.2 * x, 2.0 * y, 2.4 * z
    field = (np.sin(a) * np.cos(b) + np.sin(b) * np.cos(c) + np.sin(c) * np.cos(a)) / 1.5
    return SampledField(field.astype(np.float32), None, (0.1, 0.12, 0.08), (-3.0, 5.0, 1.0))


def seen(field: SampledField, size: int = 48, view: int = 17, height: int | None = None) -> Camera:
    """One of the cameras around a field."""
    half = (field.size - 1) * field.spacing / 2
    return orbit(half + field.origin, float(np.linalg.norm(half)), width=size, height=height or size, frequency=2)[view]


def inside(field: SampledField, size: int = 48) -> Camera:
    middle = (field.size - 1) * field.spacing * [0.4, 0.45, 0.6] + field.origin
    return Camera.look_at(
        middle, middle + np.array([0.3, 1.0, 0.2]), vertical_fov_degrees=80.0, width=size, height=size
    )


def far_away(field: SampledField, distance: float = 1e7, size: int = 24) -> Camera:
    """From 1e16 on double precision no longer resolves the box."""
    middle = (field.size - 1) * field.spacing / 2 + field.origin
    place = middle + distance * np.array([0.5, -0.7, 0.4])
    return Camera.look_at(place, middle, vertical_fov_degrees=200 / distance, width=size, height=size)


def with_values(values: NDArray[np.floating], holes: NDArray[np.bool_] | None = None) -> SampledField:
    return replace(gyroid(), values=values, holes=holes)


def punctured() -> SampledField:
    values = gyroid().values.copy()
    values[5:26, 8:20, 6:14], values[20, 20, 20], values[0, 0, :] = np.nan, np.inf, np.nan
    return with_values(values, ~np.isfinite(values))


@dataclass(frozen=True, eq=False)
class CastCase:
    """One image.

    Attributes
    ----------
    distance : between samples, smallest spacings.
    rendered : true where VTK draws it alike: from inside a box, VTK leaves out the first thousandth of the depth, and its
        compiler takes few knots.
    """

    field: SampledField
    transfer: TransferFunction
    camera: Camera
    distance: float = 0.5
    shaded: bool = False
    rendered: bool = True

    @property
    def appearance(self) -> VolumeRendering:
        return VolumeRendering("dvr", self.transfer, self.shaded)

    @property
    def sample_distance(self) -> float:
        """World units."""
        return self.distance * min(self.field.spacing)


def cast_cases() -> dict[str, CastCase]:
    """By a name that says what is special."""
    field = gyroid()
    camera = seen(field)
    outlying = field.values.copy()
    outlying[10, 10, 10], outlying[20, 14, 12] = 1e30, -1e30
    narrow = with_values((1e-5 * field.values + 0.5).astype(np.float32))
    thin = SampledField(np.linspace(-1, 1, 8, dtype=np.float32).reshape(2, 2, 2), None, (0.5, 1.0, 2.0))
    shifted = replace(camera, cx=camera.cx + 9.3, cy=camera.cy - 4.1, fx=camera.fx * 1.7)
    away = Camera.look_at(
        camera.position, 2 * camera.position - field.origin, vertical_fov_degrees=30, width=9, height=7
    )
    return {
        "smooth": CastCase(field, SMOOTH, camera),
        "smooth, shaded": CastCase(field, SMOOTH, camera, shaded=True),
        "peaks": CastCase(field, PEAKS, camera, 0.3),
        "peaks, shaded": CastCase(field, PEAKS, seen(field, view=3), shaded=True),
        "mostly empty": CastCase(field, CLEAR, camera),
        "opaque": CastCase(field, OPAQUE, camera),
        "many knots": CastCase(field, MANY, camera, rendered=False),
        "holes": CastCase(punctured(), SMOOTH, camera),
        "holes, shaded": CastCase(punctured(), PEAKS, camera, shaded=True),
        "camera inside": CastCase(field, SMOOTH, inside(field), rendered=False),
        "camera inside, mostly empty": CastCase(field, CLEAR, inside(field), rendered=False),
        "principal point off the centre": CastCase(field, SMOOTH, shifted),
        "a wide image": CastCase(field, CLEAR, seen(field, 61, 30, 27)),
        "one pixel": CastCase(field, SMOOTH, seen(field, 1)),
        "looking away": CastCase(field, SMOOTH, away),
        "one step": CastCase(field, SMOOTH, camera, 1e9),
        "one cell": CastCase(thin, SMOOTH, seen(thin), 0.2),
        "one cell, shaded": CastCase(thin, SMOOTH, seen(thin), 0.2, shaded=True),
        "constant": CastCase(with_values(np.full((4, 5, 6), 0.5, np.float32)), SMOOTH, camera),
        "constant beyond the function": CastCase(with_values(np.full((4, 5, 6), 1e30, np.float32)), SMOOTH, camera),
        "values far out": CastCase(with_values(outlying), SMOOTH, camera),
        "from far away": CastCase(field, SMOOTH, far_away(field), shaded=True, rendered=False),
        "a narrow range": CastCase(narrow, SMOOTH, camera, shaded=True),
        "float64": CastCase(with_values(field.values.astype(np.float64)), SMOOTH, camera),
    }
