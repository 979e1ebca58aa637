"""Image metrics: PSNR, PSNR of the foreground, and SSIM, each of one image; means are taken over images.

Images are compared as displayed: composited on the background (white where images have alpha) and clipped to [0, 1].
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from surrogate import kernels

WHITE = (1.0, 1.0, 1.0)
MOST_DECIBELS = 60.0  # identical pictures would make a mean infinite
ALPHA_VISIBLE = 1.0 / 255.0
COLOR_VISIBLE = 2.0 / 255.0

DEFINITIONS = {
    "psnr": "10 log10(1 / mean squared error) over all pixels and channels of one image, on white (or on the data's own "
    f"background), cut to [0, 1], at most {MOST_DECIBELS:.0f} dB; then the mean over images",
    "psnr_foreground": "the same over pixels that are foreground in the truth or in the prediction (alpha > 1/255; opaque "
    "images: more than 2/255 from the background in any channel); images without any are left out and counted",
    "ssim": "Wang et al. 2004: 11x11 Gaussian window of sigma 1.5, K1 0.01, K2 0.03, zeros beyond the border, mean over "
    "pixels and channels of one image; then the mean over images",
}


@dataclass(frozen=True)
class Score:
    """The metrics of one image.

    Attributes
    ----------
    psnr_foreground : nan where neither image has a foreground.
    squared_error : mean over pixels and channels, as in `psnr` but not cut.
    covered : share of the truth's pixels that are foreground.
    """

    psnr: float
    ssim: float
    psnr_foreground: float
    squared_error: float
    covered: float


def composite(rgba: NDArray[Any], background: Sequence[float]) -> NDArray[np.float32]:
    """Premultiplied RGBA (H, W, 4) on a background colour, clipped to [0, 1]: (H, W, 3) float32."""
    pixels = rgba.astype(np.float32) / 255.0 if rgba.dtype == np.uint8 else rgba
    behind = np.asarray(background, dtype=np.float32)
    return np.clip(pixels[..., :3] + (1.0 - pixels[..., 3:]) * behind, 0.0, 1.0).astype(np.float32)


def decibels(squared_error: float, most: float = MOST_DECIBELS) -> float:
    """PSNR in dB of a mean squared error for values in [0, 1], at most `most`."""
    return -10.0 * math.log10(max(squared_error, 10.0 ** (-most / 10.0)))


def psnr(truth: NDArray[np.float32], prediction: NDArray[np.float32]) -> float:
    """PSNR in dB of two images of equal shape with values in [0, 1]."""
    return decibels(mean_squared_error(truth, prediction))


def mean_squared_error(truth: NDArray[np.float32], prediction: NDArray[np.float32]) -> float:
    """Mean squared error over all pixels and channels of two images of equal shape."""
    difference = truth.astype(np.float64) - prediction
    return float(np.mean(difference * difference))


def ssim(truth: NDArray[np.float32], prediction: NDArray[np.float32]) -> float:
    """Mean structural similarity of two images (H, W, C); see `DEFINITIONS`."""
    shown, wanted = (np.ascontiguousarray(image, dtype=np.float32) for image in (prediction, truth))
    _, similarity, _ = kernels.image_loss(shown, wanted, 1.0, 1)
    return float(similarity)


def foreground(rgba: NDArray[Any], background: Sequence[float] | None) -> NDArray[np.bool_]:
    """Mask (H, W) of the pixels that show something; `background` is None where alpha decides."""
    pixels = rgba.astype(np.float32) / 255.0 if rgba.dtype == np.uint8 else rgba
    if background is None:
        return pixels[..., 3] > ALPHA_VISIBLE + 1e-6
    return (np.abs(pixels[..., :3] - np.asarray(background, dtype=np.float32)) > COLOR_VISIBLE + 1e-6).any(axis=-1)


def score(truth: NDArray[Any], prediction: NDArray[Any], background: Sequence[float] | None) -> Score:
    """Compare premultiplied RGBA images (H, W, 4), uint8 or float32.

    `background` is the colour behind opaque images, None where images have alpha.
    """
    true, predicted = (composite(picture, background or WHITE) for picture in (truth, prediction))
    covered = foreground(truth, background)  # [H, W]
    shown = covered | foreground(prediction, background)  # [H, W]
    inside = psnr(true[shown], predicted[shown]) if shown.any() else math.nan
    error = mean_squared_error(true, predicted)
    return Score(decibels(error), ssim(true, predicted), inside, error, float(covered.mean()))
