"""Supersampling: a finer image is rendered, and each pixel is the mean of its samples.

A rendered Gaussian is sampled at pixel centres, but an image of a surface is the mean over its pixels. Where edges are
as sharp as pixels, one sample fits the pixel centres of the training views, and other views look worse.
"""

from __future__ import annotations

from torch import Tensor

from catalogs.vocabulary.cameras import Camera


def finer(camera: Camera, samples: int) -> Camera:
    """The same view with `samples` pixels for each, along each side."""
    return camera if samples == 1 else camera.resized(samples * camera.width, samples * camera.height)


def averaged(picture: Tensor, samples: int) -> Tensor:
    """Means (H, W) or (H, W, C) of squares of `samples` pixels a side of an image (H * samples, W * samples[, C]).

    Differentiable. Slices are summed, since torch's mean over both axes takes ten times as long.
    """
    if samples == 1:
        return picture
    height, width = picture.shape[0] // samples, picture.shape[1] // samples
    rows = picture.reshape(height, samples, -1)  # [H, S, W * S * C]
    columns = _sum(rows).reshape(height * width, samples, -1)  # [H * W, S, C]
    return (_sum(columns) / samples**2).reshape(height, width, *picture.shape[2:])


def _sum(numbers: Tensor) -> Tensor:
    """The sum over the second of three axes."""
    first, *others = numbers.unbind(1)
    for other in others:
        first = first + other
    return first
