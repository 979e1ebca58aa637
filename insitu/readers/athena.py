"""Athena++ outputs, `<name>.out1.00040.athdf`: HDF5 with all mesh blocks, which are joined, a coarser one's cells repeated.

    attributes   Time, NumCycles, Coordinates; RootGridSize, MeshBlockSize, MaxLevel (x1, x2, x3)
                 RootGridX1, -X2, -X3: both ends of the domain, and the ratio of neighbouring cells; 1 for equal ones
                 DatasetNames, NumVariables and VariableNames: which variables each data set holds
    data sets    Levels (block,), LogicalLocations (block, 3), faces x1f, x2f, x3f (block, n + 1)
                 prim, B, ... (variable, block, x3, x2, x1)

The code writes `.athdf.xdmf` beside each for viewers.  Source: `src/outputs/athena_hdf5.cpp` of Athena++.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from insitu.fields.field import Field
from insitu.readers.arrays import LabelledArray, check_room
from insitu.readers.attributes import as_text
from insitu.readers.reader import Reader, Sampling, StoredState, chosen_array

SUFFIX, BESIDE = ".athdf", ".athdf.xdmf"
DEEPEST = 30  # levels
SLACK = 1e-3  # of a cell, within which faces are where the attributes say,
SINGLE = 4e-7  # and of their size, which is in single precision


@dataclass(frozen=True, eq=False)
class MeshBlocks:
    """The blocks of a file on the finest level of any.

    Attributes
    ----------
    counts, size : cells of the domain and of a block, (x, y, z).
    ratios : [B], cells of the finest level along one of the block's.
    starts : [B, 3], the first cell of each, (x, y, z).
    """

    counts: tuple[int, ...]
    size: tuple[int, ...]
    ratios: NDArray[np.int64]
    starts: NDArray[np.int64]

    def check_full(self) -> None:
        """Raise ValueError unless the blocks fill the domain, each cell once."""
        counts = np.zeros([n // k for n, k in zip(self.counts, self.size, strict=True)], dtype=np.uint8)  # x, y, z
        for ratio, start in zip(self.ratios, self.starts // self.size, strict=True):
            counts[tuple(slice(a, a + ratio) for a in start)] += 1
        if not (counts == 1).all():
            raise ValueError(f"its {len(self.ratios)} blocks do not fill the domain of {self.counts} cells, each once")


def recognizes(path: Path) -> bool:
    """True if the name ends with .athdf, or is that of the XDMF file beside one, and HDF5 is in it."""
    try:
        data = _data(path)
        return data.suffix == SUFFIX and path.is_file() and h5py.is_hdf5(data)
    except OSError:
        return False


def files(path: Path) -> list[Path]:
    """The file with the data, and the XDMF file that describes it, if there is one."""
    data = _data(path)
    return [data, *(other for other in [data.with_name(f"{data.name}.xdmf")] if other.is_file())]


def records(path: Path, sampling: Sampling) -> list[StoredState]:
    """The one state in a file: its time and the number of cycles."""
    with h5py.File(_data(path), "r") as file:
        (time,), (cycle,) = _numbers(file, "Time", 1), _numbers(file, "NumCycles", 1)
    return [StoredState((), {"time": float(time), "cycle": float(cycle)})]


def read(path: Path, array: str | None, index: tuple[int, ...], sampling: Sampling) -> Field | LabelledArray:
    """A variable on the cells of the finest level."""
    with h5py.File(_data(path), "r") as file:
        coordinates = as_text(file.attrs.get("Coordinates", "")).strip("\0 ")
        if coordinates not in ("cartesian", "minkowski"):
            raise ValueError(
                f"its coordinates are {coordinates[:40]!r}, and only Cartesian ones can be rendered: interpolate it first, for "
                "example by athena_read.athdf of the code"
            )
        blocks, variables = _blocks(file), _variables(file)
        name = chosen_array(array, list(variables))
        dataset, number = _data_set(file, variables[name][0]), variables[name][1]
        count = len(blocks.ratios)
        if dataset.ndim != 5 or dataset.shape[0] <= number or dataset.shape[1:] != (count, *blocks.size[::-1]):
            raise ValueError(
                f"{name} must have {(number + 1, count, *blocks.size[::-1])} values or more, got {dataset.shape}"
            )
        check_room(math.prod(blocks.counts) * dataset.dtype.itemsize, f"{name!r} on {blocks.counts} cells")
        values = np.empty(blocks.counts[::-1], dtype=dataset.dtype.newbyteorder("="))  # [nz, ny, nx]
        for block, (ratio, start) in enumerate(zip(blocks.ratios.tolist(), blocks.starts.tolist(), strict=True)):
            cells = dataset[number, block]
            if ratio > 1:
                cells = cells.repeat(ratio, 0).repeat(ratio, 1).repeat(ratio, 2)
            x, y, z = (slice(a, a + ratio * n) for a, n in zip(start, blocks.size, strict=True))
            values[z, y, x] = cells
        (time,) = _numbers(file, "Time", 1)
        return _placed(file, blocks, values, name, float(time))


def _placed(file: h5py.File, blocks: MeshBlocks, values: NDArray[Any], name: str, time: float) -> Field | LabelledArray:
    """The values at the centres of their cells."""
    spans = [_numbers(file, f"RootGridX{axis}", 3) for axis in (1, 2, 3)]
    is_even = all(span[2] == 1 for span in spans)
    if not is_even and blocks.ratios.max() > 1:
        raise ValueError("its cells are uneven and refined: interpolate it first, for example by athena_read.athdf")
    faces = [_faces(file, blocks, axis) for axis in range(3)]
    if not is_even:
        centres = [(axis[1:] + axis[:-1]) / 2 for axis in faces]
        return LabelledArray(values, ("z", "y", "x"), dict(zip("xyz", centres, strict=True)), name, time=time)
    steps = []
    for letter, (low, high, _), axis, count in zip("xyz", spans, faces, blocks.counts, strict=True):
        step = (high - low) / count
        slack = SLACK * step + SINGLE * max(abs(low), abs(high))
        if not (step > 0 and (np.abs(low + step * np.arange(count + 1) - axis)[~np.isnan(axis)] <= slack).all()):
            raise ValueError(f"its faces along {letter} are not those of {count} cells from {low:g} to {high:g}")
        steps.append(step)
    x, y, z = steps
    i, j, k = (span[0] + step / 2 for span, step in zip(spans, steps, strict=True))
    return Field(values, (x, y, z), (float(i), float(j), float(k)), name, time=time)


def _blocks(file: h5py.File) -> MeshBlocks:
    """The blocks; raises ValueError where they do not fill the domain."""
    root, size = (_whole(_numbers(file, name, 3), name) for name in ("RootGridSize", "MeshBlockSize"))
    levels, places = _data_set(file, "Levels")[()], _data_set(file, "LogicalLocations")[()]
    count = len(levels)
    if (
        levels.shape != (count,)
        or places.shape != (count, 3)
        or not count
        or {levels.dtype.kind, places.dtype.kind} - set("iu")
    ):
        raise ValueError(
            f"Levels and LogicalLocations must have a row for each block, got {levels.shape}, {places.shape}"
        )
    if min(root) < 2:
        raise ValueError(f"its mesh of {root} cells has no third dimension")
    finest = int(levels.max())
    if levels.min() < 0 or finest > DEEPEST or any(n % k for n, k in zip(root, size, strict=True)):
        raise ValueError(f"its blocks of {size} cells on levels to {finest} do not fit {root} cells")
    counts = tuple(n << finest for n in root)
    check_room(4 * math.prod(counts), f"its mesh of {counts} cells")
    ratios = 1 << (finest - levels.astype(np.int64))
    starts = places.astype(np.int64) * np.array(size) * ratios[:, None]
    if (starts < 0).any() or (starts + ratios[:, None] * size > counts).any():
        raise ValueError("its blocks leave the domain: a slice, or an output with ghost zones, cannot be read")
    blocks = MeshBlocks(counts, size, ratios, starts)
    blocks.check_full()
    return blocks


def _faces(file: h5py.File, blocks: MeshBlocks, axis: int) -> NDArray[np.float64]:
    """The faces of cells along an axis, as the blocks say; NaN where only coarser ones lie."""
    rows = _data_set(file, f"x{axis + 1}f")[()].astype(np.float64)
    if rows.shape != (len(blocks.ratios), blocks.size[axis] + 1):
        raise ValueError(f"x{axis + 1}f must have a row of {blocks.size[axis] + 1} for each block, got {rows.shape}")
    faces = np.full(blocks.counts[axis] + 1, np.nan)
    for own, ratio, start in zip(rows, blocks.ratios.tolist(), blocks.starts[:, axis].tolist(), strict=True):
        place = slice(start, start + ratio * blocks.size[axis] + 1, ratio)
        slack = SLACK * np.abs(np.diff(own)).min() + SINGLE * np.abs(own).max()
        if (np.abs(faces[place] - own) > slack).any():
            raise ValueError(f"its faces along {'xyz'[axis]} are others in each of its blocks")
        faces[place] = own
    return faces


def _variables(file: h5py.File) -> dict[str, tuple[str, int]]:
    """The data set and the index in it of each variable, by name."""
    sets, names = (
        [as_text(word).strip("\0 ") for word in np.ravel(file.attrs.get(key, ()))]
        for key in ("DatasetNames", "VariableNames")
    )
    counts = _whole(_numbers(file, "NumVariables", len(sets)), "NumVariables")
    places = [
        (data_set, i) for data_set, count in zip(sets, counts, strict=True) for i in range(min(count, len(names)))
    ]
    if len(places) != len(names) or len(set(names)) != len(names):
        raise ValueError(f"its {sum(counts)} variables must have names, each another, got {names[:20]}")
    return dict(zip(names, places, strict=True))


def _data_set(file: h5py.File, name: str) -> h5py.Dataset:
    """A data set whose values lie in the file itself."""
    item = file[name] if isinstance(file.get(name, getlink=True), h5py.HardLink) else None
    if not isinstance(item, h5py.Dataset) or item.is_virtual or item.external or item.dtype.kind not in "fiu":
        raise ValueError(f"there is no data set {name!r} of numbers in it")
    check_room(item.size * item.dtype.itemsize, repr(name))
    return item


def _numbers(file: h5py.File, name: str, count: int) -> NDArray[np.float64]:
    """Finite numbers of an attribute."""
    values = np.ravel(file.attrs.get(name, ()))
    if values.dtype.kind not in "fiu" or values.size != count or not np.isfinite(values).all():
        raise ValueError(
            f"its attribute {name} must be {count} finite numbers, got {values if values.size else 'none'}"
        )
    return values.astype(np.float64)


def _whole(values: NDArray[np.float64], name: str) -> tuple[int, ...]:
    if not ((values >= 1) & (values < 1 << 31) & (values == np.rint(values))).all():
        raise ValueError(f"its attribute {name} must be whole numbers from 1 up, got {values}")
    return tuple(values.astype(int).tolist())


def _data(path: Path) -> Path:
    """The file with the data, of it or of the XDMF file beside it."""
    return path.with_name(path.name.removesuffix(".xdmf")) if path.name.endswith(BESIDE) else path


READER = Reader("athena", "Athena++, .athdf", recognizes, records, read, files=files)
