"""Floating-point traps of the calling thread, off while this package works: VTK and Mesa divide by zero on purpose."""

from __future__ import annotations

import ctypes
from collections.abc import Iterator
from contextlib import contextmanager

ENVIRONMENT_BYTES = 256  # more than a fenv_t of any platform


@contextmanager
def no_traps() -> Iterator[None]:
    """Traps are off meanwhile, for threads that start too, and then as before.

    A simulation sets them by -ffpe-trap or feenableexcept, in a program that calls Python or is called by it.
    """
    try:
        mathematics = ctypes.CDLL(None)
        hold, restore = mathematics.feholdexcept, mathematics.fesetenv
    except (AttributeError, OSError, TypeError):  # no such functions here
        yield
        return
    environment = ctypes.create_string_buffer(ENVIRONMENT_BYTES)
    hold(environment)
    try:
        yield
    finally:
        restore(environment)
