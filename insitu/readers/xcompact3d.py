"""Snapshots of Xcompact3d: raw arrays in binary files, and an XDMF file that says what they are (the code's `visu.f90`).

    data/snapshot-0010.xdmf, data/ux-0010.bin, data/pp-0010.bin, ...

The files of its toolbox, which hold all snapshots and their times in one XDMF file, are read as well.  Arrays stay on disk until
they are used.  The XML may come from strangers: entities are not expanded, and no file outside the XDMF file's folder is read.
"""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from xml.etree.ElementTree import Element

import numpy as np
from numpy.typing import NDArray

from insitu.fields.field import Field
from insitu.readers.arrays import LabelledArray, check_room
from insitu.readers.fortran_numbers import printed_number
from insitu.readers.printed_axis import PrintedAxis, field_on_axes
from insitu.readers.reader import Reader, Sampling, StoredState, chosen_array
from insitu.readers.xml_files import LARGEST, parsed

SUFFIXES = {".xdmf", ".xmf"}
MARKS = (
    re.compile(rb"<Xdmf\b"),
    re.compile(rb"""TopologyType\s*=\s*["']3D(Co)?RectMesh"""),
    re.compile(rb"""["']Binary["']"""),
)
LOOKED_AT = 4096  # numbers of an array that show the order of bytes
ENDIANS = {"little": "<", "big": ">", "native": "="}


@dataclass(frozen=True)
class Snapshot:
    """A state of the simulation: the elements of its arrays by name, its mesh, and its time where that is known."""

    name: str
    time: float | None
    arrays: dict[str, Element]
    counts: tuple[int, int, int]  # of points along z, y, x
    geometry: Element
    on_cells: frozenset[str]  # names of the arrays that are said to have one value for each cell


@dataclass(frozen=True)
class RawArray:
    """The place of an array: its values follow each other in a file."""

    path: Path
    kind: np.dtype[Any]
    begins: int
    shape: tuple[int, int, int]  # z, y, x

    @property
    def ends(self) -> int:
        """The byte behind the last value."""
        return self.begins + math.prod(self.shape) * self.kind.itemsize


def recognizes(path: Path) -> bool:
    """True if it is an XDMF file of a rectilinear mesh whose arrays are raw."""
    try:
        if path.suffix.lower() not in SUFFIXES or not path.is_file() or path.stat().st_size > LARGEST:
            return False
        text = path.read_bytes()
    except OSError:
        return False
    return all(mark.search(text) for mark in MARKS)


def records(path: Path, sampling: Sampling) -> list[StoredState]:
    """The snapshots of a file: their times, or else their numbers."""
    states = []
    for number, snapshot in enumerate(_snapshots(path)):
        word = snapshot.name.strip()
        says = {} if snapshot.time is None else {"time": snapshot.time}
        states.append(
            StoredState((number,), {**says, **({"snapshot": float(word)} if word.isdigit() and len(word) < 16 else {})})
        )
    return states


def read(path: Path, array: str | None, index: tuple[int, ...], sampling: Sampling) -> Field | LabelledArray:
    """An array of a snapshot, by default of the first."""
    snapshots = _snapshots(path)
    (number,) = index or (0,)
    if number >= len(snapshots):
        raise ValueError(f"it has {len(snapshots)} snapshots, not {number + 1}")
    snapshot = snapshots[number]
    name = chosen_array(array, list(snapshot.arrays), f"snapshot {snapshot.name.strip()!r}")
    try:
        raw = _raw_array(path, snapshot.arrays[name])
        _check_size(raw, [item for other in snapshots for item in other.arrays.values()], snapshot.arrays[name])
    except ValueError as error:
        raise ValueError(f"{name}: {error}") from None
    on_points = raw.shape == snapshot.counts
    cells = tuple(n - 1 for n in snapshot.counts)
    if on_points and name in snapshot.on_cells:
        raise ValueError(
            f"{name} has {raw.shape} values on {cells} cells (z, y, x): Center should say Node, or Dimensions less"
        )
    if not on_points and raw.shape != cells:
        raise ValueError(f"{name} has {raw.shape} values on {snapshot.counts} points (z, y, x)")
    check_room(math.prod(raw.shape) * raw.kind.itemsize, f"{name!r}")
    values = np.memmap(raw.path, raw.kind, "r", raw.begins, raw.shape)  # [nz, ny, nx]
    if _is_swapped(values):
        raise ValueError(f"{name}: the numbers of {raw.path.name} are in another order of bytes than its Endian says")
    return _placed(values, snapshot, name, on_points)


