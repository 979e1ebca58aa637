"""The arrays of one HDF5, netCDF or Zarr file, by name, with their axes and attributes; values are read when asked for.

Files may come from strangers: nothing outside their folder is read, and no code is run.  The size that an array claims is
compared with the free memory before it is read.
"""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

HDF5 = {".h5", ".hdf5", ".he5", ".hdf", ".h5py"}
NETCDF = {".nc", ".nc4", ".cdf", ".netcdf"}
ZARR = {".zarr"}
# Of Zarr's codecs those that only compress: one of numpy objects would unpickle, and run, what it reads.
CODECS = (
    "adler32 astype bitround blosc bytes bz2 crc32 crc32c delta endian fixedscaleoffset fletcher32 gzip lz4 lzma packbits pcodec "
    "quantize sharding_indexed shuffle transpose vlen-bytes vlen-utf8 zfpy zlib zstd"
)
XARRAY = "reading {} takes xarray: pip install 'gs-surrogate[xarray]'"


@dataclass(frozen=True, eq=False)
class StoredArray:
    """An array of a file that is open.

    Attributes
    ----------
    name : its path in the file, "group/array".
    dims : names of its axes, "" where they have none.
    fetch : reads what lies at indices of the first axes.
    """

    name: str
    shape: tuple[int, ...]
    dtype: np.dtype[Any]
    dims: tuple[str, ...]
    attrs: Mapping[str, Any]
    fetch: Callable[[tuple[int, ...]], Any] = field(repr=False)

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
        """The values at indices of the first axes; raises ValueError where they can't be read or have no room in memory."""
        check_room(int(np.prod(self.shape[len(index) :], dtype=np.float64)) * max(4, self.dtype.itemsize), repr(self))
        try:
            values = np.asarray(self.fetch(index))
        except (OSError, KeyError, RuntimeError, ValueError) as error:
            raise ValueError(f"{self.name!r}{list(index) or ''} cannot be read: {error}") from None
        return values.astype(np.float32) if values.dtype == np.float16 else values


@dataclass(frozen=True, eq=False)
class LabelledArray:
    """Values with named axes and coordinates, as `render.to_grid` takes them of xarray, too."""

    values: NDArray[Any]
    dims: tuple[str, ...]
    coords: Mapping[str, NDArray[Any]]
    name: str = ""
    attrs: Mapping[str, Any] = field(default_factory=dict)
    time: float | None = None

    @property
    def shape(self) -> tuple[int, ...]:
        return self.values.shape

    @property
    def dtype(self) -> np.dtype[Any]:
        return self.values.dtype


@dataclass(frozen=True, eq=False)
class Arrays:
    """An open file: its arrays by path, and the attributes of its groups by theirs ("" is the top)."""

    arrays: Mapping[str, StoredArray]
    attrs: Mapping[str, Mapping[str, Any]]

    def __str__(self) -> str:
        listed = ", ".join(map(repr, list(self.arrays.values())[:12])) or "no array"
        more = f" and {len(self.arrays) - 12} more" if len(self.arrays) > 12 else ""
        return f"{listed}{more}; attributes {sorted(self.attrs.get('', {}))}"

    def coordinate(self, array: StoredArray, dim: str) -> StoredArray | None:
        """The real numbers along an axis of `array`: the array of one axis that is called like it, in its group or above."""
        group = array.group
        while dim:
            found = self.arrays.get(f"{group}/{dim}" if group else dim)
            if found is not None:
                return found if len(found.shape) == 1 and found.dtype.kind in "fiu" else None
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
        coords = {name: held.read() for name, held in along.items() if held is not None}
        return LabelledArray(array.read(index), names, coords, array.stem, array.attrs)


def is_store(path: Path) -> bool:
    """True if the name says that a file holds named arrays."""
    return path.suffix.lower() in HDF5 | NETCDF | ZARR


def check_room(size: int, what: str) -> None:
    """Raise ValueError where `what` takes more bytes than the memory that is free."""
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
        if "_NCProperties" in file.attrs:
            _refuse_outside(file)
            held: Any = None
        else:
            held = _of_hdf5(file)
        if held is not None:
            yield held
            return
    with _netcdf(path) as arrays:
        yield arrays


def _of_hdf5(file: h5py.File) -> Arrays:
    arrays: dict[str, StoredArray] = {}
    attrs: dict[str, Mapping[str, Any]] = {"": dict(file.attrs)}

    def visit(name: str, held: Any) -> None:  # not led to by links to other files
        if isinstance(held, h5py.Dataset):
            if held.shape is not None:
                arrays[name] = StoredArray(name, held.shape, held.dtype, _dims(held), dict(held.attrs), _inside(held))
        elif isinstance(held, h5py.Group):
            attrs[name] = dict(held.attrs)

    file.visititems(visit)
    return Arrays(arrays, attrs)


def _dims(held: h5py.Dataset) -> tuple[str, ...]:
    """Names of the axes: their labels, else of the scales attached to them; a scale names its own axis."""
    if held.is_scale:
        return (held.name.rpartition("/")[2],) * len(held.shape)
    return tuple(d.label or (d[0].name.rpartition("/")[2] if len(d) else "") for d in held.dims)


