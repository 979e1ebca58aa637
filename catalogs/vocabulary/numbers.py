"""Validation of numbers from users and files."""

from __future__ import annotations

import math
import sys
from collections.abc import Iterable
from reprlib import repr as shortened
from typing import Any


def finite(value: Any, what: str) -> float:
    """`value` as a float, from a number of Python or numpy, or an array or tensor of shape ().

    Raises ValueError naming `what` for text, truth values, arrays of other shapes, NaN and infinity.
    """
    if type(value) is float and math.isfinite(value):
        return value
    shape, form = getattr(value, "shape", ()), str(getattr(value, "dtype", ""))
    wrong = (
        isinstance(value, str | bytes | bytearray | bool) or "bool" in form or "complex" in form or tuple(shape) != ()
    )
    try:
        number = math.nan if wrong else float(value)
    except (TypeError, ValueError, OverflowError):
        number = math.nan
    if not math.isfinite(number):
        raise ValueError(f"{what} must be a finite number, got {shortened(value)}")
    return number


def text(value: float, width: float = 0.0, least: int = 6) -> str:
    """`value` in as few digits as tell it from its neighbours, `least` or more.

    Neighbours are a hundred-thousandth of `width` away, the range of a parameter; without one, a trillionth of the value.
    """
    if not math.isfinite(value) or value == 0.0:
        return f"{value:g}"
    apart = min(width, sys.float_info.max)
    digits = least - 1 + math.ceil(math.log10(abs(value)) - math.log10(apart)) if width > 0.0 else 12
    longest = f"{value:.{max(least, min(digits, 17))}g}"
    shortest = f"{value:.{least}g}"
    return shortest if float(shortest) == float(longest) else longest


def texts(values: Iterable[float], least: int = 6) -> list[str]:
    """Numbers in as few digits as tell all that differ apart and from their neighbours, see `text`."""
    numbers = list(values)
    width, count = max(numbers, default=0.0) - min(numbers, default=0.0), len(set(numbers))
    for digits in range(least, 18):
        candidates = [text(value, width or abs(value), digits) for value in numbers]
        if len(set(candidates)) == count:
            break
    return candidates


def positive(value: Any, what: str) -> float:
    """A finite number above zero."""
    number = finite(value, what)
    if number <= 0.0:
        raise ValueError(f"{what} must be positive, got {number:g}")
    return number


def fraction(value: Any, what: str) -> float:
    """A number in [0, 1]."""
    number = finite(value, what)
    if not 0.0 <= number <= 1.0:
        raise ValueError(f"{what} must lie in [0, 1], got {number:g}")
    return number


def count(value: Any, what: str) -> int:
    """A whole number from 1 on."""
    number = finite(value, what)
    if number != int(number) or number < 1:
        raise ValueError(f"{what} must be a whole number, at least 1, got {number:g}")
    return int(number)


def decibels(value: Any, what: str) -> float:
    """A PSNR that pictures of 8 bits can reach: above 0, at most 58 dB."""
    number = finite(value, what)
    if not 0.0 < number <= 58.0:
        raise ValueError(f"{what} must lie between 0 and 58, what 8-bit images can hold, got {number:g}")
    return number


def row(values: Any, length: int, what: str) -> tuple[float, ...]:
    """`length` finite numbers: a sequence, or a numpy array of shape (length,)."""
    if isinstance(values, str | bytes) or not isinstance(values, Iterable):
        raise ValueError(f"{what} must be {length} numbers, got {shortened(values)}")
    numbers = list(values)
    if len(numbers) != length:
        raise ValueError(f"{what} must be {length} numbers, got {len(numbers)}: {shortened(values)}")
    return tuple(finite(number, what) for number in numbers)


def color(values: Any, what: str) -> tuple[float, ...]:
    """Red, green and blue in [0, 1]."""
    return tuple(fraction(value, what) for value in row(values, 3, f"{what}, red, green and blue in [0, 1],"))