def _is_swapped(values: NDArray[np.floating]) -> bool:
    """True if numbers have the most various exponents as they are, and moderate ones in the other order of bytes."""
    some = np.array(values.reshape(-1)[:: max(1, values.size // LOOKED_AT)])
    return _wild(some) > 0.2 and _wild(some.byteswap()) < 0.01


def _wild(values: NDArray[np.floating]) -> float:
    """The share of numbers other than zero that no field of moderate size has."""
    with np.errstate(invalid="ignore"):  # of NaN that signal
        sizes = np.abs(values[values != 0].astype(np.float64))
    most = 1e60 if values.dtype.itemsize == 8 else 1e25
    return float(np.mean(~((sizes > 1 / most) & (sizes < most)))) if sizes.size else 0.0


def _placed(values: Any, snapshot: Snapshot, name: str, on_points: bool) -> Field | LabelledArray:
    kind = snapshot.geometry.get("Type") or snapshot.geometry.get("GeometryType") or ""
    items = [(item.text or "").split() for item in snapshot.geometry.findall("DataItem")]
    wanted = {"ORIGIN_DXDYDZ": [3, 3], "VXVYVZ": list(snapshot.counts[::-1])}.get(kind.upper())
    if wanted is None or [len(words) for words in items] != wanted:
        raise ValueError(
            f"its geometry must be ORIGIN_DXDYDZ or VXVYVZ with {wanted or 'their'} numbers, got {kind[:40]!r}"
        )
    if kind.upper() == "VXVYVZ":
        axes = [PrintedAxis.of(words) for words in items]
        return field_on_axes(values, axes, not on_points, name, snapshot.time)
    start, step = ([_finite(word, "origin and spacing") for word in reversed(words)] for words in items)
    origin = [a + (0.0 if on_points else 0.5) * width for a, width in zip(start, step, strict=True)]
    return Field(values, tuple(step), tuple(origin), name, time=snapshot.time)  # type: ignore[arg-type]


# ---- XDMF ------------------------------------------------------------------------------------------------------------


def _snapshots(path: Path) -> list[Snapshot]:
    """The snapshots of an XDMF file; raises ValueError where it is another one."""
    root = parsed(path)
    domain = root.find("Domain") if root.tag == "Xdmf" else None
    if domain is None:
        raise ValueError("it is not an XDMF file: there is no Xdmf/Domain in it")
    grids: list[tuple[Element, float | None]] = []
    for grid in domain.findall("Grid"):
        if grid.get("GridType", "Uniform") == "Uniform":
            grids.append((grid, _value(grid.find("Time"))))
        elif grid.get("CollectionType") == "Temporal":
            inner = grid.findall("Grid")
            first, step = _hyperslab(grid.find("Time"))
            times = [first + step * i for i in range(len(inner))] if step is not None else [None] * len(inner)
            own = [_value(g.find("Time")) for g in inner]
            grids += [(g, t if o is None else o) for g, t, o in zip(inner, times, own, strict=True)]
        else:
            raise ValueError(f"its grid {grid.get('Name')!r} is neither Uniform nor a collection in time")
    if not grids:
        raise ValueError("it has no snapshots: there is no Grid in it")
    return [_snapshot(domain, grid, time) for grid, time in grids]


def _snapshot(domain: Element, grid: Element, time: float | None) -> Snapshot:
    topology, geometry = (_referred(domain, grid, what) for what in ("Topology", "Geometry"))
    counts = _counts(topology)
    arrays, on_cells = {}, set()
    for attribute in grid.findall("Attribute"):
        item, name = attribute.find("DataItem"), attribute.get("Name")
        if item is not None and name:
            arrays[name] = item
            on_cells.update([name] if attribute.get("Center") == "Cell" else [])
    return Snapshot(grid.get("Name", ""), time, arrays, counts, geometry, frozenset(on_cells))


def _referred(domain: Element, grid: Element, what: str) -> Element:
    """The topology or geometry of a grid: its own, or the one of the domain that it refers to."""
    element = grid.find(what)
    if element is None or element.get("Reference"):
        shared = domain.findall(what)
        number = re.fullmatch(
            rf"/Xdmf/Domain/{what}(?:\[(\d{{1,6}})\])?", (element.get("Reference") or "") if element is not None else ""
        )
        place = int(number[1] or 1) if number else 1
        element = shared[place - 1] if 1 <= place <= len(shared) else None
    if element is None:
        raise ValueError(f"its grid {grid.get('Name')!r} has no {what}")
    return element


def _counts(element: Element) -> tuple[int, int, int]:
    """The Dimensions of a topology or an array, (z, y, x)."""
    words = (element.get("Dimensions") or element.get("NumberOfElements") or "").split()
    if len(words) != 3 or not all(word.isdigit() and len(word) < 10 for word in words):
        raise ValueError(f"Dimensions must be three numbers, z y x, got {' '.join(words)[:60]!r}")
    nz, ny, nx = map(int, words)
    return nz, ny, nx


def _raw_array(path: Path, item: Element) -> RawArray:
    """The place of a DataItem's values; raises ValueError unless that is a raw file in the XDMF file's folder, and long enough."""
    if item.get("Format") != "Binary":
        raise ValueError(
            f"its values are stored as {item.get('Format')!r}, not Binary: for the ADIOS2 output of the code, name its .bp folder"
        )
    number, precision = item.get("NumberType") or item.get("DataType") or "Float", item.get("Precision", "4")
    endian = ENDIANS.get(item.get("Endian", "native").lower())
    if (number, precision) not in {("Float", "4"), ("Float", "8")} or endian is None:
        raise ValueError(f"it must hold Float of 4 or 8 bytes, got {number} {precision}, {item.get('Endian')} endian")
    kind, shape = np.dtype(f"{endian}f{precision}"), _counts(item)
    seek = item.get("Seek", "0")
    if not seek.isdigit() or len(seek) > 18:
        raise ValueError(f"Seek must be a number of bytes, got {seek[:40]!r}")
    folder, name = path.resolve().parent, (item.text or "").strip()
    try:
        other = (folder / name).resolve()
        if not other.is_relative_to(folder):
            raise ValueError(f"it lies in {name[:200]!r}, outside the folder of {path.name}: copy both into one folder")
        if not name or not other.is_file():
            raise ValueError(f"there is no file {name[:200]!r} beside {path.name}")
        size = other.stat().st_size
    except (OSError, RuntimeError) as error:  # too long a name, or a circle of links
        raise ValueError(f"the file {name[:60]!r} is not readable: {error}") from None
    raw = RawArray(other, kind, int(seek), shape)
    if raw.ends > size:
        raise ValueError(
            f"it claims {raw.ends} bytes, {other.name} has {size}: is it being written, or of another precision?"
        )
    return raw


def _check_size(raw: RawArray, items: Sequence[Element], own: Element) -> None:
    """Raise ValueError where a file is longer than all arrays claim that are said to lie in it: its size alone checks them."""
    name, size = (own.text or "").strip(), raw.path.stat().st_size
    if raw.ends == size:
        return
    ends = [raw.ends]
    for item in items:
        if (item.text or "").strip() == name and item.get("Seek", "0").isdigit():
            precision = item.get("Precision", "4")
            ends.append(int(item.get("Seek", "0")) + math.prod(_counts(item)) * int(precision))
    if max(ends) != size:
        raise ValueError(
            f"its arrays claim {max(ends)} bytes, {raw.path.name} has {size}: is it of another mesh or precision?"
        )


def _value(time: Element | None) -> float | None:
    """The Value of a Time; None where there is none."""
    word = None if time is None else time.get("Value")
    return None if word is None else _finite(word)


def _hyperslab(time: Element | None) -> tuple[float, float | None]:
    """(first, step) of the times of a collection; step None where it does not say."""
    item = time.find("DataItem") if time is not None and time.get("TimeType") == "HyperSlab" else None
    words = [] if item is None else "".join(item.itertext()).split()
    return (_finite(words[0]), _finite(words[1])) if len(words) in (2, 3) else (0.0, None)


def _finite(word: str, what: str = "a time") -> float:
    try:
        value = printed_number(word)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise ValueError(f"{what} must be a finite number, got {word[:40]!r}")
    return value


READER = Reader("xcompact3d", "Xcompact3d, snapshot-<n>.xdmf beside its .bin files", recognizes, records, read)
