"""The sizes that an XDMF file claims of its arrays, against those of the files that hold them.

VTK reads the first part of a longer array, another order of axes, and fewer numbers of a text without a word.
"""

from __future__ import annotations

import math
from collections import Counter
from functools import lru_cache
from pathlib import Path
from xml.etree.ElementTree import Element

from insitu.readers.arrays import check_room
from insitu.readers.named_files import require_named
from insitu.readers.xml_files import parsed

STRUCTURED = {f"{n}d{kind}" for n in (2, 3) for kind in ("corectmesh", "rectmesh", "smesh")}
COMPONENTS = {"scalar": 1, "vector": 3, "tensor6": 6, "tensor": 9}
FORMATS = {"hdf": "HDF5", "hdf5": "HDF5", "binary": "Binary", "xml": "XML"}


def check_sizes(path: Path) -> None:
    """Raise ValueError where an array has another size than the XDMF file says; files that were right are remembered."""
    stat = path.stat()
    _check(path, stat.st_size, stat.st_mtime_ns)


@lru_cache(maxsize=64)
def _check(path: Path, size: int, modified: int) -> None:
    root = parsed(path)
    for grid in root.iter("Grid"):
        _check_attributes(grid)
    items = [item for item in root.iter("DataItem") if item.get("ItemType", "Uniform") == "Uniform"]
    shared = Counter((item.text or "").strip() for item in items if _format(item) == "Binary")
    for item in items:
        words = (item.get("Dimensions") or "").split()
        if not words or not all(word.isdigit() and len(word) < 16 for word in words) or item.get("Reference"):
            continue
        shape, text = tuple(map(int, words)), (item.text or "").strip()
        check_room(math.prod(shape), "an array")
        if _format(item) == "XML" and not len(item):
            if len(text.split()) != math.prod(shape):
                raise ValueError(f"an array claims {_shape_text(shape)} values, its text has {len(text.split())}")
        elif _format(item) == "Binary":
            _check_raw(path, item, text, math.prod(shape), shared[text] > 1)
        elif _format(item) == "HDF5":
            _check_stored(path, text, shape)


def _check_attributes(grid: Element) -> None:
    """Raise ValueError where an array of a structured grid has not a value, or a vector, for each point or cell."""
    topology = grid.find("Topology")
    kind = "" if topology is None else (topology.get("TopologyType") or topology.get("Type") or "").lower()
    said = "" if topology is None else topology.get("Dimensions") or topology.get("NumberOfElements") or ""
    if kind not in STRUCTURED or not said.replace(" ", "").isdigit():
        return
    points = [int(word) for word in said.split()]
    counts = {"node": math.prod(points), "cell": math.prod(max(1, n - 1) for n in points)}
    for attribute in grid.findall("Attribute"):
        center, item = attribute.get("Center", "Node").lower(), attribute.find("DataItem")
        words = [] if item is None or item.get("Reference") else (item.get("Dimensions") or "").split()
        components = COMPONENTS.get((attribute.get("AttributeType") or attribute.get("Type") or "Scalar").lower())
        if center not in counts or components is None or not words or not all(map(str.isdigit, words)):
            continue
        if math.prod(map(int, words)) != components * counts[center]:
            claimed, grid_of = _shape_text(tuple(map(int, words))), _shape_text(tuple(points))
            raise ValueError(
                f"array {attribute.get('Name')!r} claims {claimed} values, its grid of {grid_of} points has {counts[center]} "
                f"{center}s"
            )


def _format(item: Element) -> str:
    return FORMATS.get(item.get("Format", "XML").lower(), "")


def _check_raw(path: Path, item: Element, name: str, count: int, is_shared: bool) -> None:
    """Of a raw file, which may hold several arrays one behind the other."""
    seek, compression = item.get("Seek", "0"), item.get("Compression", "Raw")
    precision = item.get("Precision", "1" if item.get("NumberType", "Float").lower() in ("char", "uchar") else "4")
    if compression.lower() != "raw" or not precision.isdigit() or not seek.isdigit():
        return
    size, claimed = _file(path, name).stat().st_size, int(seek) + count * int(precision)
    if size < claimed or (size > claimed and not is_shared and seek == "0"):
        raise ValueError(f"its array claims {claimed} bytes, {name} has {size}: is it of another mesh or precision?")


def _check_stored(path: Path, text: str, shape: tuple[int, ...]) -> None:
    """Of an array in an HDF5 file: the same shape, but for axes of one value, or all values in a row."""
    import h5py

    name, colon, inner = text.rpartition(":")
    if not colon:
        return
    try:
        with h5py.File(_file(path, name), "r") as file:
            dataset = file.get(inner)
            actual = dataset.shape if isinstance(dataset, h5py.Dataset) else None
    except OSError as error:
        raise ValueError(f"{name} can't be read: {error}") from None
    if actual is None:
        raise ValueError(f"there is no array {inner} in {name}")
    lengths, said = ([n for n in sizes if n != 1] for sizes in (actual, shape))
    if lengths != said and (math.prod(lengths) != math.prod(said) or min(len(lengths), len(said)) > 1):
        raise ValueError(f"it claims {_shape_text(shape)} values, {text} has {_shape_text(actual)}")


def _file(path: Path, name: str) -> Path:
    target = path.parent / name
    require_named(target, name)
    return target


def _shape_text(shape: tuple[int, ...]) -> str:
    return " x ".join(map(str, shape)) or "1"
