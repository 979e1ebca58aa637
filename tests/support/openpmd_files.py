"""openPMD files as WarpX, PIConGPU and openpmd-api write them, by h5py: attributes as the standard (1.1.0) has them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

Values = NDArray[Any] | tuple[float, tuple[int, ...]]  # or a constant and its shape
FORCE = (1.0, 1.0, -3.0, -1.0, 0.0, 0.0, 0.0)  # of V/m: length, mass, time, current, ...
STEPS, STARTS = {"x": 1.0, "y": 2.0, "z": 3.0}, {"x": 10.0, "y": 20.0, "z": 30.0}


def field(seed: int = 0) -> NDArray[np.float64]:
    """Values [z, y, x] of a mesh of 6 x 5 x 4 points."""
    return np.random.default_rng(seed).random((4, 5, 6))


def write_openpmd(path: Path, iterations: Mapping[int, Mapping[str, Mapping[str, Any]]], time: float = 0.5) -> Path:
    """A file of iterations, each of records by name, given by the arguments of `write_record`; iteration n is at n * `time`."""
    with h5py.File(path, "w") as file:
        file.attrs["openPMD"], file.attrs["openPMDextension"] = np.bytes_("1.1.0"), np.uint32(0)
        file.attrs["basePath"], file.attrs["meshesPath"] = np.bytes_("/data/%T/"), np.bytes_("fields/")
        file.attrs["iterationEncoding"] = np.bytes_("groupBased")
        for number, meshes in iterations.items():
            group = file.create_group(f"data/{number}")
            group.attrs["time"], group.attrs["dt"], group.attrs["timeUnitSI"] = time * number, time, 1.0
            for name, about in meshes.items():
                write_record(group.require_group("fields"), name, **about)
    return path


def write_record(
    group: h5py.Group,
    name: str,
    values: Values | Mapping[str, Values],
    labels: Sequence[str] = ("z", "y", "x"),
    order: str = "C",
    position: Mapping[str, float] | None = None,
    unit: float = 1.0,
    **other: Any,
) -> None:
    """A record: arrays in the order of their axes, several by component; `other` attributes replace or, None, leave out the usual.

    `labels` are listed as the writing code does: from the slowest axis of the file on with `order` C, to it with F.
    """
    parts = {"": values} if not isinstance(values, Mapping) else values
    for part, held in parts.items():
        place = f"{name}/{part}" if part else name
        if isinstance(held, tuple):
            component: Any = group.create_group(place)
            component.attrs["value"], component.attrs["shape"] = held[0], np.array(held[1], np.uint64)
        else:
            component = group.create_dataset(place, data=held)
        within = position or {}
        component.attrs["position"] = [within.get(letter, 0.0) for letter in labels]
        component.attrs["unitSI"] = unit
    about = {
        "geometry": np.bytes_("cartesian"),
        "dataOrder": np.bytes_(order),
        "axisLabels": np.array(labels, "S1"),
        "gridSpacing": [STEPS.get(letter, 1.0) for letter in labels],
        "gridGlobalOffset": [STARTS.get(letter, 0.0) for letter in labels],
        "gridUnitSI": 1.0,
        "unitDimension": FORCE,
        "timeOffset": 0.0,
    }
    for key, value in {**about, **other}.items():
        if value is not None:
            group[name].attrs[key] = value