def _inside(held: h5py.Dataset) -> Callable[[tuple[int, ...]], Any]:
    """Reads of a data set whose values lie in its own file; raises ValueError for others."""

    def fetch(index: tuple[int, ...]) -> Any:
        _check_inside(held)
        return held.asstr()[index] if h5py.check_string_dtype(held.dtype) else held[index]

    return fetch


def _check_inside(held: h5py.Dataset) -> None:
    folder = Path(held.file.filename).resolve().parent
    names = [name for name, *_ in held.external or ()]
    names += [source.file_name for source in held.virtual_sources()] if held.is_virtual else []
    outside = [name for name in names if name != "." and not (folder / name).resolve().is_relative_to(folder)]
    if outside:
        raise ValueError(
            f"data set {held.name!r} reads {outside[0]}, which lies outside the file's folder: copy it there"
        )


def _refuse_outside(file: h5py.File) -> None:
    """Raise ValueError where anything in the file leads to another one; readers other than ours would follow it."""

    links: list[tuple[str, str]] = []
    sets: list[h5py.Dataset] = []

    def link(name: str, held: Any) -> None:
        if isinstance(held, h5py.ExternalLink):
            links.append((name, held.filename))

    def item(name: str, held: Any) -> None:
        if isinstance(held, h5py.Dataset):
            sets.append(held)

    file.visititems_links(link)  # which takes no exception
    file.visititems(item)
    for name, other in links:
        raise ValueError(f"{name!r} is a link to {other}: only what lies in the file itself is read")
    for held in sets:
        _check_inside(held)


@contextmanager
def _netcdf(path: Path) -> Iterator[Arrays]:
    xarray = _xarray("netCDF")
    if h5py.is_hdf5(path):
        with h5py.File(path, "r") as file:
            _refuse_outside(file)
        groups = xarray.open_groups(path, engine="h5netcdf", decode_times=False, cache=False)
    else:
        groups = {"/": xarray.open_dataset(path, engine="scipy", decode_times=False, cache=False)}
    with _of_xarray(groups) as arrays:
        yield arrays


@contextmanager
def _zarr(path: Path) -> Iterator[Arrays]:
    _check_zarr(path)
    xarray = _xarray("Zarr")
    try:
        groups = xarray.open_groups(path, engine="zarr", decode_times=False, cache=False, consolidated=False)
    except (KeyError, ValueError):  # axes without names
        yield _of_zarr(path)
        return
    with _of_xarray(groups) as arrays:
        yield arrays


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
        for held in groups.values():
            stack.callback(held.close)
        for place, held in groups.items():
            prefix = place.strip("/")
            for name, array in held.variables.items():
                full = f"{prefix}/{name}" if prefix else str(name)
                kind = np.dtype(array.dtype)
                fetch = _of_variable(array)
                arrays[full] = StoredArray(
                    full, array.shape, kind, tuple(map(str, array.dims)), dict(array.attrs), fetch
                )
        # A Zarr folder lists its arrays in any order.
        yield Arrays(
            dict(sorted(arrays.items())), {place.strip("/"): dict(held.attrs) for place, held in groups.items()}
        )


def _of_variable(array: Any) -> Callable[[tuple[int, ...]], Any]:
    return lambda index: array[index].values


def _of_zarr(path: Path) -> Arrays:
    """The arrays of a store whose axes have no names."""
    import zarr

    top: Any = zarr.open(str(path), mode="r")
    held = {"array": top} if isinstance(top, zarr.Array) else dict(top.members(max_depth=None))
    arrays, attrs = {}, {"": dict(top.attrs)}
    for name, item in held.items():
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


def _check_zarr(path: Path) -> None:
    """Raise ValueError where a store leads out of its folder, or names a codec that is not known to be harmless."""
    inside = path.resolve()
    if not path.is_dir():
        raise ValueError("a Zarr store is a folder: unpack it")
    for folder, folders, files in os.walk(path):
        for name in [*folders, *files]:
            if (place := Path(folder, name)).is_symlink() and not place.resolve().is_relative_to(inside):
                raise ValueError(f"{place.relative_to(path)} is a link out of the store: only what lies in it is read")
        for name in {"zarr.json", ".zarray", ".zmetadata"}.intersection(files):
            unknown = sorted(_codecs(json.loads(Path(folder, name).read_text(encoding="utf-8"))) - set(CODECS.split()))
            if unknown:
                raise ValueError(
                    f"{Path(folder, name).relative_to(path)} uses the codecs {unknown}, which could run code or are unknown"
                )


def _codecs(record: Any) -> set[str]:
    """Names of all codecs in the metadata of an array, those of older and newer versions alike."""
    found: set[str] = set()
    if isinstance(record, dict):
        for key in ("compressor", "filters", "codecs", "index_codecs"):
            listed = record.get(key) or []
            for codec in listed if isinstance(listed, list) else [listed]:
                if isinstance(codec, dict):
                    found.add(str(codec.get("id") or codec.get("name")).removeprefix("numcodecs."))
        return found.union(*map(_codecs, record.values()))
    return found.union(*map(_codecs, record)) if isinstance(record, list) else found
