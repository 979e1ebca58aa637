"""The arrays of one HDF5, netCDF or Zarr file, by name, with their axes and attributes; values are read when asked for.

Files may come from strangers: nothing outside their folder is read, and no code is run.  The size that an array claims is
compared with the free memory before it is read.
"""

from __future__ import annotations

import asyncio
import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from catalogs.vocabulary.words import joined_names
from insitu.readers.hdf5_links import check_inside, described_links, refuse_outside
from insitu.readers.missing import decoded
from insitu.readers.netcdf import is_classic, read_header
from insitu.readers.zarr_store import check_store

HDF5 = {".h5", ".hdf5", ".he5", ".hdf", ".h5py"}
NETCDF = {".nc", ".nc4", ".cdf", ".netcdf"}
ZARR = {".zarr"}
AS_STORED = {"mask_and_scale": False, "decode_times": False, "decode_coords": False, "cache": False}
SMALL = 1 << 24  # bytes for which there is always room: the free memory is not asked for
NETCDF4 = "reading this netCDF file takes netCDF4: pip install 'gs-surrogate[mpas]'"
XARRAY = "reading {} takes xarray: pip install 'gs-surrogate[xarray]'"


@dataclass(frozen=True, eq=False)
class StoredArray:
    """An array of a file that is open.

    Attributes
    ----------
    name : its path in the file, "group/array".
    dims : names of its axes, "" where they have none.
    fetch : reads what is stored at indices of the first axes.
    default_fill : netCDF's default fill value marks what was never written.
    """

    name: str
    shape: tuple[int, ...]
    dtype: np.dtype[Any]
    dims: tuple[str, ...]
    attrs: Mapping[str, Any]
    fetch: Callable[[tuple[int, ...]], Any] = field(repr=False)
    default_fill: bool = False

    def __repr__(self) -> str:
        return f"{self.name} {self.dtype} {self.shape}"

    @property
    def group(self) -> str:
        """The path of the group that holds it, "" at the top."""
        return self.name.rpartition("/")[0]

    @property
    def stem(self) -> str:
        """Its name in its group."""
        return self.name.rpartition("/")[2]

    @property
    def is_real(self) -> bool:
        return self.dtype.kind in "fiub"

    def read(self, index: tuple[int, ...] = ()) -> NDArray[Any]:
        """The values at indices of the first axes, unpacked, NaN where missing (see `insitu.readers.missing`).

        Raises ValueError where they can't be read or have no room in memory.
        """
        size = max(8 if {"scale_factor", "add_offset"} & set(self.attrs) else 4, self.dtype.itemsize)
        check_room(int(np.prod(self.shape[len(index) :], dtype=np.float64)) * size, repr(self))
        try:
            values = np.asarray(self.fetch(index))
        except (OSError, KeyError, RuntimeError, ValueError) as error:
            raise ValueError(f"{self.name!r}{list(index) or ''} cannot be read: {error}") from None
        values = decoded(values, self.attrs, self.name, default_fill=self.default_fill)
        return values.astype(np.float32) if values.dtype == np.float16 else values


@dataclass(frozen=True, eq=False)
class LabelledArray:
    """Values with named axes and coordinates, as `render.to_grid` takes them of xarray, too.

    Coordinates that have attributes are labelled arrays themselves; `notes` are those of the grid.
    """

    values: NDArray[Any]
    dims: tuple[str, ...]
    coords: Mapping[str, NDArray[Any] | LabelledArray]
    name: str = ""
    attrs: Mapping[str, Any] = field(default_factory=dict)
    time: float | None = None
    notes: tuple[str, ...] = ()

    @property
    def shape(self) -> tuple[int, ...]:
        return self.values.shape

    @property
    def dtype(self) -> np.dtype[Any]:
        return self.values.dtype


@dataclass(frozen=True, eq=False)
class Arrays:
    """An open file: its arrays by path, the attributes of its groups by theirs ("" is the top), and links that are not followed."""

    arrays: Mapping[str, StoredArray]
    attrs: Mapping[str, Mapping[str, Any]]
    links: tuple[str, ...] = ()

    def __str__(self) -> str:
        listed = ", ".join(map(repr, list(self.arrays.values())[:12])) or "no array"
        more = f" and {len(self.arrays) - 12} more" if len(self.arrays) > 12 else ""
        links = f"; links, which are not followed: {joined_names(self.links)}" if self.links else ""
        return f"{listed}{more}; attributes: {joined_names(sorted(self.attrs.get('', {})))}{links}"

    def coordinate(self, array: StoredArray, dim: str) -> StoredArray | None:
        """The real numbers along an axis of `array`: the array of one axis that is called like it, in its group or above."""
        group = array.group
        while dim:
            along = self.arrays.get(f"{group}/{dim}" if group else dim)
            if along is not None:
                return along if len(along.shape) == 1 and along.dtype.kind in "fiu" else None
            if not group:
                break
            group = group.rpartition("/")[0]
        return None

    def labelled(
        self, array: StoredArray, index: tuple[int, ...] = (), dims: Sequence[str] | None = None
    ) -> LabelledArray:
        """The values at indices of the first axes of `array`, with the coordinates of the others."""
        names = tuple(dims or array.dims)[len(index) :]
        along = {name: self.coordinate(array, name) for name in names}
        coordinates = {name: coordinate for name, coordinate in along.items() if coordinate is not None}
        coords = {name: LabelledArray(c.read(), (name,), {}, name, c.attrs) for name, c in coordinates.items()}
        return LabelledArray(array.read(index), names, coords, array.stem, array.attrs)


