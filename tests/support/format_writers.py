"""One ensemble, a blob that grows with `a`, written in many formats by the formats' own libraries where these exist."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from tests.support.amrex_files import boxes_of, write_plotfile
from tests.support.cloverleaf_files import printed, write_dump
from tests.support.xcompact3d_files import write_snapshot

COUNTS, SPACING, ORIGIN = (8, 10, 12), (0.25, 0.2, 0.15), (1.0, -1.0, 2.0)  # x, y, z
WIDTHS = (1.0, 2.0, 3.0, 4.0, 5.0, 6.0)
Writer = Callable[[Path, float], Path]


def axes(origin: tuple[float, ...] = ORIGIN) -> tuple[NDArray[np.float64], ...]:
    """Coordinates of the samples along x, y and z."""
    return tuple(low + step * np.arange(n) for low, step, n in zip(origin, SPACING, COUNTS, strict=True))


def values(width: float) -> NDArray[np.float32]:
    """The field [z, y, x], from 0 to 1, different along each axis."""
    x, y, z = (np.linspace(-1, 1, n) for n in COUNTS)
    squares = 2 * (z[:, None, None] - 0.1) ** 2 + (y[:, None] + 0.2) ** 2 + 0.5 * x**2
    return np.asarray(np.exp(-squares * 6 / (1 + width)), np.float32)


def edges() -> tuple[NDArray[np.float64], ...]:
    """Coordinates of the borders of cells whose centres are the samples, along x, y and z."""
    return tuple(low + step * (np.arange(n + 1) - 0.5) for low, step, n in zip(ORIGIN, SPACING, COUNTS, strict=True))


def image(width: float) -> Any:
    import pyvista

    grid = pyvista.ImageData(dimensions=COUNTS, spacing=SPACING, origin=ORIGIN)
    grid["f"] = values(width).ravel()
    return grid


def rectilinear(width: float) -> Any:
    import pyvista

    grid = pyvista.RectilinearGrid(*axes())
    grid["f"] = values(width).ravel()
    return grid


def saved(mesh: Callable[[float], Any], suffix: str) -> Writer:
    """A writer of VTK's files."""

    def write(folder: Path, width: float) -> Path:
        mesh(width).save(folder / f"dump{suffix}")
        return folder / f"dump{suffix}"

    return write


def vtm(folder: Path, width: float) -> Path:
    import pyvista

    pyvista.MultiBlock([image(width)]).save(folder / "dump.vtm")
    return folder / "dump.vtm"


def npz(folder: Path, width: float) -> Path:
    np.savez(folder / "dump.npz", f=values(width), spacing=SPACING, origin=ORIGIN)
    return folder / "dump.npz"


def hdf5(folder: Path, width: float) -> Path:
    with h5py.File(folder / "dump.h5", "w") as file:
        file["f"] = values(width)
        for number, (name, along) in enumerate(zip("zyx", reversed(axes()), strict=True)):
            file[name] = along
            file[name].make_scale(name)
            file["f"].dims[number].attach_scale(file[name])
    return folder / "dump.h5"


def dataset(width: float) -> Any:
    import xarray

    x, y, z = axes()
    return xarray.Dataset({"f": (("z", "y", "x"), values(width))}, {"x": x, "y": y, "z": z})


def netcdf(folder: Path, width: float) -> Path:
    dataset(width).to_netcdf(folder / "dump.nc")
    return folder / "dump.nc"


def zarr(folder: Path, width: float) -> Path:
    dataset(width).to_zarr(folder / "dump.zarr")
    return folder / "dump.zarr"


def amrex(folder: Path, width: float) -> Path:
    low, high = ([float(along[end]) for along in edges()] for end in (0, -1))
    return write_plotfile(
        folder / "plt00000", [{"f": values(width)}], [boxes_of((0, 0, 0), COUNTS, 4)], low=low, high=high
    )


def cloverleaf(folder: Path, width: float) -> Path:
    points = np.zeros([n + 1 for n in reversed(COUNTS)])
    return write_dump(folder, 7, edges(), {"f": values(width)}, {"xvel": points}, ((4,), (), (6,)))[0]


def xcompact3d(folder: Path, width: float) -> Path:
    return write_snapshot(folder, 3, {"f": values(width)}, axes((0.0, 0.0, 0.0)))


WRITERS: dict[str, Writer] = {
    "vti": saved(image, ".vti"),
    "vtr": saved(rectilinear, ".vtr"),
    "vtk": saved(image, ".vtk"),
    "vtu": saved(lambda width: image(width).cast_to_unstructured_grid(), ".vtu"),
    "vtm": vtm,
    "npz": npz,
    "hdf5": hdf5,
    "netcdf": netcdf,
    "zarr": zarr,
    "amrex": amrex,
    "cloverleaf": cloverleaf,
    "xcompact3d": xcompact3d,
}
PRINTED = {"cloverleaf": printed}  # what a text of few digits leaves of the values
PLACES = {"xcompact3d": (0.0, 0.0, 0.0)}  # its files have no origin
