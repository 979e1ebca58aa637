"""Numbers as Fortran prints them: 0.1584-100 where an exponent of three digits leaves no room for its letter, and 1.5D+00.

A point is needed: 100-200 is a range.
"""

from __future__ import annotations

import re

WORD = re.compile(r"\s*[-+]?\d*\.\d*(?:[dDqQ][-+]?\d+|[-+]\d{3})\s*")
EXPONENT = re.compile(rb"(\.\d*)(?:[dDqQ]([-+]?\d+)|([-+]\d{3}))(?![\d.])")


def printed_number(word: str) -> float:
    """The value of a printed number; raises ValueError as float does."""
    return float(spelled(word))


def spelled(word: str) -> str:
    """A number with E before its exponent; other words as they are."""
    return respelled(word.encode()).decode() if WORD.fullmatch(word) else word


def respelled(line: bytes) -> bytes:
    """A line of numbers with E before their exponents."""
    return EXPONENT.sub(lambda match: match[1] + b"E" + (match[2] or match[3]), line)
