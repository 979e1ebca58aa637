"""Metrics against scikit-image, and the rules that the numbers stand on."""

from __future__ import annotations

import math

import numpy as np
import pytest
from skimage.metrics import peak_signal_noise_ratio

from surrogate.evaluation.metrics import MOST_DECIBELS, composite, decibels, foreground, psnr, score, ssim
from surrogate.training.losses import structural_similarity


def picture(seed: int = 0) -> np.ndarray:
    random = np.random.default_rng(seed)
    alpha = random.random((20, 24, 1)).astype(np.float32)
    return np.concatenate([random.random((20, 24, 3)).astype(np.float32) * alpha, alpha], axis=2)


def test_psnr_is_that_of_scikit_image() -> None:
    a, b = picture(0)[..., :3], picture(1)[..., :3]
    assert psnr(a, b) == pytest.approx(peak_signal_noise_ratio(a, b, data_range=1.0), abs=1e-4)


def test_ssim_is_that_of_the_readable_twin() -> None:
    import torch

    a, b = picture(0)[..., :3], picture(1)[..., :3]
    twin = structural_similarity(torch.from_numpy(b).double(), torch.from_numpy(a).double()).mean()
    assert ssim(a, b) == pytest.approx(float(twin), abs=1e-5)


def test_identical_pictures_are_capped() -> None:
    result = score(picture(), picture(), None)
    assert result.psnr == result.psnr_foreground == MOST_DECIBELS
    assert result.ssim == pytest.approx(1.0, abs=1e-6)
    assert decibels(0.0) == MOST_DECIBELS


def test_pictures_are_composited_on_white_and_cut() -> None:
    pixels = np.array([[[0, 0, 0, 0], [255, 0, 0, 255], [64, 0, 0, 128]]], dtype=np.uint8)
    shown = composite(pixels, (1.0, 1.0, 1.0))
    assert shown[0, 0].tolist() == [1.0, 1.0, 1.0]
    assert shown[0, 1].tolist() == [1.0, 0.0, 0.0]
    assert shown[0, 2] == pytest.approx([64 / 255 + 127 / 255, 127 / 255, 127 / 255], abs=1e-6)
    assert composite(np.full((1, 1, 4), 2.0, np.float32), (1.0, 1.0, 1.0)).max() == 1.0


def test_empty_frames_win_nothing() -> None:
    empty = np.zeros((8, 8, 4), np.uint8)
    assert math.isnan(score(empty, empty, None).psnr_foreground)
    one = empty.copy()
    one[0, 0] = (0, 0, 0, 255)
    result = score(one, empty, None)
    assert result.psnr_foreground == pytest.approx(0.0, abs=1e-6)  # black against white, in the one pixel that counts
    assert result.psnr == pytest.approx(10 * math.log10(64.0), abs=1e-4)


def test_the_foreground_of_opaque_pictures_is_what_differs_from_the_background() -> None:
    pixels = np.full((4, 4, 4), 255, np.uint8)
    pixels[1, 2, 1] = 252
    pixels[3, 3, 0] = 254
    shown = foreground(pixels, (1.0, 1.0, 1.0))
    assert np.argwhere(shown).tolist() == [[1, 2]]
