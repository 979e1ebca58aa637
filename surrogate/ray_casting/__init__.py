"""Fields drawn along rays by C++ kernels: the images of `render`, without VTK, and their gradients."""

from surrogate.ray_casting.cuts import Cut
from surrogate.ray_casting.differentiable import volume_image
from surrogate.ray_casting.distances import fitting_distance
from surrogate.ray_casting.fields import SampledField
from surrogate.ray_casting.isosurface import SurfaceCaster, draw_isosurface
from surrogate.ray_casting.volume import VolumeCaster, draw_volume

__all__ = [
    "Cut",
    "SampledField",
    "SurfaceCaster",
    "VolumeCaster",
    "draw_isosurface",
    "draw_volume",
    "fitting_distance",
    "volume_image",
]
