"""Measure reading and rendering of ensembles by the format of their files, and print a table.

    python -m research.benchmarks.ensembles.files [--members 20] [--size 64] [--formats vti npy ...]

Writes its files into a temporary folder. Images are tiny (12 views of 8 x 8 pixels of one isosurface), so that reading
dominates. A run takes a few minutes. Each format is rendered by one worker process of its own. Its peak memory is
compared between a quarter of the members and all, and must stay the same.
"""

from __future__ import annotations

import json
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from research.benchmarks.page import PROJECT, command_line, table
from research.benchmarks.timing import digits

SPACING = (0.1, 0.1, 0.1)
PATTERN = "run_{{width}}.{suffix}"


def blob(width: float, size: int) -> NDArray[np.float32]:
    """A Gaussian blob with a ripple that does not compress, (z, y, x)."""
    axis = np.linspace(-1.0, 1.0, size, dtype=np.float32)
    squares = axis[:, None, None] ** 2 + axis[:, None] ** 2 + axis**2
    noise = np.random.default_rng(0).random((size,) * 3, dtype=np.float32)
    return np.exp(-squares / np.float32(2 * width**2)) + np.float32(1e-3) * noise


def write_image(path: Path, values: NDArray[np.float32]) -> None:
    import pyvista

    made = pyvista.ImageData(dimensions=values.shape[::-1], spacing=SPACING)
    made["f"] = values.ravel()
    made.save(path)


def write_hdf5(path: Path, values: NDArray[np.float32]) -> None:
    with h5py.File(path, "w") as file:
        file["f"] = values
        file.attrs["spacing"] = SPACING


def labelled(values: NDArray[np.float32]) -> Any:
    import xarray

    places = {name: SPACING[0] * np.arange(size) for name, size in zip("zyx", values.shape, strict=True)}
    return xarray.Dataset({"f": (("z", "y", "x"), values)}, coords=places)


WRITERS: dict[str, Callable[[Path, NDArray[np.float32]], Any]] = {
    "npy": np.save,
    "npz": lambda path, values: np.savez_compressed(path, f=values, spacing=SPACING),
    "vti": write_image,
    "h5": write_hdf5,
    "nc": lambda path, values: labelled(values).to_netcdf(path, engine="h5netcdf"),
    "zarr": lambda path, values: labelled(values).to_zarr(path, consolidated=False),
}


def write(folder: Path, suffix: str, members: int, size: int) -> float:
    """Files of one format; returns the megabytes of one."""
    for width in np.linspace(0.2, 0.6, members):
        WRITERS[suffix](folder / f"run_{width:.4f}.{suffix}", blob(float(width), size))
    files = [path for path in folder.rglob("*") if path.is_file()]
    return sum(path.stat().st_size for path in files) / members / 1e6


def render(folder: Path, suffix: str, members: int) -> dict[str, float]:
    """In a process of its own: milliseconds to read a member, seconds to render all, and the worker's peak megabytes."""
    from catalogs.vocabulary.appearance import Isosurface
    from catalogs.vocabulary.scene import ViewPlan
    from insitu.ensembles.ensemble import run_ensemble
    from insitu.ensembles.files import FileEnsemble
    from insitu.fields.location import FieldLocation
    from insitu.members.planning import PlanOptions
    from insitu.readers.tables import match_files
    from render import to_grid

    place: dict[str, Any] = {"spacing": SPACING} if suffix == "npy" else {}
    ensemble = FileEnsemble.of(match_files(PATTERN.format(suffix=suffix), folder), location=FieldLocation(**place))
    planned = ensemble.members()[:members]
    read = []
    for member in planned:
        started = time.perf_counter()
        to_grid(ensemble.field(member, lambda fraction: None))
        read.append(1e3 * (time.perf_counter() - started))
    options = PlanOptions(ensemble.space, (Isosurface("core", 0.5),), ViewPlan(frequency=1, width=8, height=8))
    started = time.perf_counter()
    result = run_ensemble(folder / f"{members}.cdb", planned, ensemble, options, workers=1)
    seconds = time.perf_counter() - started
    if result.failures:
        raise RuntimeError(str(result))
    peak = resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss / 1024
    return {"read": float(np.median(read)), "seconds": seconds, "peak": peak}


def measure(suffix: str, members: int, size: int) -> list[str]:
    """One row of the table."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        megabytes = write(folder, suffix, members, size)
        runs = []
        for count in (max(2, members // 4), members):
            command = [
                sys.executable,
                "-m",
                "research.benchmarks.ensembles.files",
                "--one",
                str(folder),
                suffix,
                str(count),
            ]
            done = subprocess.run(command, cwd=PROJECT, capture_output=True, text=True, check=True)
            runs.append(json.loads(done.stdout.splitlines()[-1]))
    few, all_ = runs
    return [
        f".{suffix}",
        digits(megabytes),
        digits(all_["read"]),
        digits(all_["seconds"]),
        f"{few['peak']:.0f}",
        f"{all_['peak']:.0f}",
    ]


def main() -> None:
    if sys.argv[1:2] == ["--one"]:
        folder, suffix, members = sys.argv[2:]
        print(json.dumps(render(Path(folder), suffix, int(members))))
        return
    parser = command_line("ensembles.files", __doc__)
    parser.add_argument("--members", type=int, default=20)
    parser.add_argument("--size", type=int, default=64, help="values along each axis (default: 64)")
    parser.add_argument("--formats", nargs="+", choices=list(WRITERS), default=list(WRITERS))
    arguments = parser.parse_args()
    few = max(2, arguments.members // 4)
    head = [
        "format",
        "MB a file",
        "ms to read",
        f"s for {arguments.members}",
        f"peak MB, {few}",
        f"peak MB, {arguments.members}",
    ]
    print(table(head, [measure(suffix, arguments.members, arguments.size) for suffix in arguments.formats]))


if __name__ == "__main__":
    main()
