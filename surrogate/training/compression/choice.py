"""What was chosen, from which options, and what it cost or saved."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass


@dataclass(frozen=True)
class Option:
    """One thing that was tried: `psnr` is the mean over validation images in dB."""

    name: str
    psnr: float


@dataclass(frozen=True)
class Measured:
    """A model at one moment: mean PSNR over validation images, 10^6 bytes of tensors, milliseconds to deform and draw."""

    psnr: float
    megabytes: float
    milliseconds: float


@dataclass(frozen=True)
class Choice:
    """What was to be chosen, what was kept (in words), what was tried in order, and the model before and after."""

    name: str
    kept: str
    options: Sequence[Option] = ()
    before: Measured | None = None
    after: Measured | None = None
