"""The functions that `insitu.c` calls: pointers of C become values of Python, and each answer is a status + 2."""

from __future__ import annotations

import os
import threading
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from insitu.bindings.calls import FAILED, LARGEST, UNKNOWN, LibraryCalls

TYPES: dict[int, type[np.generic]] = {1: np.float32, 2: np.float64, 3: np.intc, 4: np.longlong}  # as in insitu.h
ANSWER = 2  # added to a status: 0 says that the interpreter did not start


def connect(ffi: Any) -> None:
    """Define the functions of the library, which has one session, for all threads."""
    calls, lock = LibraryCalls(), threading.RLock()
    of_thread = threading.local()  # the error of its last call, and the text that C has a pointer to

    def answering(function: str, work: Callable[..., int], failed: int = FAILED) -> Callable[..., int]:
        def answer(*arguments: Any) -> int:
            with lock:
                try:
                    return work(*arguments) + ANSWER
                except BaseException as error:
                    return calls.refuse(error, failed, function) + ANSWER
                finally:
                    of_thread.error = calls.error

        return answer

    def error() -> Any:
        of_thread.text = ffi.new("char[]", getattr(of_thread, "error", "").encode(errors="replace"))
        return of_thread.text

    functions = _on_pointers(ffi, calls)
    for name, work in functions.items():
        ffi.def_extern(name=f"insitu_python_{name}", error=0)(answering(name, work))
    ffi.def_extern(name="insitu_python_has", error=0)(answering("has", calls.has, UNKNOWN))
    ffi.def_extern(name="insitu_python_error")(error)


class _Pointers:
    """Pointers of C as values of Python; raises ValueError for those that can't be used."""

    def __init__(self, ffi: Any) -> None:
        self._ffi = ffi

    def present(self, pointer: Any, what: str) -> Any:
        if pointer == self._ffi.NULL:
            raise ValueError(f"{what} must be given, got NULL")
        return pointer

    def text(self, pointer: Any, what: str) -> str:
        data: bytes = self._ffi.string(self.present(pointer, what))
        try:
            return data.decode()
        except UnicodeDecodeError:
            raise ValueError(f"{what} must be UTF-8 text, got {data!r}") from None

    def path(self, pointer: Any) -> str:
        return "" if pointer == self._ffi.NULL else os.fsdecode(self._ffi.string(pointer))

    def three(self, pointer: Any, what: str) -> list[Any]:
        return list(self.present(pointer, f"{what}, three numbers (x, y, z),")[0:3])

    def field(self, name: Any, values: Any, shape: Any) -> tuple[str, list[int]]:
        """The name of a field and its shape."""
        called = self.text(name, "the name of a field")
        self.present(values, f"field {called!r}: values")
        return called, self.three(shape, f"field {called!r}: shape")


def _on_pointers(ffi: Any, calls: LibraryCalls) -> Mapping[str, Callable[..., int]]:
    """The functions by name; they raise ValueError for pointers and texts that can't be used."""
    read = _Pointers(ffi)

    def initialize(scene: Any, catalog: Any, has_ranks: int, communicator: int) -> int:
        return calls.initialize(
            read.path(scene), read.path(catalog), _communicator(communicator) if has_ranks else None
        )

    def set_parameter(name: Any, value: float) -> int:
        return calls.set_parameter(read.text(name, "the name of a parameter"), value)

    def set_grid(spacing: Any, origin: Any) -> int:
        return calls.set_grid(read.three(spacing, "spacing"), read.three(origin, "origin"))

    def set_ghosts(layers: Any) -> int:
        return calls.set_ghosts(read.three(layers, "layers"))

    def set_field(name: Any, values: Any, number: int, shape: Any) -> int:
        (called, counts), dtype = read.field(name, values, shape), _type(number)
        return calls.set_field(
            called, counts, lambda count: np.frombuffer(ffi.buffer(values, count * dtype.itemsize), dtype)
        )

    def copy_field(name: Any, values: Any, number: int, shape: Any, strides: Any) -> int:
        (called, counts), dtype = read.field(name, values, shape), _type(number)
        steps = None if strides == ffi.NULL else list(strides[0:3])

        def copied(count: int) -> NDArray[Any]:
            low, size, lying = _extent(called, counts, steps, dtype.itemsize)
            memory = ffi.buffer(ffi.cast("char *", values) + low, size)
            return np.ndarray(counts[::-1], dtype, memory, -low, lying[::-1]).flatten()

        return calls.set_field(called, counts, copied)

    return {
        "initialize": initialize,
        "set_parameter": set_parameter,
        "set_grid": set_grid,
        "set_ghosts": set_ghosts,
        "set_field": set_field,
        "copy_field": copy_field,
        "render": calls.render,
        "finalize": calls.finalize,
    }


def _extent(
    name: str, shape: Sequence[int], strides: Sequence[int] | None, itemsize: int
) -> tuple[int, int, Sequence[int]]:
    """Bytes from the first sample down to the lowest one (at most 0), bytes to the end of the last, and strides, (x, y, z)."""
    steps = strides or [itemsize, itemsize * shape[0], itemsize * shape[0] * shape[1]]
    reaches = [step * (count - 1) for step, count in zip(steps, shape, strict=True)]
    low, high = sum(min(0, r) for r in reaches), sum(max(0, r) for r in reaches) + itemsize
    if high - low > LARGEST or any(step == 0 < count - 1 for step, count in zip(steps, shape, strict=True)):
        raise ValueError(f"field {name!r}: strides must be bytes between samples along x, y, z, got {tuple(steps)}")
    return low, high - low, steps


def _type(number: int) -> np.dtype[Any]:
    if number not in TYPES:
        raise ValueError(f"type must be INSITU_FLOAT, _DOUBLE, _INT or _LONG_LONG (1 to 4), got {number}")
    return np.dtype(TYPES[number])


def _communicator(handle: int) -> Any:
    """The communicator of mpi4py, which neither starts MPI, nor ends it, nor changes what its errors do."""
    try:
        import mpi4py

        mpi4py.rc.initialize = mpi4py.rc.finalize = False
        mpi4py.rc.errors = "default"
        from mpi4py import MPI
    except Exception as error:
        raise ValueError(f"mpi4py can't be used: {error}") from error
    if not MPI.Is_initialized() or MPI.Is_finalized():
        raise ValueError("insitu_initialize_mpi must be called between MPI_Init and MPI_Finalize")
    comm = MPI.Comm.f2py(handle)
    if comm == MPI.COMM_NULL:
        raise ValueError("the communicator must have this process in it, got MPI_COMM_NULL")
    return comm
