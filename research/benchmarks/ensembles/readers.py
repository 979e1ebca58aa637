"""Measure reading the files of simulation codes beside the readers of their own libraries, and print a table.

    python -m research.benchmarks.ensembles.readers [--sizes 64 256] [--codes amrex cloverleaf ...]

Writes one file of each code and size into a temporary folder (up to 0.5 GB), and reads one array of it. Every reader
runs in a process of its own: ours with its checks and its regular grid, and the library's for the array alone. The
fastest of several times counts. Takes about three minutes.
"""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import psutil
from numpy.typing import NDArray

from insitu.readers.reader import Sampling
from research.benchmarks.page import PROJECT, command_line, table
from research.benchmarks.timing import digits
from tests.support.adios_writer import start
from tests.support.amrex_files import boxes_of, read_by_vtk, write_plotfile
from tests.support.athena_files import uniform, write_athena
from tests.support.cloverleaf_files import e12_4
from tests.support.mpas_files import globe, write_output
from tests.support.openpmd_files import write_openpmd
from tests.support.xcompact3d_files import write_snapshot

EVERY = 0.005  # seconds between memory samples
MOST_TIMES, LASTING = 9, 5.0  # most readings, and seconds after which they end
BOX = 64  # cells along an axis of AMReX's boxes


@dataclass(frozen=True)
class Code:
    """A simulation code: writing a file of size³ values, and the library that reads it.

    `index` is that of the state for our reader, `sampling` gives its resampling by size.
    """

    write: Callable[[Path, int], Path]
    library: str
    read: Callable[[Path], Any]
    array: str = "u"
    index: tuple[int, ...] = ()
    sampling: Callable[[int], Sampling] = lambda size: Sampling()


def values(size: int) -> NDArray[np.float64]:
    """Random numbers (z, y, x)."""
    return np.random.default_rng(0).random((size,) * 3)


def write_amrex(folder: Path, size: int) -> Path:
    levels, boxes = [{"u": values(size), "v": values(size)}], [boxes_of((0, 0, 0), (size,) * 3, BOX)]
    return write_plotfile(folder / "plt00000", levels, boxes, comoving_a=1.0)


def read_vtk(path: Path) -> Any:
    return read_by_vtk(path, "u")


def write_cloverleaf(folder: Path, size: int) -> Path:
    """One chunk with two arrays of the code's seven; every plane has the same numbers, which take long to print."""
    axis = np.linspace(0, 10, size + 1)
    lines = ["# vtk DataFile Version 3.0", "vtk output", "ASCII", "DATASET RECTILINEAR_GRID"]
    lines.append("DIMENSIONS" + f"{size + 1:12d}" * 3)
    for letter in "XYZ":
        lines += [f"{letter}_COORDINATES {size + 1:5d} double", *map(e12_4, axis)]
    lines += [f"CELL_DATA {size**3:20d}", "FIELD FieldData 2"]
    plane = "".join(f"{e12_4(value)}\n" for value in values(size)[0].ravel())
    path = folder / "clover.00001.00000.vtk"
    with path.open("w") as file:
        file.write("\n".join(lines) + "\n")
        for name in "vu":
            file.write(f"{name} 1 {size**3:20d} double\n")
            for _ in range(size):
                file.write(plane)
    return path


def read_pyvista(path: Path) -> Any:
    import pyvista

    mesh: Any = pyvista.read(path)
    return mesh.cell_data["u"].reshape([n - 1 for n in mesh.dimensions[::-1]])


def write_xcompact3d(folder: Path, size: int) -> Path:
    return write_snapshot(folder, 1, {"u": values(size), "v": values(size)}, [np.linspace(0, 1, size)] * 3)


def read_numpy(path: Path) -> Any:
    """Read a file as the code's toolbox does."""
    data = np.fromfile(path.with_name("u-0001.bin"), dtype="<f8")
    return data.reshape((round(len(data) ** (1 / 3)),) * 3, order="F").T


