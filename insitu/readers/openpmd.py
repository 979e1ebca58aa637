"""Meshes of openPMD files in HDF5, as WarpX, PIConGPU and FBPIC write them: every iteration a state, one or many in a file.

    /data/100/             an iteration: time, timeUnitSI
      fields/rho           a scalar record; E/x, E/y, E/z the components of a vector record, called E_x, E_y, E_z
                           axisLabels, dataOrder, gridSpacing, gridGlobalOffset, gridUnitSI; position and unitSI of a component

Lengths, times and values are in SI units: the file's numbers times its factors.  A constant component is an empty group with a
value and a shape.  Source: openPMD standard 1.1.0, "Mesh Based Records", https://github.com/openPMD/openPMD-standard.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from catalogs.vocabulary.words import shortened
from insitu.fields.field import Field
from insitu.readers.arrays import HDF5, check_room
from insitu.readers.attributes import as_text
from insitu.readers.reader import Reader, Sampling, StoredState, chosen_array

BASES = ("kg", "m", "s", "A", "K", "mol", "cd")  # units in the order in which they are written,
PLACES = (1, 0, 2, 3, 4, 5, 6)  # and where unitDimension has their powers
NUMBER = re.compile(r"\d{1,19}")


@dataclass(frozen=True, eq=False)
class MeshComponent:
    """One array of a record: a data set, or the group that stands for a constant one; `record` has the mesh's attributes."""

    record: h5py.Group | h5py.Dataset
    node: h5py.Group | h5py.Dataset

    @property
    def shape(self) -> tuple[int, ...]:
        return self.node.shape if isinstance(self.node, h5py.Dataset) else _whole_numbers(self.node.attrs["shape"])


def recognizes(path: Path) -> bool:
    """True if an HDF5 file says that it follows openPMD."""
    try:
        if path.suffix.lower() not in HDF5 or not path.is_file():
            return False
        with h5py.File(path, "r") as file:
            return "openPMD" in file.attrs
    except (OSError, RuntimeError, KeyError, ValueError):
        return False


def records(path: Path, sampling: Sampling) -> list[StoredState]:
    """Every iteration, with its time in seconds and its number; raises ValueError where the file has none."""
    with _iterations(path) as iterations:
        return [StoredState((n,), {**_time(group), "iteration": float(n)}) for n, group in iterations.items()]


def read(path: Path, array: str | None, index: tuple[int, ...], sampling: Sampling) -> Field:
    """A component of a mesh at an iteration, `index`, which may be left out where the file has only one."""
    with _iterations(path) as groups:
        if not index and len(groups) > 1:
            raise ValueError(
                f"it has {len(groups)} iterations, {shortened(list(map(str, groups)), 8)}: make an ensemble of them, or name "
                "one as index"
            )
        number = index[0] if index else next(iter(groups))
        if number not in groups:
            raise ValueError(f"there is no iteration {number}, it has {shortened(list(map(str, groups)), 8)}")
        components = _components(groups[number], _text(groups[number].file, "meshesPath", ""))
        name = _chosen(array, components)
        try:
            return _field(components[name], name, _time(groups[number]).get("time"))
        except (ValueError, OSError, RuntimeError, KeyError) as error:
            raise ValueError(f"{name}: {error}") from None


# ---- iterations and records ------------------------------------------------------------------------------------------


@contextmanager
def _iterations(path: Path) -> Iterator[dict[int, h5py.Group]]:
    """The groups of a file's iterations by their numbers, in order."""
    with h5py.File(path, "r") as file:
        base = _text(file, "basePath", "/data/%T/")
        above, _, below = base.partition("%T")
        if below.strip("/") or above.strip("/") == base.strip("/"):
            raise ValueError(f"its basePath must end with %T, the number of an iteration, got {base[:60]!r}")
        parent = _inside(file, above)
        children = {int(name): _child(parent, name) for name in parent or () if NUMBER.fullmatch(name)}
        groups = {number: group for number, group in sorted(children.items()) if isinstance(group, h5py.Group)}
        if not groups:
            raise ValueError(f"it has no iteration, such as {base.replace('%T', '100')}")
        yield groups


def _components(iteration: h5py.Group, meshes: str) -> dict[str, MeshComponent]:
    """All components of an iteration's meshes, by name."""
    components = {}
    parent = _inside(iteration, meshes) if meshes.strip("/") else None
    for name in parent or ():
        record = _child(parent, name)
        if _is_component(record):
            components[name] = MeshComponent(record, record)
        elif isinstance(record, h5py.Group):
            inner = {f"{name}_{part}": _child(record, part) for part in record}
            components |= {full: MeshComponent(record, node) for full, node in inner.items() if _is_component(node)}
    return components


def _is_component(node: Any) -> bool:
    if isinstance(node, h5py.Dataset):
        return node.shape is not None
    return isinstance(node, h5py.Group) and "value" in node.attrs and "shape" in node.attrs


def _chosen(array: str | None, components: Mapping[str, MeshComponent]) -> str:
    """The component that is asked for, as E_x or E/x, or the only one with three axes."""
    wanted = None if array is None else array.replace("/", "_")
    if wanted in components:
        return str(wanted)
    return chosen_array(array, [name for name, component in components.items() if len(component.shape) == 3])


def _inside(group: h5py.Group, path: str) -> h5py.Group | None:
    """The group at a path below another; None where there is none."""
    for part in path.strip("/").split("/"):
        child = _child(group, part) if part in group else None
        if not isinstance(child, h5py.Group):
            return None
        group = child
    return group


