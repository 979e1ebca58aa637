"""Memory that two processes share without a name, and arrays that lie in it.

It is freed when both processes are gone, however they end.  It is anonymous, so nothing is left in /dev/shm and that folder's
size limit does not apply.
"""

from __future__ import annotations

import io
import mmap
import os
import pickle
import tempfile
from typing import Any

import numpy as np
from numpy.typing import NDArray

SMALLEST = 4096  # bytes; what is smaller travels with the rest
ALIGNED = 64  # bytes
PART = 1 << 22  # bytes
AT_ONCE = 1 << 30  # Linux writes no more than 2 GiB in one call


def new_memory() -> int:
    """A descriptor of memory, empty as yet."""
    if hasattr(os, "memfd_create"):
        return os.memfd_create("insitu")
    with tempfile.TemporaryFile() as file:  # has no name either
        return os.dup(file.fileno())


def pack(value: Any, memory: int) -> bytes:
    """Copy the arrays in `value` into `memory`, once; returns all else, from which `unpack` makes it again.

    Raises OSError where there is no memory left.
    """
    stream = io.BytesIO()
    _Packer(stream, memory).dump(value)
    return stream.getvalue()


def unpack(data: bytes, memory: int) -> Any:
    """The packed value; its arrays lie in `memory`, and may only be read."""
    size = os.fstat(memory).st_size
    return _Unpacker(io.BytesIO(data), mmap.mmap(memory, size, access=mmap.ACCESS_READ) if size else b"").load()


class _Packer(pickle.Pickler):
    def __init__(self, stream: io.BytesIO, memory: int) -> None:
        super().__init__(stream, protocol=5)
        self._memory, self._end = memory, 0
        self._placed: dict[
            int, tuple[NDArray[Any], tuple[Any, ...]]
        ] = {}  # holds the arrays, so that none takes another's id

    def persistent_id(self, value: Any) -> Any:
        if type(value) is not np.ndarray or value.dtype.hasobject or value.nbytes < SMALLEST:
            return None
        if id(value) not in self._placed:
            start = self._end
            self._end = _write(value, self._memory, start)
            self._end += -self._end % ALIGNED
            self._placed[id(value)] = value, (start, value.shape, value.dtype)
        return self._placed[id(value)][1]


class _Unpacker(pickle.Unpickler):
    def __init__(self, stream: io.BytesIO, memory: Any) -> None:
        super().__init__(stream)
        self._memory = memory

    def persistent_load(self, place: Any) -> NDArray[Any]:
        start, shape, dtype = place
        return np.ndarray(shape, dtype, self._memory, start)


def _write(array: NDArray[Any], memory: int, start: int) -> int:
    """Write an array in C order, in parts where it does not lie so, which are copied twice; returns the end."""
    if not array.flags.c_contiguous and array.nbytes > PART:
        for part in array:
            start = _write(part, memory, start)
        return start
    left = memoryview(np.ascontiguousarray(array).reshape(-1).view(np.uint8).data)
    while left:
        written = os.pwrite(memory, left[:AT_ONCE], start)
        left, start = left[written:], start + written
    return start
