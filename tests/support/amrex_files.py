"""Plotfiles as AMReX writes them (`WriteMultiLevelPlotfile`, `VisMF::Write`): headers, and boxes in binary files."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

Box = tuple[tuple[int, int, int], tuple[int, int, int]]  # first and last cell, x y z
IEEE = {8: "8, (64 11 52 0 1 12 0 1023)", 4: "8, (32 8 23 0 1 9 0 127)"}


def boxes_of(low: Sequence[int], counts: Sequence[int], size: int) -> list[Box]:
    """A part of a level cut into boxes of at most `size` cells along an axis."""
    starts = [range(a, a + n, size) for a, n in zip(low, counts, strict=True)]
    ends = [a + n - 1 for a, n in zip(low, counts, strict=True)]
    return [
        ((x, y, z), tuple(min(a + size - 1, end) for a, end in zip((x, y, z), ends, strict=True)))  # type: ignore[misc]
        for z in starts[2]
        for y in starts[1]
        for x in starts[0]
    ]


def text_of(box: Box) -> str:
    return "(" + " ".join("(" + ",".join(map(str, corner)) + ")" for corner in (*box, (0, 0, 0))) + ")"


def write_plotfile(
    path: Path,
    levels: Sequence[Mapping[str, NDArray[np.floating]]],
    boxes: Sequence[Sequence[Box]],
    *,
    low: Sequence[float] = (0.0, 0.0, 0.0),
    high: Sequence[float] = (1.0, 1.0, 1.0),
    time: float = 0.0,
    kind: str = "<f8",
    files: int = 2,
    comoving_a: float | None = None,
    start: int = 0,
) -> Path:
    """A plotfile of levels, each twice as fine as the one before: arrays [z, y, x] over the whole domain, stored in `boxes` only.

    The coarsest level's cells are numbered from `start`, boxes from zero all the same.
    """
    names, count = list(levels[0]), len(levels)
    counts = [next(iter(level.values())).shape[::-1] for level in levels]
    domains = [shifted(((0, 0, 0), tuple(n - 1 for n in c)), start << i) for i, c in enumerate(counts)]  # type: ignore[arg-type]
    steps = [[(b - a) / n for a, b, n in zip(low, high, c, strict=True)] for c in counts]
    head = ["HyperCLaw-V1.1", str(len(names)), *names, "3", repr(time), str(count - 1)]
    head += [" ".join(map(repr, corner)) + " " for corner in (low, high)]
    head += ["2 " * (count - 1), " ".join(map(text_of, domains)) + " ", "0 " * count]
    head += [" ".join(map(repr, step)) + " " for step in steps] + ["0", "0"]
    path.mkdir(parents=True)
    for number, (level, own) in enumerate(zip(levels, boxes, strict=True)):
        head += [f"{number} {len(own)} {time!r}", "0"]
        for first, last in own:
            for axis in range(3):
                edges = (
                    low[axis] + steps[number][axis] * first[axis],
                    low[axis] + steps[number][axis] * (last[axis] + 1),
                )
                head.append(" ".join(map(repr, edges)))
        head.append(f"Level_{number}/Cell")
        write_level(path / f"Level_{number}", level, own, kind, files, start << number)
    (path / "Header").write_text("\n".join(head) + "\n")
    (path / "job_info").write_text("==== Nyx Job Information ====\n")
    if comoving_a is not None:
        (path / "comoving_a").write_text(f"{comoving_a!r}\n")
    return path


def shifted(box: Box, cells: int) -> Box:
    first, last = (tuple(n + cells for n in corner) for corner in box)
    return first, last  # type: ignore[return-value]


def write_level(
    folder: Path, level: Mapping[str, NDArray[np.floating]], boxes: Sequence[Box], kind: str, files: int, start: int
) -> None:
    """The boxes of a level, dealt out to several files as ranks would."""
    folder.mkdir()
    size = np.dtype(kind).itemsize
    order = range(size, 0, -1) if kind[0] == "<" else range(1, size + 1)
    described = f"FAB (({IEEE[size]}),({size}, ({' '.join(map(str, order))})))"
    places, extremes = [], []
    for number, (first, last) in enumerate(boxes):
        file = folder / f"Cell_D_{number % files:05d}"
        begins = file.stat().st_size if file.exists() else 0
        cells = tuple(slice(a, b + 1) for a, b in zip(reversed(first), reversed(last), strict=True))  # z, y, x
        with file.open("ab") as out:
            out.write(f"{described}{text_of(shifted((first, last), start))} {len(level)}\n".encode())
            for values in level.values():
                out.write(np.ascontiguousarray(values[cells]).astype(kind).tobytes())  # x runs fastest
        places.append(f"FabOnDisk: {file.name} {begins}")
        extremes.append([(float(values[cells].min()), float(values[cells].max())) for values in level.values()])
    head = ["1", "1", str(len(level)), "0", f"({len(boxes)} 0"]
    head += [*(text_of(shifted(box, start)) for box in boxes), ")", str(len(boxes)), *places, ""]
    for which in (0, 1):
        head += [f"{len(boxes)},{len(level)}", *("".join(f"{pair[which]!r}," for pair in row) for row in extremes), ""]
    (folder / "Cell_H").write_text("\n".join(head) + "\n")


def refined(values: NDArray[np.floating]) -> NDArray[np.floating]:
    """Each cell as eight of the next finer level."""
    return values.repeat(2, 0).repeat(2, 1).repeat(2, 2)


def merged(levels: Sequence[NDArray[np.floating]], boxes: Sequence[Sequence[Box]]) -> NDArray[np.floating]:
    """The merged levels of a plotfile: each cell from the finest level that has it."""
    found = levels[0]
    for values, own in zip(levels[1:], boxes[1:], strict=True):
        found = refined(found).copy()
        for first, last in own:
            cells = tuple(slice(a, b + 1) for a, b in zip(reversed(first), reversed(last), strict=True))
            found[cells] = values[cells]
    return found


def read_by_vtk(path: Path, name: str) -> NDArray[np.floating]:
    """The boxes of all levels as VTK's own reader gives them, pasted onto the finest level, (z, y, x); NaN where none lies."""
    from vtkmodules.util.numpy_support import vtk_to_numpy
    from vtkmodules.vtkIOAMR import vtkAMReXGridReader

    reader = vtkAMReXGridReader()
    reader.SetFileName(str(path))
    reader.SetMaxLevel(30)
    reader.SetCellArrayStatus(name, 1)
    reader.Update()
    iterator = reader.GetOutput().NewIterator()
    boxes = []
    iterator.InitTraversal()
    while not iterator.IsDoneWithTraversal():
        boxes.append(iterator.GetCurrentDataObject())
        iterator.GoToNextItem()
    corners = np.array([box.GetBounds() for box in boxes]).reshape(-1, 3, 2)  # [B, 3, 2] x, y, z
    bounds = np.stack([corners[..., 0].min(axis=0), corners[..., 1].max(axis=0)], axis=1)  # [3, 2]
    step = np.min([box.GetSpacing() for box in boxes], axis=0)
    found = np.full(np.rint((bounds[:, 1] - bounds[:, 0]) / step).astype(int)[::-1], np.nan)
    for box in sorted(boxes, key=lambda box: -box.GetSpacing()[0]):  # the finest last
        cells = vtk_to_numpy(box.GetCellData().GetArray(name)).reshape([n - 1 for n in box.GetDimensions()[::-1]])
        for axis, width in enumerate(box.GetSpacing()[::-1]):
            cells = cells.repeat(round(width / step[2 - axis]), axis)
        start = np.rint((np.array(box.GetBounds()[::2]) - bounds[:, 0]) / step).astype(int)[::-1]
        found[tuple(slice(a, a + n) for a, n in zip(start, cells.shape, strict=True))] = cells
    return found