def is_store(path: Path) -> bool:
    """True if the name says that a file holds named arrays."""
    return path.suffix.lower() in HDF5 | NETCDF | ZARR


def check_room(size: int, what: str) -> None:
    """Raise ValueError where `what` takes more bytes than the memory that is free."""
    if size < SMALL:
        return
    import psutil

    free = psutil.virtual_memory().available
    if size > free:
        raise ValueError(
            f"{what} claims {size / 1e9:.3g} GB, more than the {free / 1e9:.3g} GB of memory that are free"
        )


@contextmanager
def open_arrays(path: str | os.PathLike[str]) -> Iterator[Arrays]:
    """The arrays of a file, or of a Zarr folder, as long as it is open.

    Raises FileNotFoundError, or ValueError naming the file, where it is damaged, leads out of its folder or would run code, and
    ModuleNotFoundError without xarray where that is needed.
    """
    path = Path(path)
    if not (path.is_dir() if path.suffix in ZARR else path.is_file()):
        raise FileNotFoundError(f"there is no file {path}")
    with ExitStack() as stack:
        try:
            arrays = stack.enter_context(_opener(path)(path))
        except (OSError, KeyError, RuntimeError, TypeError, AttributeError) as error:
            raise ValueError(f"{path} is not readable as {_kind(path)}: {error}") from None
        except ValueError as error:
            raise ValueError(f"{path}: {error}") from None
        yield arrays


def _kind(path: Path) -> str:
    return "Zarr" if path.suffix in ZARR else "netCDF" if path.suffix in NETCDF else "HDF5"


def _opener(path: Path) -> Any:
    return _zarr if path.suffix in ZARR else _netcdf if path.suffix in NETCDF else _hdf5


@contextmanager
def _hdf5(path: Path) -> Iterator[Arrays]:
    with h5py.File(path, "r") as file:
        if "_NCProperties" not in file.attrs:
            yield _of_hdf5(file)
            return
    with _netcdf(path) as arrays:
        yield arrays


def _of_hdf5(file: h5py.File) -> Arrays:
    arrays: dict[str, StoredArray] = {}
    attrs: dict[str, Mapping[str, Any]] = {"": dict(file.attrs)}

    def visit(name: str, item: Any) -> None:  # not led to by links to other files
        if isinstance(item, h5py.Dataset):
            if item.shape is not None:
                arrays[name] = StoredArray(name, item.shape, item.dtype, _dims(item), dict(item.attrs), _inside(item))
        elif isinstance(item, h5py.Group):
            attrs[name] = dict(item.attrs)

    file.visititems(visit)
    return Arrays(arrays, attrs, described_links(file))


def _dims(dataset: h5py.Dataset) -> tuple[str, ...]:
    """Names of the axes: their labels, else of the scales attached to them; a scale names its own axis."""
    if dataset.is_scale:
        return (dataset.name.rpartition("/")[2],) * len(dataset.shape)
    return tuple(d.label or (d[0].name.rpartition("/")[2] if len(d) else "") for d in dataset.dims)


def _inside(dataset: h5py.Dataset) -> Callable[[tuple[int, ...]], Any]:
    """Reads of a data set whose values lie in its own file; raises ValueError for others."""

    def fetch(index: tuple[int, ...]) -> Any:
        check_inside(dataset)
        return dataset.asstr()[index] if h5py.check_string_dtype(dataset.dtype) else dataset[index]

    return fetch


@contextmanager
def _netcdf(path: Path) -> Iterator[Arrays]:
    unfilled: set[str] = set()
    ragged: set[str] = set()
    if is_classic(path):
        if read_header(path).version == 5:  # which the netCDF library alone reads
            with open_classic(path) as arrays:
                yield arrays
            return
        groups = {"/": _xarray("netCDF").open_dataset(path, engine="scipy", **AS_STORED)}
    else:
        xarray = _xarray("netCDF")
        if h5py.is_hdf5(path):
            with h5py.File(path, "r") as file:
                refuse_outside(file)
                unfilled, ragged = _peculiar(file)
        groups = xarray.open_groups(path, engine="h5netcdf", drop_variables=sorted(ragged), **AS_STORED)
    with _of_xarray(groups) as arrays:
        filled = {n: replace(a, default_fill=n not in unfilled) for n, a in arrays.arrays.items()}
        yield Arrays(filled, arrays.attrs)


