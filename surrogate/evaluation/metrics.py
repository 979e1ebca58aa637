"""Image metrics: PSNR, PSNR of the foreground, and SSIM, each of one image; means are taken over images.

Images are compared as displayed: composited on the background (white where images have alpha) and clipped to [0, 1].
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from native import kernels

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
    through = 1.0 - pixels[..., 3]  # [H, W]
    image = np.empty((*through.shape, 3), np.float32)
    for channel, behind in enumerate(np.asarray(background, dtype=np.float32)):  # far faster than rows of three
        color = through * behind
        color += pixels[..., channel]
        np.clip(color, 0.0, 1.0, out=image[..., channel])
    return image


def decibels(squared_error: float, most: float = MOST_DECIBELS) -> float:
    """PSNR in dB of a mean squared error for values in [0, 1], at most `most`."""
    return -10.0 * math.log10(max(squared_error, 10.0 ** (-most / 10.0)))


def psnr(truth: NDArray[np.float32], prediction: NDArray[np.float32]) -> float:
    """PSNR in dB of two images of equal shape with values in [0, 1]."""
    return decibels(mean_squared_error(truth, prediction))


def mean_squared_error(truth: NDArray[np.float32], prediction: NDArray[np.float32]) -> float:
    """Mean squared error over all pixels and channels of two images of equal shape."""
    return float(np.mean(_squares(truth, prediction)))


def ssim(truth: NDArray[np.float32], prediction: NDArray[np.float32]) -> float:
    """Mean structural similarity of two images (H, W, C); see `DEFINITIONS`."""
    predicted, wanted = (np.ascontiguousarray(image, dtype=np.float32) for image in (prediction, truth))
    _, similarity, _ = kernels.image_loss(predicted, wanted, 1.0, 1)
    return float(similarity)


def foreground(rgba: NDArray[Any], background: Sequence[float] | None) -> NDArray[np.bool_]:
    """Mask (H, W) of the pixels that show something; `background` is None where alpha decides."""
    pixels = rgba.astype(np.float32) / 255.0 if rgba.dtype == np.uint8 else rgba
    if background is None:
        return pixels[..., 3] > ALPHA_VISIBLE + 1e-6
    return (np.abs(pixels[..., :3] - np.asarray(background, dtype=np.float32)) > COLOR_VISIBLE + 1e-6).any(axis=-1)


@dataclass(frozen=True, eq=False)
class TrueImage:
    """An image that predictions are compared with.

    Attributes
    ----------
    picture : premultiplied RGBA (H, W, 4), uint8 or float32.
    background : the colour behind opaque images, None where images have alpha.
    """

    picture: NDArray[Any]
    background: Sequence[float] | None

    @cached_property
    def displayed(self) -> NDArray[np.float32]:
        """As displayed, (H, W, 3)."""
        return self.composite(self.picture)

    @cached_property
    def covered(self) -> NDArray[np.bool_]:
        """Mask (H, W) of its foreground."""
        return foreground(self.picture, self.background)

    def composite(self, prediction: NDArray[Any]) -> NDArray[np.float32]:
        """A prediction as displayed, (H, W, 3)."""
        return composite(prediction, self.background or WHITE)

    def score(self, prediction: NDArray[Any]) -> Score:
        """All metrics of a premultiplied RGBA image (H, W, 4), uint8 or float32."""
        predicted = self.composite(prediction)
        squares = _squares(self.displayed, predicted)  # [H, W, 3]
        inside_pixels = np.flatnonzero(self.covered | foreground(prediction, self.background))
        inside = (
            decibels(float(np.mean(squares.reshape(-1, 3).take(inside_pixels, axis=0))))
            if len(inside_pixels)
            else math.nan
        )
        error = float(np.mean(squares))
        return Score(decibels(error), ssim(self.displayed, predicted), inside, error, float(self.covered.mean()))

    def psnr_alone(self, prediction: NDArray[Any]) -> Score:
        """The PSNR of an image, which is the fastest; other metrics are nan."""
        error = float(np.mean(_squares(self.displayed, self.composite(prediction))))
        return Score(decibels(error), math.nan, math.nan, error, math.nan)


def score(truth: NDArray[Any], prediction: NDArray[Any], background: Sequence[float] | None) -> Score:
    """Compare premultiplied RGBA images (H, W, 4), uint8 or float32; see `TrueImage`."""
    return TrueImage(truth, background).score(prediction)


def _squares(truth: NDArray[np.float32], prediction: NDArray[np.float32]) -> NDArray[np.float64]:
    """Squared differences of two images, of their shape."""
    difference = truth.astype(np.float64)
    difference -= prediction
    difference *= difference
    return difference
