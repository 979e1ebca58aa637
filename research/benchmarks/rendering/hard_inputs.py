"""Fields in extreme units, with extreme offsets and outliers, in worlds of extreme size: tests of single precision."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from catalogs.vocabulary.appearance import Isosurface, TransferFunction, VolumeRendering
from catalogs.vocabulary.cameras import Camera
from render import Grid, render_views, to_grid
from render.quality import psnr
from tests.support.raymarch import march

ISOVALUE, OUTLIER = 5.0, (5, 5, 5)


@dataclass(frozen=True)
class Hard:
    """A change of the field's unit, its zero and the unit of length; `outlier` is added to one sample.

    With `same_unit` the unit distance of opacity stays the same, and the opacity per unit shrinks accordingly.
    """

    scale: float = 1.0
    offset: float = 0.0
    world: float = 1.0
    outlier: float = 0.0
    same_unit: bool = False

    def transfer(self, plain: TransferFunction) -> TransferFunction:
        """The transfer function with the same appearance."""
        colors = tuple((self.scale * v + self.offset, *rgb) for v, *rgb in plain.color_points)
        power = 1.0 / self.world if self.same_unit else 1.0
        opacities = tuple(
            (self.scale * v + self.offset, -math.expm1(power * math.log1p(-o))) for v, o in plain.opacity_points
        )
        return TransferFunction(
            colors, opacities, plain.opacity_unit_distance * (1.0 if self.same_unit else self.world)
        )


HARD = {
    "as it is": Hard(),
    "field + 1e9": Hard(offset=1e9),
    "field - 1e12": Hard(offset=-1e12),
    "field x 1e30": Hard(scale=1e30),
    "field x 1e-30": Hard(scale=1e-30),
    "field x 1e300": Hard(scale=1e300),
    "field x 1e-300": Hard(scale=1e-300),
    "one sample + 1e40": Hard(outlier=1e40),
    "lengths x 1e9": Hard(world=1e9),
    "lengths x 1e-9": Hard(world=1e-9),
    "lengths x 1e9, opacities below 1e-8 a unit": Hard(world=1e9, same_unit=True),
}


def enlarged(camera: Camera, scale: float) -> Camera:
    """The camera in another unit of length."""
    matrix = camera.world_to_camera.copy()
    matrix[:3, 3] *= scale
    return Camera(matrix, camera.fx, camera.fy, camera.cx, camera.cy, camera.width, camera.height)


def hard_inputs(grid: Grid, plain: TransferFunction, camera: Camera) -> list[list[str]]:
    """Rows: input, dB of volume, lit volume and isosurface against the float64 ray-marcher or the surface of the field as it is."""
    surface, rows = Isosurface("surface", ISOVALUE), []
    for name, hard in HARD.items():
        values = hard.scale * grid.values.astype(np.float64) + hard.offset
        ordinary = grid.values.copy()
        values[OUTLIER] += hard.outlier
        ordinary[OUTLIER] += min(hard.outlier, 1e6)
        expected = next(render_views(Grid(ordinary, grid.spacing, grid.origin), surface, [camera], float_output=True))
        world = [tuple(hard.world * np.array(place)) for place in (grid.spacing, grid.origin)]
        field, seen = to_grid(values, spacing=world[0], origin=world[1]), enlarged(camera, hard.world)
        transfer, distance = hard.transfer(plain), min(field.spacing) / 2
        cells = []
        for shaded in (False, True):
            volume = VolumeRendering("hard", transfer, shaded)
            picture = next(render_views(field, volume, [seen], sample_distance=distance, float_output=True))
            cells.append(psnr(picture, march(field, volume, seen, distance)))
        isovalue = hard.scale * surface.isovalue + hard.offset
        pictures = render_views(field, replace(surface, isovalue=isovalue), [seen], float_output=True)
        cells.append(min(psnr(next(pictures), expected), 150.0))
        rows.append([name, *(f"{decibels:.0f}" for decibels in cells)])
    return rows