def _child(group: h5py.Group, name: str) -> Any:
    """The item of a group by this name; None where that is a link, which could lead to another file."""
    return group[name] if isinstance(group.get(name, getlink=True), h5py.HardLink) else None


# ---- one component ---------------------------------------------------------------------------------------------------


def _field(component: MeshComponent, name: str, time: float | None) -> Field:
    order, spacing, origin = _place(component)
    values = _values(component).transpose([order.index(letter) for letter in "zyx"])
    return Field(values, spacing, origin, name, _unit(component.record), time)


def _place(component: MeshComponent) -> tuple[str, tuple[float, float, float], tuple[float, float, float]]:
    """The letters of an array's axes in its own order, and spacing and place of the first value, (x, y, z), metres."""
    about = component.record.attrs
    geometry = _text(component.record, "geometry", "cartesian")
    if geometry != "cartesian":
        raise ValueError(
            f"its geometry is {geometry[:40]!r}, and only a cartesian mesh can be rendered: interpolate it onto one first"
        )
    if len(component.shape) != 3 or min(component.shape) < 2:
        raise ValueError(f"it has {component.shape} values, and so no volume")
    labels = [as_text(label) for label in np.ravel(about.get("axisLabels", ()))]
    if sorted(labels) != ["x", "y", "z"]:
        raise ValueError(f"its axisLabels must be x, y and z in the order of its axes, got {labels}")
    data_order = _text(component.record, "dataOrder", "C")
    if data_order not in ("C", "F"):
        raise ValueError(f"its dataOrder must be C or F, got {data_order[:40]!r}")
    steps, starts = _numbers(about, "gridSpacing"), _numbers(about, "gridGlobalOffset")
    unit, within = _numbers(about, "gridUnitSI", 1.0), _numbers(component.node.attrs, "position", 0.0)
    if (steps * unit <= 0).any():
        raise ValueError(f"its gridSpacing and gridUnitSI must be positive, got {steps} and {unit}")
    at = [labels.index(letter) for letter in "xyz"]
    x, y, z = (steps * unit)[at].tolist()
    i, j, k = ((starts + within * steps) * unit)[at].tolist()
    # Fortran lists its axes from the fastest on, and HDF5 from the slowest.
    return "".join(labels if data_order == "C" else reversed(labels)), (x, y, z), (i, j, k)


def _values(component: MeshComponent) -> NDArray[Any]:
    """The values in SI units, in the array's own order; as they are stored where their factor is 1."""
    node, factor = component.node, float(_numbers(component.node.attrs, "unitSI", 1.0)[0])
    kind = node.dtype if isinstance(node, h5py.Dataset) else np.asarray(node.attrs["value"]).dtype
    if kind.kind not in "fiu":
        raise ValueError(f"its values must be real numbers, got {kind}: choose another array")
    check_room(
        math.prod(component.shape) * max(4, kind.itemsize if factor == 1 else 8), f"its {component.shape} values"
    )
    if isinstance(node, h5py.Group):
        value = np.ravel(node.attrs["value"])
        if value.size != 1:
            raise ValueError(f"a constant component has one value, got {value}")
        values = np.full(component.shape, value[0])
    elif node.is_virtual or node.external:
        raise ValueError("its values lie in other files: only what lies in the file itself is read")
    else:
        values = node[()]
    return values if factor == 1 else values * np.float64(factor)


def _unit(record: h5py.Group | h5py.Dataset) -> str:
    """The SI unit by the powers in unitDimension, "" for a pure number."""
    powers = np.ravel(record.attrs.get("unitDimension", ()))
    if powers.size != len(BASES) or powers.dtype.kind not in "fiu":
        return ""
    named = zip(BASES, powers[list(PLACES)].tolist(), strict=True)
    return " ".join(base if power == 1 else f"{base}^{power:g}" for base, power in named if power)


def _time(iteration: h5py.Group) -> dict[str, float]:
    """The time in seconds, where the iteration says it."""
    if "time" not in iteration.attrs:
        return {}
    return {"time": float((_numbers(iteration.attrs, "time") * _numbers(iteration.attrs, "timeUnitSI", 1.0))[0])}


def _numbers(about: Mapping[str, Any], name: str, default: float | None = None) -> NDArray[np.float64]:
    """The finite numbers of an attribute, one for each axis: three, or one for all."""
    values = np.ravel(about.get(name, () if default is None else default))
    if values.size not in (1, 3) or values.dtype.kind not in "fiu" or not np.isfinite(values).all():
        raise ValueError(f"its {name} must be 3 finite numbers, or one, got {values if values.size else 'none'}")
    return np.broadcast_to(values.astype(np.float64), 3)


def _whole_numbers(value: Any) -> tuple[int, ...]:
    values = np.ravel(value)
    if values.dtype.kind not in "iu" or not 1 <= values.size <= 32:
        raise ValueError(f"the shape of a constant component must be whole numbers, got {values}")
    return tuple(values.tolist())


def _text(node: h5py.Group | h5py.Dataset, name: str, default: str) -> str:
    """A word among attributes; writers differ in how they store one."""
    words = np.ravel(node.attrs.get(name, default))
    return as_text(words[0]) if words.size == 1 else default


READER = Reader(
    "openpmd", "openPMD in HDF5 (WarpX, PIConGPU, FBPIC)", recognizes, records, read, grows=True, units={"time": "s"}
)
