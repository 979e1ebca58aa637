"""Fields drawn along rays with gradients by torch, and the reference implementation of `native.ray_casting`."""

from surrogate.ray_casting.differentiable import volume_image

__all__ = ["volume_image"]