def write_mpas(folder: Path, size: int) -> Path:
    """As many cells as a level of the grid has samples, with half the layers of a cube."""
    made = globe(size * size // 2, relax=2)
    made.arrays["maxLevelCell"][1][:] = size
    field = np.random.default_rng(0).random((1, len(made.ocean), size))
    path = folder / "output.nc"
    write_output(path, made, {"u": field}, [], form="NETCDF3_64BIT_DATA", layers=size)
    return path


def read_netcdf(path: Path) -> Any:
    import netCDF4

    with netCDF4.Dataset(path) as file:
        return file.variables["u"][0]


def write_well(folder: Path, size: int) -> Path:
    path = folder / "a.hdf5"
    with h5py.File(path, "w") as file:
        file.attrs.update(n_trajectories=1, n_spatial_dims=3)
        file["dimensions/time"] = [0.0, 1.0]
        file["dimensions"].attrs["spatial_dims"] = list("xyz")
        for letter in "xyz":
            file[f"dimensions/{letter}"] = np.linspace(0, 1, size)
        file["t0_fields/u"] = np.stack([values(size).astype(np.float32)] * 2)[None]
    return path


def read_h5py(path: Path) -> Any:
    with h5py.File(path) as file:
        return file["t0_fields/u"][0, 0]


def write_adios(folder: Path, size: int) -> Path:
    if start(folder / "run.bp", "BP5", 2, 0.0, (size,) * 3).wait():
        raise RuntimeError("ADIOS2 could not write")
    return folder / "run.bp"


def read_adios(path: Path) -> Any:
    sys.modules["torch"] = None  # type: ignore[assignment]  # which adios2 would load
    import adios2

    with adios2.FileReader(str(path)) as file:
        return file.read("density", step_selection=[0, 1])


def write_openpmd_file(folder: Path, size: int) -> Path:
    return write_openpmd(folder / "data00000100.h5", {100: {"u": {"values": values(size)}}})


def read_openpmd(path: Path) -> Any:
    with h5py.File(path) as file:
        return file["data/100/fields/u"][:]


def write_athena_file(folder: Path, size: int) -> Path:
    """Eight blocks."""
    half = (size // 2,) * 3
    return write_athena(folder / "a.athdf", uniform((2, 2, 2)), root=(size,) * 3, size=half)


def read_athena(path: Path) -> Any:
    """Read the blocks, and put them where they belong."""
    with h5py.File(path) as file:
        blocks, places = file["prim"][0], file["LogicalLocations"][:]  # [B, z, y, x], [B, 3]
        size = blocks.shape[1]
        whole = np.empty(2 * np.array(blocks.shape[1:]), blocks.dtype)
        for block, (x, y, z) in zip(blocks, places * size, strict=True):
            whole[z : z + size, y : y + size, x : x + size] = block
        return whole


def write_store(folder: Path, size: int) -> Path:
    """A netCDF-4 file of a run with two times."""
    import netCDF4

    with netCDF4.Dataset(folder / "a.nc", "w") as file:
        for name, count in (("time", 2), ("z", size), ("y", size), ("x", size)):
            file.createDimension(name, count)
            file.createVariable(name, "f8", (name,))[:] = np.arange(count)
        file.createVariable("u", "f8", ("time", "z", "y", "x"))[:] = [values(size)] * 2
    return folder / "a.nc"


CODES = {
    "amrex": Code(write_amrex, "vtk", read_vtk),
    "cloverleaf": Code(write_cloverleaf, "pyvista", read_pyvista),
    "xcompact3d": Code(write_xcompact3d, "numpy.fromfile", read_numpy),
    "mpas": Code(write_mpas, "netCDF4, cells", read_netcdf, sampling=lambda size: Sampling((size,) * 3)),
    "well": Code(write_well, "h5py", read_h5py, index=(0, 0)),
    "openpmd": Code(write_openpmd_file, "h5py", read_openpmd, index=(100,)),
    "athena": Code(write_athena_file, "h5py", read_athena, "rho"),
    "store": Code(write_store, "netCDF4", read_netcdf, index=(0,)),
    "adios2": Code(write_adios, "adios2", read_adios, "density", (0,)),
}


def read(code: str, path: Path, size: int, ours: bool) -> dict[str, float]:
    """Measure in a separate process: the fewest seconds to read an array once everything is loaded, and peak megabytes."""
    from insitu.readers.files import read_data

    definition = CODES[code]

    def once(path: Path, size: int) -> Any:
        if not ours:
            return definition.read(path)
        how: dict[str, Any] = {"reader": code, "index": definition.index, "sampling": definition.sampling(size)}
        return read_data(path, array=definition.array, **how).values

    with tempfile.TemporaryDirectory() as name:  # a small file first, to load all modules
        once(definition.write(Path(name), 8), 8)
    with Memory() as memory:
        total = float(once(path, size).sum())
    seconds, begun = [], time.perf_counter()
    while len(seconds) < MOST_TIMES and (not seconds or time.perf_counter() - begun < LASTING):
        started = time.perf_counter()
        once(path, size).sum()
        seconds.append(time.perf_counter() - started)
    return {"seconds": min(seconds), "peak": memory.peak, "total": total}


class Memory:
    """Peak megabytes of this process and its children within the context, beyond those before."""

    def __enter__(self) -> Memory:
        self._before = self._now()
        self.peak, self._ended = 0.0, threading.Event()
        self._thread = threading.Thread(target=self._watch)
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._ended.set()
        self._thread.join()

    def _watch(self) -> None:
        while not self._ended.wait(EVERY):
            self.peak = max(self.peak, self._now() - self._before)

    def _now(self) -> float:
        process = psutil.Process()
        return sum(map(_resident, [process, *process.children()])) / 1e6


def _resident(process: psutil.Process) -> int:
    try:
        return int(process.memory_info().rss)
    except psutil.NoSuchProcess:
        return 0


def measure(code: str, size: int) -> list[str]:
    """One row of the table."""
    with tempfile.TemporaryDirectory() as name:
        path = CODES[code].write(Path(name), size)
        megabytes = sum(file.stat().st_size for file in Path(name).rglob("*") if file.is_file()) / 1e6
        times = []
        for who in ("ours", "theirs"):
            command = [
                sys.executable,
                "-m",
                "research.benchmarks.ensembles.readers",
                "--one",
                code,
                str(path),
                str(size),
                who,
            ]
            done = subprocess.run(command, cwd=PROJECT, capture_output=True, text=True, check=True)
            times.append(json.loads(done.stdout.splitlines()[-1]))
    ours, theirs = times
    return [
        code,
        f"{size}³",
        digits(megabytes),
        CODES[code].library,
        digits(ours["seconds"]),
        digits(theirs["seconds"]),
        f"{ours['peak']:.0f}",
        f"{theirs['peak']:.0f}",
    ]


def main() -> None:
    if sys.argv[1:2] == ["--one"]:
        code, path, size, who = sys.argv[2:]
        print(json.dumps(read(code, Path(path), int(size), who == "ours")))
        return
    parser = command_line("ensembles.readers", __doc__)
    parser.add_argument(
        "--sizes", type=int, nargs="+", default=[64, 256], help="values along each axis (default: 64 256)"
    )
    parser.add_argument("--codes", nargs="+", choices=list(CODES), default=list(CODES))
    arguments = parser.parse_args()
    head = ["reader", "values", "MB stored", "library", "s, ours", "s, library", "MB, ours", "MB, library"]
    print(table(head, [measure(code, size) for code in arguments.codes for size in arguments.sizes]))


if __name__ == "__main__":
    main()
