"""`initialize`, `execute`, `finalize` on a mesh as Conduit's mesh Blueprint describes it, for who comes from Ascent or Catalyst.

A mesh is a nested mapping, or one of paths such as "coordsets/coords/type", or a `conduit.Node`.  Conduit is not needed.
Source: https://llnl-conduit.readthedocs.io/en/latest/blueprint_mesh.html

Limits: one domain; a 3D uniform or rectilinear coordset with the topology that spans it; scalar fields on vertices or
elements.  Anything else is refused by name.

Examples
--------
>>> import insitu
>>> from blobs import APPEARANCE, simulate
>>> from insitu.bindings.blueprint import initialize
>>> axis = {"i": 24, "j": 24, "k": 24}
>>> mesh = {
...     "coordsets": {"coords": {"type": "uniform", "dims": axis, "spacing": {"dx": 2 / 23, "dy": 2 / 23, "dz": 2 / 23}}},
...     "topologies": {"mesh": {"type": "uniform", "coordset": "coords"}},
...     "fields": {"density": {"association": "vertex", "topology": "mesh", "values": simulate(0.8, 0.3)}},
... }
>>> views = insitu.ViewPlan(frequency=1, width=32, height=32)
>>> pictures = initialize("flow.cdb", space={"separation": (0.6, 1.0)}, appearances=APPEARANCE, views=views)
>>> pictures.execute(mesh, {"separation": 0.8}).images
12
>>> pictures.finalize()
"""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from insitu.hook.session import Session
from insitu.members.result import RenderedMember

AXES = (("x", "i"), ("y", "j"), ("z", "k"))
ASSOCIATIONS = ("vertex", "element")
MOST_POINTS = 2**31 - 1  # along an axis, in VTK
WITHOUT_VTK = {"e": np.float32, "g": np.float64}  # types that VTK lacks, and what stands for them


@dataclass(frozen=True)
class BlueprintSession:
    """A catalog that meshes are rendered into, made by `initialize`."""

    session: Session

    def execute(self, mesh: Any, parameters: Mapping[str, float], **options: Any) -> RenderedMember:
        """Render one member: `mesh` as the module says, the rest as `Session.render_member` takes it.

        `state/time` is the member's time unless `time` is given; `state/cycle` and `state/domain_id` are recorded.
        Raises ValueError naming the path in the mesh that can't be drawn; nothing was written then.
        """
        try:
            leaves = dict(_leaves(mesh))
            options.setdefault("time", _state(leaves, "time", float))
            state = {name: _state(leaves, name, int) for name in ("cycle", "domain_id")}
            field = partial(data_set, leaves)
        except ValueError as error:  # the session decides what becomes of it, on all ranks
            state, field = {}, partial(_fail, error)
        recorded = {name: value for name, value in state.items() if value is not None}
        provenance = {**recorded, **(options.pop("provenance", None) or {})}
        return self.session.render_member(field, parameters, provenance=provenance, **options)

    def finalize(self) -> None:
        """Let go of the catalog; see `Session.close`."""
        self.session.close()


def initialize(catalog: str | os.PathLike[str], **options: Any) -> BlueprintSession:
    """Begin a catalog, or go on with it; arguments and errors are those of `Session`."""
    return BlueprintSession(Session(catalog, **options))


def data_set(mesh: Any) -> Any:
    """The VTK data set (pyvista's ImageData or RectilinearGrid) of a mesh; numpy arrays of one stride are not copied.

    Raises ValueError naming the path in the mesh that can't be drawn.
    """
    leaves = dict(_leaves(mesh))
    topology = _one_name(leaves, "topologies")
    kind = _text(leaves, f"topologies/{topology}/type")
    coordset = _text(leaves, f"topologies/{topology}/coordset")
    place = f"coordsets/{coordset}"
    of_coordset = _text(leaves, f"{place}/type")
    makers = {"uniform": _uniform, "rectilinear": _rectilinear}
    if of_coordset not in makers or kind != of_coordset:
        raise ValueError(
            f"topologies/{topology} is {kind!r} on a {of_coordset!r} coordset: only uniform on uniform and rectilinear on "
            "rectilinear can be drawn; give a pyvista data set to Session.render_member for other meshes"
        )
    data = makers[of_coordset](leaves, place)
    names = [name for name in _names(leaves, "fields") if leaves.get(f"fields/{name}/topology", topology) == topology]
    if not names:
        raise ValueError(f"the mesh has no fields on topology {topology!r}")
    for name in names:
        association, values = _field(leaves, f"fields/{name}")
        needed = data.n_points if association == "vertex" else data.n_cells
        if len(values) != needed:
            raise ValueError(
                f"fields/{name}/values has {len(values)} values, but the topology {needed} {association} values"
            )
        (data.point_data if association == "vertex" else data.cell_data)[name] = values
    return data


