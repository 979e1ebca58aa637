"""Several samples in a pixel: a finer picture is drawn, and each pixel is the mean of its own.

A Gaussian is seen where the centre of a pixel is, but a picture of a surface is the mean over its pixels.  Where edges are as
sharp as pixels, one sample learns how they fall on the centres of the views that it is trained on, and others look worse.
"""

from __future__ import annotations

from torch import Tensor

from catalogs.vocabulary.cameras import Camera

MOST_SAMPLES = 4  # along a side: the finer picture takes the square of it of the memory


def finer(camera: Camera, samples: int) -> Camera:
    """The same view with `samples` pixels for each, along each side."""
    return camera if samples == 1 else camera.resized(samples * camera.width, samples * camera.height)


def averaged(picture: Tensor, samples: int) -> Tensor:
    """Means (H, W) or (H, W, C) of squares of `samples` pixels a side of a picture (H * samples, W * samples) or with C channels.

    Differentiable.  Sums of slices, since torch's mean over both axes takes ten times as long.
    """
    if samples == 1:
        return picture
    height, width = picture.shape[0] // samples, picture.shape[1] // samples
    rows = picture.reshape(height, samples, -1)  # [H, S, W * S * C]
    columns = _sum(rows).reshape(height * width, samples, -1)  # [H * W, S, C]
    return (_sum(columns) / samples**2).reshape(height, width, *picture.shape[2:])


def _sum(numbers: Tensor) -> Tensor:
    """Over the second of three axes."""
    first, *others = numbers.unbind(1)
    for other in others:
        first = first + other
    return first
