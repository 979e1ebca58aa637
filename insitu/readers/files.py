"""One field from one file: numpy's .npy and .npz, HDF5, netCDF, Zarr, or anything that pyvista reads (VTK, XDMF, EnSight, ...)."""

from __future__ import annotations

import math
import os
import zipfile
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import IO, TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from insitu.fields.field import Field
from insitu.fields.location import FieldLocation
from insitu.readers import vtk_files
from insitu.readers.arrays import Arrays, StoredArray, check_room, is_store
from insitu.readers.attributes import auxiliaries, wanted_array
from insitu.readers.codes import reader_of
from insitu.readers.folders import is_folder_file
from insitu.readers.gzip_files import unpacked
from insitu.readers.placement import placed_field
from insitu.readers.reader import Reader, Sampling
from insitu.readers.time_axes import open_in_time
from render.datasets import to_grid
from render.xarray_fields import SAME, axis_order

if TYPE_CHECKING:
    from render.grids import Grid

READING = (ValueError, TypeError, OSError, EOFError, KeyError, RuntimeError, MemoryError, zipfile.BadZipFile)


def read_field(
    path: str | os.PathLike[str],
    *,
    array: str | None = None,
    spacing: Sequence[float] | None = None,
    origin: Sequence[float] | None = None,
    dims: Sequence[str] | None = None,
    nan: str = "refuse",
    reader: str = "",
    sampling: Sampling = Sampling(),  # noqa: B008 - frozen
) -> Grid:
    """The field stored in `path` as a grid; `nan` as in `to_grid`, the other arguments as in `read_data` and `FieldLocation`."""
    location = FieldLocation(spacing, origin, dims=dims, nan=nan)
    data = read_data(path, location, array=array, reader=reader, sampling=sampling)
    try:
        return to_grid(data, nan=nan, warn=False)
    except (ValueError, TypeError) as error:
        raise ValueError(f"{path}: {error}") from error


def read_data(
    path: str | os.PathLike[str],
    location: FieldLocation = FieldLocation(),  # noqa: B008 - frozen
    *,
    array: str | None = None,
    reader: str = "",
    index: tuple[int, ...] = (),
    sampling: Sampling = Sampling(),  # noqa: B008 - frozen
) -> Any:
    """One field of a file, as `to_grid` takes it, with its place.

    Parameters
    ----------
    location : `spacing` and `origin` for files that do not say: .npy files, and arrays without coordinates; `dims` of arrays.
    array : one of several; may be left out where there is only one.  Of VTK's files as in `to_grid`.
    reader : the name of the code that wrote the file (see `insitu.readers.codes`); "" where that can be seen, or none did.
    index : of the state, in a code's file that holds several, as `Reader.records` gives it.
    sampling : how a code's data come onto a regular grid.

    Files ending with .gz are unpacked first.  No code of a file is run, and what it claims to hold is compared with the memory
    that is free before it is read.  Raises FileNotFoundError, or ValueError naming the file and what is wrong with it.
    """
    path = Path(path)
    if not is_field_file(path):
        raise FileNotFoundError(f"there is no file {path}")
    try:
        if (code := reader_of(path, reader)) is not None:
            return _of_code(code, path, array, index, sampling, location)
        if sampling != Sampling():
            raise ValueError(
                f"only some readers resample: leave {', '.join(sampling.identity)} out, or choose one by --reader"
            )
        if path.suffix == ".gz":
            with unpacked(path) as inner:
                return read_data(inner, location, array=array)
        if path.suffix == ".npy":
            return _plain(_mapped(path), "", location)
        if path.suffix == ".npz":
            return _packed(path, array, location)
        if is_store(path):
            with open_in_time(path) as arrays:
                return placed_field(arrays, volume(arrays, array), location=location)
        if _stated(location):
            raise ValueError("VTK files say where their values lie: leave spacing, origin and dims out")
        return vtk_files.read(path, array)
    except READING as error:
        message = " ".join(str(error).split()).removeprefix(f"{path}: ") or type(error).__name__
        raise ValueError(f"{path}: {message}") from error


def is_field_file(path: Path) -> bool:
    """True if a path is a file, or a folder that counts as one; a pipe or a device is none."""
    return path.is_file() or is_folder_file(path)


def _of_code(
    code: Reader, path: Path, array: str | None, index: tuple[int, ...], sampling: Sampling, location: FieldLocation
) -> Any:
    """A field of the file of a simulation code."""
    if sampling != Sampling() and not code.samples:
        raise ValueError(f"files of {code.name} are not resampled: leave {', '.join(sampling.identity)} out")
    if code.opens is not None:
        index = index or code.states(path, sampling)[0].index
        with code.reading(path), code.opens(path) as arrays:
            chosen = volume(arrays, array, len(index))
            return placed_field(arrays, chosen, index if len(chosen.shape) > 3 else (), location)
    with code.reading(path):
        assert code.read is not None, "it has neither read nor opens"
        field = code.read(path, array, index, sampling)
    if other := [name for name in _stated(location) if not _is_said(field, name, getattr(location, name))]:
        raise ValueError(
            f"files of {code.name} say where their values lie: leave {', '.join(other)} out; this one has "
            f"{', '.join(f'{name} {getattr(field, name, None)}' for name in other)}"
        )
    return field


