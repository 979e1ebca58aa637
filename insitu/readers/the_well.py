"""Files of The Well: HDF5 with all trajectories and steps of simulations that share their parameters.

    attributes    simulation_parameters, the names of further attributes; n_trajectories, n_spatial_dims
    dimensions/   time (step,) or (trajectory, step); x, y, z; attribute spatial_dims, the order of the axes
    t0_fields/    scalars (trajectory, step, x, y, z); t1_fields/ vectors and t2_fields/ tensors with one and two more axes
    scalars/      numbers of the file, of each trajectory or of each step

"Data format" in the documentation of The Well (Ohana et al. 2024, "The Well: a large-scale collection of diverse physics
simulations for machine learning").  Components are called as its own library calls them: velocity_x, stress_xy.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from insitu.readers.arrays import HDF5, Arrays, StoredArray, check_room, open_arrays
from insitu.readers.attributes import as_text
from insitu.readers.reader import Reader, Sampling, StoredState

ORDERS = ("t0_fields", "t1_fields", "t2_fields")
TRAJECTORY, STEP = "trajectory", "step"


def recognizes(path: Path) -> bool:
    """True if an HDF5 file is laid out as those of The Well are."""
    try:
        if path.suffix.lower() not in HDF5 or not path.is_file():
            return False
        with h5py.File(path, "r") as file:
            return "n_trajectories" in file.attrs and "dimensions/time" in file and ORDERS[0] in file
    except (OSError, RuntimeError, KeyError, ValueError):
        return False


def records(path: Path, sampling: Sampling) -> list[StoredState]:
    """Every step of every trajectory, with the file's parameters, the trajectory's own numbers, its number, and the time."""
    with _checked(path) as arrays:
        trajectories, steps, time = _counts(arrays)
        check_room(1000 * trajectories * steps, f"{trajectories} trajectories of {steps} steps")
        times = np.broadcast_to(time.read().astype(np.float64), (trajectories, steps))
        if not np.isfinite(times).all():
            raise ValueError("dimensions/time must hold finite numbers")
        common = _parameters(arrays.attrs[""])
        own = {a.stem: a.read() for a in arrays.arrays.values() if a.group == "scalars" and _is_own(a, trajectories)}
        states = []
        for t in range(trajectories):
            says = {**common, **{name: float(values[t]) for name, values in own.items()}, TRAJECTORY: float(t)}
            states += [StoredState((t, s), {**says, "time": float(times[t, s])}) for s in range(steps)]
        return states


@contextmanager
def opens(path: Path) -> Iterator[Arrays]:
    """The fields of a file as (trajectory, step, x, y, z), with the coordinates of their axes; values are read when asked for."""
    with _checked(path) as source:
        trajectories, steps, _ = _counts(source)
        about = source.attrs["dimensions"]
        letters = [as_text(name) for name in np.atleast_1d(about.get("spatial_dims", ()))]
        if len(letters) != 3 or any(f"dimensions/{letter}" not in source.arrays for letter in letters):
            raise ValueError(f"its fields have the axes {letters}, and so no volume, or no coordinates along them")
        arrays = {letter: _renamed(source.arrays[f"dimensions/{letter}"], letter) for letter in letters}
        for order, group in enumerate(ORDERS):
            for array in (a for a in source.arrays.values() if a.group == group):
                arrays |= {a.name: a for a in _components(array, letters, order, (trajectories, steps))}
        yield Arrays(arrays, {"": {}})


@contextmanager
def _checked(path: Path) -> Iterator[Arrays]:
    with open_arrays(path) as arrays:
        if "dimensions" not in arrays.attrs or "dimensions/time" not in arrays.arrays:
            raise ValueError(f"it is not a file of The Well, which has dimensions/time; it holds {arrays}")
        yield arrays


def _counts(arrays: Arrays) -> tuple[int, int, StoredArray]:
    """The numbers of trajectories and steps, and the array of times."""
    time, declared = arrays.arrays["dimensions/time"], np.asarray(arrays.attrs[""].get("n_trajectories", 1))
    if (
        declared.size != 1
        or declared.dtype.kind not in "iu"
        or declared.ravel()[0] < 1
        or not time.is_real
        or not 1 <= len(time.shape) <= 2
    ):
        raise ValueError(f"n_trajectories must be a whole number and {time!r} have a number a step, got {declared}")
    trajectories, steps = int(declared.ravel()[0]), time.shape[-1]
    if len(time.shape) == 2 and time.shape[0] != trajectories:
        raise ValueError(f"{time!r} must have a row for each of {trajectories} trajectories")
    return trajectories, steps, time


def _parameters(attrs: Mapping[str, Any]) -> dict[str, float]:
    """The numbers that the file calls its parameters."""
    names = [as_text(name) for name in np.ravel(attrs.get("simulation_parameters", ()))]
    by_name = {name: np.asarray(attrs[name]) for name in names if name in attrs}
    return {
        name: float(v.ravel()[0])
        for name, v in by_name.items()
        if v.size == 1 and v.dtype.kind in "fiu" and np.isfinite(v).all()
    }


def _is_own(array: StoredArray, trajectories: int) -> bool:
    """True if an array has a number for each trajectory."""
    varies, steps = (bool(np.all(array.attrs.get(f"{what}_varying", False))) for what in ("sample", "time"))
    return array.dtype.kind in "fiu" and varies and not steps and array.shape == (trajectories,)


def _components(array: StoredArray, letters: Sequence[str], order: int, states: tuple[int, int]) -> list[StoredArray]:
    """The components of a field that varies along all three axes, each (trajectory, step, axis, axis, axis)."""
    varying = [bool(np.all(array.attrs.get(f"{what}_varying", True))) for what in ("sample", "time")]
    lead = tuple(n for n, varies in zip(states, varying, strict=True) if varies)
    shape = array.shape[len(lead) :]
    if not array.is_real or array.shape[: len(lead)] != lead or not np.all(array.attrs.get("dim_varying", True)):
        return []
    if len(shape) != 3 + order or any(n != len(letters) for n in shape[3:]):
        return []
    dims, components = (TRAJECTORY, STEP, *letters), []
    for which in itertools.product(range(len(letters)), repeat=order):
        suffix = "_" + "".join(letters[i] for i in which) if order else ""
        fetch = _fetch(array, varying, which)
        components.append(
            StoredArray(array.name + suffix, (*states, *shape[:3]), array.dtype, dims, array.attrs, fetch)
        )
    return components


def _fetch(array: StoredArray, varying: Sequence[bool], which: tuple[int, ...]) -> Callable[[tuple[int, ...]], Any]:
    """Reads one component of one state, the same for all states that a field does not vary with."""

    def fetch(index: tuple[int, ...]) -> Any:
        own = tuple(i for i, varies in zip(index, varying, strict=True) if varies)
        return array.fetch((*own, slice(None), slice(None), slice(None), *which) if which else own)  # type: ignore[arg-type]

    return fetch


def _renamed(array: StoredArray, name: str) -> StoredArray:
    return StoredArray(name, array.shape, array.dtype, (name,), array.attrs, array.fetch)


READER = Reader("well", "The Well, HDF5 (trajectory, step, x, y, z)", recognizes, records, opens=opens)
