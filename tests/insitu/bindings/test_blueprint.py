"""Blueprint meshes are drawn as the hook draws their arrays, and what can't be drawn is named."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import insitu
from catalogs.store.catalog import Catalog
from catalogs.vocabulary.appearance import VolumeRendering
from catalogs.vocabulary.scene import ViewPlan
from insitu.bindings.blueprint import data_set, initialize
from tests.support.hooked import FUNCTION, blob

PLAN: dict[str, Any] = {
    "space": {"Re": (100.0, 200.0)},
    "appearances": VolumeRendering("dvr", FUNCTION),
    "views": ViewPlan(frequency=1, width=16, height=16),
    "sample_distance": 0.05,
}
FIELD = blob()[:, :11, :10]  # z, y, x


def mesh(association: str = "vertex", **changes: Any) -> dict[str, Any]:
    """A flat mesh around FIELD; a change to None leaves the path out."""
    nz, ny, nx = (n + (association == "element") for n in FIELD.shape)
    paths = {
        "state/time": 2.5,
        "state/cycle": 7,
        "coordsets/coords/type": "uniform",
        **{f"coordsets/coords/dims/{i}": n for i, n in zip("ijk", (nx, ny, nz), strict=True)},
        **{f"coordsets/coords/origin/{axis}": 1.0 for axis in "xyz"},
        **{f"coordsets/coords/spacing/d{axis}": 0.1 for axis in "xyz"},
        "topologies/mesh/type": "uniform",
        "topologies/mesh/coordset": "coords",
        "fields/q/association": association,
        "fields/q/topology": "mesh",
        "fields/q/values": FIELD.reshape(-1),
    }
    paths.update(changes)
    return {path: value for path, value in paths.items() if value is not None}


def nested(flat: dict[str, Any]) -> dict[str, Any]:
    tree: dict[str, Any] = {}
    for path, value in flat.items():
        *above, last = path.split("/")
        node = tree
        for key in above:
            node = node.setdefault(key, {})
        node[last] = value
    return tree


class Node:
    """As much of `conduit.Node` as a reader needs: a leaf answers with its value."""

    def __init__(self, children: dict[str, Any]) -> None:
        self.children = children

    def child_names(self) -> list[str]:
        return list(self.children)

    def __getitem__(self, name: str) -> Any:
        child = self.children[name]
        return Node(child) if isinstance(child, dict) else child


def rectilinear() -> dict[str, Any]:
    lengths = zip("xyz", FIELD.shape[::-1], strict=True)
    axes = {f"coordsets/coords/values/{axis}": 1.0 + 0.1 * np.arange(n) for axis, n in lengths}
    return mesh(**{"coordsets/coords/type": "rectilinear", "topologies/mesh/type": "rectilinear"}, **axes)


def pictures(path: Path) -> dict[str, bytes]:
    return {picture.name: picture.read_bytes() for picture in path.rglob("*.png")}


@pytest.mark.parametrize(
    ("given", "origin"),
    [
        (mesh(), 1.0),
        (nested(mesh()), 1.0),
        (Node(nested(mesh())), 1.0),
        (rectilinear(), 1.0),
        (mesh("element"), 1.05),  # values at the centres of the cells
    ],
    ids=["flat", "nested", "node", "rectilinear", "element"],
)
def test_pictures_equal_those_of_the_hook(tmp_path: Path, given: Any, origin: float) -> None:
    run = initialize(tmp_path / "mesh.cdb", **PLAN)
    run.execute(given, {"Re": 150.0})
    run.finalize()
    insitu.render_member(
        FIELD, {"Re": 150.0}, catalog=tmp_path / "array.cdb", spacing=(0.1,) * 3, origin=(origin,) * 3, **PLAN
    )
    drawn = pictures(tmp_path / "mesh.cdb")
    assert len(drawn) == 12
    assert drawn == pictures(tmp_path / "array.cdb")
    record = Catalog.open(tmp_path / "mesh.cdb").members[0].provenance
    assert (record["time"], record["cycle"]) == (2.5, 7)


@pytest.mark.parametrize("dtype", ["f2", "g", ">f8", ">i4", "u1"])
def test_numbers_of_any_type_are_taken(dtype: str) -> None:
    values = np.arange(1320) % 100
    data = data_set(mesh(**{"fields/q/values": values.astype(dtype)}))
    np.testing.assert_array_equal(np.asarray(data.point_data["q"]), values)


def test_a_mesh_that_is_none_is_a_failure_like_others(tmp_path: Path) -> None:
    run = initialize(tmp_path / "a.cdb", on_error="warn", **PLAN)
    with pytest.warns(UserWarning, match="a mesh is one mapping"):
        assert "a mesh is one mapping" in str(run.execute(None, {"Re": 150.0}).error)
    run.finalize()


def test_values_are_not_copied() -> None:
    values = FIELD.reshape(-1).copy()
    data = data_set(mesh(**{"fields/q/values": values}))
    assert np.shares_memory(np.asarray(data.point_data["q"]), values)


@pytest.mark.parametrize(
    ("changes", "complaint"),
    [
        ({"coordsets/coords/type": "explicit"}, "topologies/mesh is 'uniform' on a 'explicit' coordset"),
        ({"topologies/mesh/type": "unstructured"}, "'unstructured' on a 'uniform'"),
        ({"topologies/mesh/coordset": "other"}, "no coordsets/other/type"),
        ({"topologies/second/type": "uniform"}, "exactly one of topologies"),
        ({"coordsets/coords/dims/k": None}, "no coordsets/coords/dims/k"),
        ({"coordsets/coords/dims/k": 1}, "at least 2 points"),
        ({"coordsets/coords/dims/k": -1}, "at least 2 points"),
        ({"coordsets/coords/dims/k": 1 << 40}, "at most 2147483647"),
        ({"fields/q/values": [[1.0], [1.0, 2.0]]}, "fields/q/values must be one array of numbers"),
        ({"fields/q/values": [None] * 1320}, "must hold real numbers"),
        ({"coordsets/coords/spacing/dx": -0.1}, "spacing must be positive"),
        ({"coordsets/coords/origin/x": float("nan")}, "origin/x must be one finite number"),
        ({"fields/q/association": "edge"}, "association must be one of"),
        ({"fields/q/values": np.zeros(3)}, "has 3 values, but the topology 1320 vertex values"),
        ({"fields/q/values": np.array(["a"])}, "must hold real numbers"),
        ({"fields/q/values": {"u": FIELD, "v": FIELD}}, "has components"),
        ({"fields/q/strides": [1, 2, 3]}, "fields/q/strides can't be read"),
        ({"fields/q/topology": "other"}, "no fields on topology 'mesh'"),
        ({"state/time": "soon"}, "state/time must be one finite number"),
    ],
)
def test_what_cannot_be_drawn_is_named_and_nothing_is_written(
    tmp_path: Path, changes: dict[str, Any], complaint: str
) -> None:
    run = initialize(tmp_path / "a.cdb", **PLAN)
    with pytest.raises(ValueError, match=complaint):
        run.execute(mesh(**changes), {"Re": 150.0})
    run.finalize()
    assert not list(tmp_path.iterdir())
