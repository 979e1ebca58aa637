"""Choices of compression with their options, costs and savings."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass


@dataclass(frozen=True)
class Option:
    """One thing that was tried: `psnr` is the mean over validation images in dB."""

    name: str
    psnr: float


@dataclass(frozen=True)
class MeasuredModel:
    """A model at one moment: mean PSNR over validation images, 10^6 bytes of tensors, milliseconds to deform and draw."""

    psnr: float
    megabytes: float
    milliseconds: float


@dataclass(frozen=True)
class Choice:
    """A choice: its name, its result in words, the options in the order of trial, and the model before and after."""

    name: str
    kept: str
    options: Sequence[Option] = ()
    before: MeasuredModel | None = None
    after: MeasuredModel | None = None