def _uniform(leaves: Mapping[str, Any], place: str) -> Any:
    import pyvista

    dims = [_number(leaves, f"{place}/dims/{index}") for _, index in AXES]
    if any(n != int(n) or not 2 <= n <= MOST_POINTS for n in dims):
        raise ValueError(f"{place}/dims must be at least 2 points along i, j and k, at most {MOST_POINTS}, got {dims}")
    spacing = [_number(leaves, f"{place}/spacing/d{axis}", 1.0) for axis, _ in AXES]
    if min(spacing) <= 0:
        raise ValueError(f"{place}/spacing must be positive, got {spacing}")
    origin = [_number(leaves, f"{place}/origin/{axis}", 0.0) for axis, _ in AXES]
    return pyvista.ImageData(dimensions=tuple(map(int, dims)), spacing=tuple(spacing), origin=tuple(origin))


def _rectilinear(leaves: Mapping[str, Any], place: str) -> Any:
    import pyvista

    axes = [_values(leaves, f"{place}/values/{axis}") for axis, _ in AXES]
    for (axis, _), points in zip(AXES, axes, strict=True):
        if len(points) < 2 or not (np.isfinite(points).all() and (np.diff(points) > 0).all()):
            raise ValueError(f"{place}/values/{axis} must be at least 2 finite, increasing coordinates")
    return pyvista.RectilinearGrid(*axes)


def _field(leaves: Mapping[str, Any], place: str) -> tuple[str, NDArray[Any]]:
    """(association, values [N], x fastest)."""
    association = _text(leaves, f"{place}/association")
    if association not in ASSOCIATIONS:
        raise ValueError(f"{place}/association must be one of {ASSOCIATIONS}, got {association!r}")
    for layout in ("offsets", "strides"):
        if f"{place}/{layout}" in leaves:
            raise ValueError(f"{place}/{layout} can't be read: give the values without borders, x fastest")
    return association, _values(leaves, f"{place}/values")


def _values(leaves: Mapping[str, Any], path: str) -> NDArray[Any]:
    """Numbers [N] at `path`; of more axes, in C order."""
    if any(other.startswith(f"{path}/") for other in leaves):
        raise ValueError(f"{path} has components: give the one to draw, or a magnitude, as a field of its own")
    try:
        values = np.asarray(_leaf(leaves, path))
    except ValueError as error:
        raise ValueError(f"{path} must be one array of numbers: {error}") from error
    if values.dtype.kind not in "fiu":
        raise ValueError(f"{path} must hold real numbers, got {values.dtype}")
    return values.reshape(-1).astype(WITHOUT_VTK.get(values.dtype.char, values.dtype), copy=False)


def _leaves(node: Any, path: str = "") -> Iterator[tuple[str, Any]]:
    """("a/b/c", leaf) of a nested mapping whose keys may be paths themselves, or of a `conduit.Node`."""
    if not _is_mapping(node):
        if path:
            yield path, node
            return
        raise ValueError(f"a mesh is one mapping of coordsets, topologies and fields, got {type(node).__name__}")
    for key in _keys(node):
        yield from _leaves(node[key], f"{path}/{key}".strip("/"))


def _is_mapping(node: Any) -> bool:
    names = getattr(node, "child_names", None)  # of a conduit.Node; that of a leaf is empty
    return isinstance(node, Mapping) or (names is not None and len(list(names())) > 0)


def _keys(node: Any) -> list[str]:
    return [str(key) for key in (node if isinstance(node, Mapping) else node.child_names())]


def _names(leaves: Mapping[str, Any], group: str) -> list[str]:
    """Names directly below `group`, in their order."""
    return list(dict.fromkeys(path.split("/")[1] for path in leaves if path.startswith(f"{group}/")))


def _one_name(leaves: Mapping[str, Any], group: str) -> str:
    names = _names(leaves, group)
    if len(names) != 1:
        raise ValueError(
            f"a mesh needs exactly one of {group}, got {names or 'none'}: several domains can't be drawn yet"
        )
    return names[0]


def _leaf(leaves: Mapping[str, Any], path: str) -> Any:
    if path not in leaves:
        raise ValueError(f"the mesh has no {path}")
    return leaves[path]


def _text(leaves: Mapping[str, Any], path: str) -> str:
    value = _leaf(leaves, path)
    if not isinstance(value, str):
        raise ValueError(f"{path} must be text, got {value!r}")
    return value


def _number(leaves: Mapping[str, Any], path: str, default: float | None = None) -> float:
    value = leaves.get(path, default) if default is not None else _leaf(leaves, path)
    number = np.asarray(value)
    if number.size != 1 or number.dtype.kind not in "fiu" or not np.isfinite(number).all():
        raise ValueError(f"{path} must be one finite number, got {value!r}")
    return float(number.reshape(-1)[0])


def _fail(error: Exception) -> None:
    raise error


def _state(leaves: Mapping[str, Any], name: str, kind: type) -> Any:
    path = f"state/{name}"
    return kind(_number(leaves, path)) if path in leaves else None
