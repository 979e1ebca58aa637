"""Arrays of any library as numpy's."""

from __future__ import annotations

from contextlib import suppress
from typing import Any

import numpy as np
from numpy.typing import NDArray

UNKNOWN_TO_NUMPY = ("bfloat16", "float8")  # how the names of such types begin
UNREADABLE = (BufferError, RuntimeError, TypeError, ValueError, AttributeError)


def plain_array(data: Any) -> NDArray[Any]:
    """An array of any library, or nested lists; of a masked array NaN where it is masked.

    Raises TypeError where it can't be read, saying what would help.
    """
    if not isinstance(data, np.ma.MaskedArray):
        exported = hasattr(data, "__dlpack__") and not isinstance(data, np.ndarray)
        return _exported(data) if exported else _converted(data)
    masked: Any = data
    if masked.dtype.kind not in "fiub" or not np.ma.is_masked(masked):
        return np.asarray(masked.data)
    return np.asarray(masked.astype(masked.dtype if masked.dtype.kind == "f" else np.float64).filled(np.nan))


def _converted(data: Any) -> NDArray[Any]:
    """An array as numpy makes it; raises TypeError naming the type of what is none."""
    reason = ""
    try:
        values = np.asarray(data)
        if isinstance(data, np.ndarray | np.generic | list | tuple) or values.dtype.kind not in "OUSV":
            return values
    except UNREADABLE as error:
        reason = f" ({' '.join(str(error).split())})"
    kind = type(data)
    name = kind.__qualname__ if kind.__module__ == "builtins" else f"{kind.__module__}.{kind.__qualname__}"
    cure = "pass numpy.asarray of its values" if data is not None else "was it computed?"
    ways = [f".{word}" for word in ("to_numpy()", "values", "data", "get()") if hasattr(data, word.removesuffix("()"))]
    raise TypeError(
        "a field must be an array of numbers (z, y, x), a VTK or pyvista data set or an xarray.DataArray, got "
        f"{name}{reason}: {f'pass its {ways[0]}' if ways else cure}; dims= says what its axes are where they are others"
    )


def _exported(data: Any) -> NDArray[Any]:
    """An array that speaks DLPack: shared where it lies in main memory, else copied from its device."""
    try:
        return _from_main_memory(_in_main_memory(data))
    except UNREADABLE as error:
        form, device = getattr(data, "dtype", "no type"), getattr(data, "device", "an unknown device")
        reason = " ".join(str(error).split())
        raise TypeError(
            f"a {type(data).__name__} of {form} on {device} can't be read ({reason}): pass its values as a numpy array in "
            "main memory, such as numpy.asarray(field.detach().cpu().float())"
        ) from None


def _in_main_memory(data: Any) -> Any:
    """`data` without gradients and off its device, in a type that numpy knows; nothing is copied in vain."""
    for method in ("detach", "cpu", "get"):  # torch has the first two, cupy the last
        if hasattr(data, method):
            data = getattr(data, method)()
    if str(getattr(data, "dtype", "")).rpartition(".")[-1].startswith(UNKNOWN_TO_NUMPY):
        data = data.float() if hasattr(data, "float") else data.astype("float32")
    return data


def _from_main_memory(data: Any) -> NDArray[Any]:
    if isinstance(data, np.ndarray):
        return data
    try:
        return np.from_dlpack(data)
    except UNREADABLE:
        with suppress(*UNREADABLE):  # others, such as jax, know `__array__` as well, which copies
            array = np.asarray(data)
            if array.dtype.kind in "fiub":
                return array
        raise
