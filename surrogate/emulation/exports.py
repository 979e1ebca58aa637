"""Emulated fields for other programs: VTK image data for ParaView, and xarray."""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any
from xml.sax.saxutils import escape, quoteattr

import numpy as np
from numpy.typing import NDArray

from catalogs.files import durable
from surrogate.emulation.lattice_field import LatticeField

if TYPE_CHECKING:
    import xarray

UNNAMED, DEVIATION = "value", "standard deviation"
ENDING = ".vti"


def save(field: LatticeField, path: str | os.PathLike[str]) -> None:
    """Write the field and its standard deviations as VTK image data, which ParaView opens; see `vti_bytes`.

    Raises ValueError unless the file's name ends with .vti.
    """
    if Path(path).suffix.lower() != ENDING:
        raise ValueError(
            f"a field is saved as VTK image data, so its file must end with {ENDING}, got {Path(path).name}"
        )
    durable.replace(Path(path), vti_bytes([field]))


def vti_bytes(fields: Sequence[LatticeField]) -> bytes:
    """VTK image data that hold fields of one grid and their standard deviations, NaN in holes.

    Arrays are called after the fields' quantities and carry their units (`UNITS_LABEL`).  Written without VTK: XML with appended
    raw data, VTK User's Guide, "VTK file formats".  Raises ValueError for fields of different grids or equal names.
    """
    first = fields[0]
    grids = {(field.values.shape, field.spacing, field.origin) for field in fields}
    if len(grids) > 1:
        raise ValueError("the fields lie on different grids, which one file can't hold: write each into its own")
    offset, described, pieces, names = 0, "", list[bytes](), list[str]()
    for field in fields:
        unit = field.quantity.unit
        key = (
            f'<InformationKey name="UNITS_LABEL" location="vtkDataArray">{escape(unit)}</InformationKey>'
            if unit
            else ""
        )
        for name, values in _arrays(field):
            content = np.ascontiguousarray(values, dtype="<f4").tobytes()
            described += f'<DataArray type="Float32" Name={quoteattr(name)} format="appended" offset="{offset}">{key}</DataArray>\n'
            pieces += [np.uint64(len(content)).astype("<u8").tobytes(), content]
            offset += 8 + len(content)
            names.append(name)
    if len(set(names)) < len(names):
        raise ValueError("two fields have one name, by which a file can't tell them apart: write each into its own")
    extent = " ".join(f"0 {side - 1}" for side in first.values.shape[::-1])
    origin, spacing = (" ".join(map(repr, map(float, three))) for three in (first.origin, first.spacing))
    head = (
        '<?xml version="1.0" encoding="UTF-8"?>\n'
        '<VTKFile type="ImageData" version="1.0" byte_order="LittleEndian" header_type="UInt64">\n'
        f'<ImageData WholeExtent="{extent}" Origin="{origin}" Spacing="{spacing}">\n<Piece Extent="{extent}">\n'
        f"<PointData Scalars={quoteattr(names[0])}>\n{described}</PointData>\n</Piece>\n</ImageData>\n"
        '<AppendedData encoding="raw">\n_'
    )
    return b"".join([head.encode(), *pieces, b"\n</AppendedData>\n</VTKFile>\n"])


def to_xarray(field: LatticeField) -> xarray.Dataset:
    """The field and its standard deviations, NaN in holes, over world coordinates z, y, x.

    Raises ModuleNotFoundError with the remedy where xarray is not installed.
    """
    xarray = xarray_package()
    attributes = {"units": field.quantity.unit} if field.quantity.unit else {}
    axes = ("z", "y", "x")
    lines = {
        axis: field.origin[2 - i] + field.spacing[2 - i] * np.arange(field.values.shape[i])
        for i, axis in enumerate(axes)
    }
    named = {name: (axes, values, attributes) for name, values in _arrays(field)}
    return xarray.Dataset(named, lines)


def xarray_package() -> Any:
    """The package; raises ModuleNotFoundError with the remedy where it is not installed."""
    try:
        import xarray
    except ModuleNotFoundError:
        raise ModuleNotFoundError("to_xarray needs the package xarray: pip install xarray") from None

    return xarray


def _arrays(field: LatticeField) -> Iterator[tuple[str, NDArray[np.float32]]]:
    """Names of values and standard deviations, and each (Z, Y, X), NaN in holes."""
    name, deviations = field.quantity.name or UNNAMED, field.deviations
    for key, values in ((name, field.values), (f"{name}, {DEVIATION}", deviations)):
        if values is not None:
            yield key, values if field.holes is None else np.where(field.holes, np.float32(np.nan), values)
