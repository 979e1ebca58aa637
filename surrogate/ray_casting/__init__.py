"""Fields drawn along rays by C++ kernels: the images of `render`, without VTK."""

from surrogate.ray_casting.volume import VolumeCaster, draw_volume

__all__ = ["VolumeCaster", "draw_volume"]
