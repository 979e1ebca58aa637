"""Dumps as CloverLeaf's `visit.f90` prints them: legacy VTK, a file a chunk, one number a line in Fortran's E12.4."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray


def e12_4(value: float) -> str:
    """A number in Fortran's edit descriptor E12.4: 0.1562E+00, and 0.1562+100 where the exponent has three digits."""
    if value == 0:
        return "  0.0000E+00"
    digits, exponent = f"{abs(value):.3e}".split("e")
    power = int(exponent) + 1
    told = f"E{power:+03d}" if abs(power) < 100 else f"{power:+04d}"
    return f"{'-' if value < 0 else ''}0.{digits.replace('.', '')}{told}".rjust(12)


def printed(values: NDArray[np.floating]) -> NDArray[np.float64]:
    """The values after printing and reading."""
    words = np.vectorize(e12_4, otypes=[object])(values)
    return np.vectorize(lambda word: float(word if "E" in word else f"{word[:-4]}E{word[-4:]}"), otypes=[np.float64])(
        words
    )


def write_chunk(
    path: Path,
    axes: Sequence[NDArray[np.float64]],
    on_cells: Mapping[str, NDArray[np.floating]],
    on_points: Mapping[str, NDArray[np.floating]],
) -> None:
    """A file of one chunk: coordinates of its points along x, y and z, arrays [z, y, x] on its cells and on its points."""
    lines = ["# vtk DataFile Version 3.0", "vtk output", "ASCII", "DATASET RECTILINEAR_GRID"]
    lines.append("DIMENSIONS" + "".join(f"{len(axis):12d}" for axis in axes))
    for letter, axis in zip("XYZ", axes, strict=True):
        lines += [f"{letter}_COORDINATES {len(axis):5d} double", *map(e12_4, axis)]
    for word, arrays, size in (
        ("CELL_DATA", on_cells, np.prod([len(axis) - 1 for axis in axes])),
        ("POINT_DATA", on_points, np.prod([len(axis) for axis in axes])),
    ):
        lines += [f"{word} {size:20d}", f"FIELD FieldData {len(arrays)}"]
        for name, values in arrays.items():
            lines += [f"{name} 1 {size:20d} double", *map(e12_4, values.ravel())]
    path.write_text("\n".join(lines) + "\n")


def write_dump(
    folder: Path,
    step: int,
    axes: Sequence[NDArray[np.float64]],
    on_cells: Mapping[str, NDArray[np.floating]],
    on_points: Mapping[str, NDArray[np.floating]],
    cuts: Sequence[Sequence[int]] = ((), (), ()),
) -> list[Path]:
    """A step of a run whose ranks share the mesh, cut before these cells along x, y and z; arrays [z, y, x]."""
    begins = [[0, *cut] for cut in cuts]
    ends = [[*cut, len(axis) - 1] for cut, axis in zip(cuts, axes, strict=True)]
    spans = [list(zip(begin, end, strict=True)) for begin, end in zip(begins, ends, strict=True)]
    paths = []
    for z in spans[2]:
        for y in spans[1]:
            for x in spans[0]:
                path = folder / f"clover.{len(paths) + 1:05d}.{step:05d}.vtk"
                cells = tuple(slice(low, high) for low, high in (z, y, x))
                points = tuple(slice(low, high + 1) for low, high in (z, y, x))
                own = [axis[low : high + 1] for axis, (low, high) in zip(axes, (x, y, z), strict=True)]
                write_chunk(
                    path,
                    own,
                    {name: values[cells] for name, values in on_cells.items()},
                    {name: values[points] for name, values in on_points.items()},
                )
                paths.append(path)
    return paths