def _is_said(field: Any, name: str, value: Sequence[float]) -> bool:
    """True if a field that was read has the spacing or the origin that is given, too."""
    if name == "dims" or not isinstance(field, Field):
        return False
    return np.allclose(value, getattr(field, name), rtol=0.0, atol=SAME * np.array(field.spacing))


def _stated(location: FieldLocation) -> list[str]:
    return [name for name in ("spacing", "origin", "dims") if getattr(location, name) is not None]


def _plain(values: NDArray[Any], name: str, location: FieldLocation) -> Field:
    """Values without a place of their own."""
    if location.dims is not None and values.ndim == 3:
        order = axis_order("012", location.dims)
        values = values.transpose([int(order[letter]) for letter in "zyx"])
    spacing, origin = location.spacing or (1.0, 1.0, 1.0), location.origin or (0.0, 0.0, 0.0)
    return Field(values, tuple(spacing), tuple(origin), name)  # type: ignore[arg-type]


def _mapped(path: Path) -> NDArray[Any]:
    """The array of a .npy file, read as it is used; raises ValueError where its bytes are others than it claims, or too many."""
    with suppress(ValueError, EOFError):  # the header says better what is wrong
        values = np.load(path, mmap_mode="r", allow_pickle=False)
        if isinstance(values, np.memmap) and values.offset + values.nbytes == path.stat().st_size:
            check_room(values.nbytes, "it")
            return values
    with path.open("rb") as file:
        _claimed(file, path.stat().st_size, "it")
    return np.load(path, allow_pickle=False)


def _packed(path: Path, array: str | None, location: FieldLocation) -> Field:
    """An array of a .npz file; `spacing` and `origin` may be arrays beside it."""
    with np.load(path, mmap_mode=None, allow_pickle=False) as archive:
        shapes = {}
        for name in archive.files:
            inner = name if name in archive.zip.namelist() else f"{name}.npy"
            with archive.zip.open(inner) as stream:
                shapes[name] = _claimed(stream, archive.zip.getinfo(inner).file_size, f"array {name!r}")
        volumes = [name for name, shape in shapes.items() if len(shape) == 3]
        if array is None and len(volumes) != 1:
            raise ValueError(f"name the array to render: it has {shapes or 'none'}")
        if array is not None and array not in shapes:
            raise ValueError(f"no array {array!r}: it has {shapes or 'none'}")
        beside = [k for k in ("spacing", "origin") if getattr(location, k) is None and shapes.get(k) == (3,)]
        place: dict[str, Any] = {key: tuple(map(float, archive[key])) for key in beside}
        location = replace(location, **place)
        name = volumes[0] if array is None else array
        return _plain(archive[name], name, location)


def _claimed(stream: IO[bytes], length: int, what: str) -> tuple[int, ...]:
    """The shape that an array in numpy's format claims; raises ValueError where its bytes are others than stored, or too many."""
    version = np.lib.format.read_magic(stream)
    read = np.lib.format.read_array_header_1_0 if version == (1, 0) else np.lib.format.read_array_header_2_0
    shape, _, kind = read(stream)
    if kind.hasobject:
        raise ValueError(f"{what} holds Python objects, which run code when they are read: save numbers")
    size = stream.tell() + math.prod(shape) * kind.itemsize
    if size != length:
        raise ValueError(
            f"{what} claims {size} bytes, and has {length}: it was cut short, or something was added to it"
        )
    check_room(size, what)
    return tuple(shape)


def volume(arrays: Arrays, name: str | None, states: int = 0) -> StoredArray:
    """The array with three axes behind those of `states` (others have one value each) that is asked for, or the only one.

    Raises ValueError listing what the file holds.
    """
    aside = auxiliaries(arrays)
    extents = {
        a.name: sum(size > 1 for size in a.shape[states:]) for a in arrays.arrays.values() if a.name not in aside
    }
    match = None if name is None else wanted_array(arrays, name)
    if name is None:
        shaped = [arrays.arrays[other] for other, count in extents.items() if count == 3]
        real = [array for array in shaped if array.is_real] or shaped
        match = real[0] if len(real) == 1 else None
    elif match is None:
        raise ValueError(f"there is no array {name!r} of numbers; the file holds {arrays}")
    larger = match if match is not None and extents.get(match.name, 0) > 3 else None
    if match is None and 3 not in extents.values():
        larger = next((a for a in arrays.arrays.values() if a.is_real and extents.get(a.name, 0) > 3), None)
    if larger is not None:
        raise ValueError(f"{larger!r} has more than three axes: in an ensemble each index of the first is a member")
    if match is None:
        raise ValueError(f"name the array to render; the file holds {arrays}")
    if not match.is_real:
        raise ValueError(f"array {match.name!r} must hold real numbers, got {match.dtype} {match.shape}")
    return match
