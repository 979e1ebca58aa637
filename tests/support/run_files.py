"""Runs with all their times in one file: netCDF, HDF5 or Zarr."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import h5py
import numpy as np

TIMES = [0.0, 0.5, 1.0]
SIZES = {"z": 3, "y": 5, "x": 6}


def field(run: int, times: int = len(TIMES)) -> np.ndarray:
    return np.random.default_rng(run).random((times, *SIZES.values()))


def data(run: int, times: Any = TIMES, unit: str = "s", **more: Any) -> Any:
    """A run as xarray has it, with a mask that does not change and what goes with time."""
    import xarray

    held = {
        "q": (("time", *SIZES), field(run, len(times)), {"units": "K"}),
        "energy": ("time", np.arange(len(times)) ** 2.0),
    }
    coords = {"time": ("time", times, {"units": unit}), **{n: np.arange(float(s)) for n, s in SIZES.items()}}
    return xarray.Dataset(held | more, coords=coords)


def write(path: Path, run: int, **how: Any) -> None:
    made = data(run, **how)
    if path.suffix == ".nc":
        made.to_netcdf(path)
    elif path.suffix == ".zarr":
        made.to_zarr(path, consolidated=False)
    else:
        with h5py.File(path, "w") as file:
            for name in ("q", "time", *SIZES):
                file[name] = made[name].values
