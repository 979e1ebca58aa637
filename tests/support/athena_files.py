"""Outputs as Athena++ writes them (`src/outputs/athena_hdf5.cpp`): mesh blocks, big-endian, in any order."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import h5py
import numpy as np

Box = tuple[int, tuple[int, int, int]]  # level and logical location, (x, y, z)


def value(x: Any, y: Any, z: Any) -> Any:
    """The density at a place."""
    return x + 10 * y + 100 * z


def write_athena(
    path: Path,
    blocks: Sequence[Box],
    *,
    root: tuple[int, int, int] = (8, 12, 4),
    size: tuple[int, int, int] = (4, 4, 4),
    ends: Sequence[tuple[float, float]] = ((-1.0, 1.0), (0.0, 6.0), (10.0, 11.0)),
    faces: Callable[[float], float] = lambda share: share,
    kind: str = ">f8",
    time: float = 0.5,
    cycle: int = 7,
    coordinates: str = "cartesian",
) -> Path:
    """A file of blocks whose rho is `value` at the cells' centres, its press minus that, and Bcc1 twice that.

    `faces` takes the share of the domain to that of its extent.
    """
    ratio = 1.0 if faces(0.5) == 0.5 else -1.0
    with h5py.File(path, "w") as file:
        file.attrs.update(
            {
                "NumCycles": np.int32(cycle),
                "Time": time,
                "Coordinates": np.bytes_(coordinates),
                "NumMeshBlocks": np.int32(len(blocks)),
                "MeshBlockSize": np.array(size, ">i4"),
                "RootGridSize": np.array(root, ">i4"),
                "MaxLevel": np.int32(max(level for level, _ in blocks)),
                "NumVariables": np.array([2, 1], ">i4"),
                "DatasetNames": np.array(["prim", "B"], "S21"),
                "VariableNames": np.array(["rho", "press", "Bcc1"], "S21"),
            }
        )
        for axis, (low, high) in enumerate(ends):
            file.attrs[f"RootGridX{axis + 1}"] = np.array([low, high, ratio])
        held: dict[str, list[Any]] = {f"x{axis + 1}{which}": [] for axis in range(3) for which in "fv"}
        prim = []
        for level, place in blocks:
            centres = []
            for axis, (low, high) in enumerate(ends):
                cells = (np.arange(size[axis] + 1) + place[axis] * size[axis]) / (root[axis] << level)
                own = np.array([low + (high - low) * faces(share) for share in cells])
                centres.append((own[1:] + own[:-1]) / 2)
                held[f"x{axis + 1}f"].append(own)
                held[f"x{axis + 1}v"].append(centres[-1])
            x, y, z = centres
            prim.append(value(x[None, None, :], y[None, :, None], z[:, None, None]))
        for name, rows in held.items():
            file[name] = np.array(rows, ">f4")
        rho = np.array(prim)
        file["prim"], file["B"] = np.array([rho, -rho], kind), np.array([2 * rho], kind)
        file["Levels"] = np.array([level for level, _ in blocks], ">i4")
        file["LogicalLocations"] = np.array([place for _, place in blocks], ">i8")
    path.with_name(f"{path.name}.xdmf").write_text('<?xml version="1.0" ?>\n<Xdmf Version="2.0"></Xdmf>\n')
    return path


def uniform(counts: tuple[int, int, int] = (2, 3, 1), level: int = 0) -> list[Box]:
    """All blocks of one level, the last first."""
    return [(level, (x, y, z)) for z in range(counts[2]) for y in range(counts[1]) for x in range(counts[0])][::-1]