@contextmanager
def open_classic(path: Path) -> Iterator[Arrays]:
    """The arrays of a classic netCDF file, as they are stored, as long as it is open.

    Raises ValueError where its header is damaged, ModuleNotFoundError without netCDF4.
    """
    read_header(path)
    try:
        import netCDF4
    except ModuleNotFoundError:
        raise ModuleNotFoundError(NETCDF4) from None
    with netCDF4.Dataset(str(path), "r") as file:
        file.set_auto_maskandscale(False)
        attrs = {name: file.getncattr(name) for name in file.ncattrs()}
        yield Arrays({name: _array_of(name, variable) for name, variable in file.variables.items()}, {"": attrs})


def _array_of(name: str, variable: Any) -> StoredArray:
    attrs = {key: variable.getncattr(key) for key in variable.ncattrs()}
    dims, fetch = tuple(variable.dimensions), _fetch(variable)
    return StoredArray(name, tuple(variable.shape), np.dtype(variable.dtype), dims, attrs, fetch, default_fill=True)


def _fetch(variable: Any) -> Callable[[tuple[int, ...]], Any]:
    return lambda index: variable[index] if index else variable[...]


def _peculiar(file: h5py.File) -> tuple[set[str], set[str]]:
    """Paths of arrays of bytes without a fill value, for which netCDF has no default, and names of arrays of rows that differ
    in length, which xarray does not read.
    """
    unfilled: set[str] = set()
    ragged: set[str] = set()

    def visit(name: str, item: Any) -> None:
        if isinstance(item, h5py.Dataset):
            if h5py.check_vlen_dtype(item.dtype) not in (None, str, bytes):
                ragged.add(name.rpartition("/")[2])
            elif item.dtype.itemsize == 1:
                defined = item.id.get_create_plist().fill_value_defined()
                unfilled.update([name] if defined != h5py.h5d.FILL_VALUE_USER_DEFINED else [])

    file.visititems(visit)
    return unfilled, ragged


@contextmanager
def _zarr(path: Path) -> Iterator[Arrays]:
    check_store(path)
    opens = partial(_xarray("Zarr").open_groups, path, engine="zarr", consolidated=False, **AS_STORED)
    try:
        groups = _outside_loops(opens)
    except (KeyError, ValueError):  # axes without names
        yield _of_zarr(path)
        return
    with _of_xarray(groups) as arrays:
        yield arrays


def _outside_loops(call: Callable[[], Any]) -> Any:
    """The result of `call`, in a thread of its own where an event loop runs, as in a notebook: xarray calls asyncio.run."""
    try:
        asyncio.get_running_loop()
    except RuntimeError:
        return call()
    with ThreadPoolExecutor(1) as thread:
        return thread.submit(call).result()


def _xarray(kind: str) -> Any:
    try:
        import xarray
    except ModuleNotFoundError:
        raise ModuleNotFoundError(XARRAY.format(kind)) from None
    return xarray


@contextmanager
def _of_xarray(groups: Mapping[str, Any]) -> Iterator[Arrays]:
    arrays: dict[str, StoredArray] = {}
    with ExitStack() as stack:
        for dataset in groups.values():
            stack.callback(dataset.close)
        for place, dataset in groups.items():
            prefix = place.strip("/")
            for name, array in dataset.variables.items():
                full = f"{prefix}/{name}" if prefix else str(name)
                kind = np.dtype(array.dtype)
                fetch = _of_variable(array)
                arrays[full] = StoredArray(
                    full, array.shape, kind, tuple(map(str, array.dims)), dict(array.attrs), fetch
                )
        # A Zarr folder lists its arrays in any order.
        yield Arrays(
            dict(sorted(arrays.items())), {place.strip("/"): dict(dataset.attrs) for place, dataset in groups.items()}
        )


def _of_variable(array: Any) -> Callable[[tuple[int, ...]], Any]:
    return lambda index: array[index].values


def _of_zarr(path: Path) -> Arrays:
    """The arrays of a store whose axes have no names."""
    import zarr

    top: Any = zarr.open(str(path), mode="r")
    items = {"array": top} if isinstance(top, zarr.Array) else dict(top.members(max_depth=None))
    arrays, attrs = {}, {"": dict(top.attrs)}
    for name, item in items.items():
        if not isinstance(item, zarr.Array):
            attrs[name] = dict(item.attrs)
            continue
        names: Any = getattr(item.metadata, "dimension_names", None) or item.attrs.get("_ARRAY_DIMENSIONS") or ()
        dims = tuple(str(n or "") for n in names) or ("",) * len(item.shape)
        kind = np.dtype(item.dtype)
        arrays[name] = StoredArray(name, tuple(item.shape), kind, dims, dict(item.attrs), _of_array(item))
    return Arrays(dict(sorted(arrays.items())), attrs)


def _of_array(array: Any) -> Callable[[tuple[int, ...]], Any]:
    return lambda index: array[index] if index else array[...]
