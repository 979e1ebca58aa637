"""Warnings at the line that called into this package."""

from __future__ import annotations

import sys
import warnings
from types import FrameType


def warn_caller(note: Warning) -> None:
    """Warn of `note` at the line that called into this package, however deep the call."""
    frame: FrameType | None = sys._getframe()
    level = 1
    while frame is not None and frame.f_globals.get("__name__", "").startswith("insitu."):
        frame, level = frame.f_back, level + 1
    warnings.warn(note, stacklevel=level)
