"""Emulated fields for other programs: VTK image data for ParaView, and xarray."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING
from xml.sax.saxutils import escape, quoteattr

import numpy as np
from numpy.typing import NDArray

from catalogs.files import durable
from catalogs.vocabulary.quantity import Quantity
from surrogate.emulation.field import EmulatedField

if TYPE_CHECKING:
    import xarray

UNNAMED, DEVIATION = "value", "standard deviation"


def to_vti(path: str | os.PathLike[str], field: EmulatedField, quantity: Quantity | None = None) -> None:
    """Write a field and its standard deviations, NaN in holes, as VTK image data, which ParaView opens.

    Arrays are called after the quantity and carry its unit (`UNITS_LABEL`).  Written without VTK: XML with appended raw data, VTK
    User's Guide, "VTK file formats".
    """
    arrays = _arrays(field, quantity)
    unit = quantity.unit if quantity else ""
    key = f'<InformationKey name="UNITS_LABEL" location="vtkDataArray">{escape(unit)}</InformationKey>' if unit else ""
    offset, described, pieces = 0, "", list[bytes]()
    for name, values in arrays.items():
        content = np.ascontiguousarray(values, dtype="<f4").tobytes()
        described += (
            f'<DataArray type="Float32" Name={quoteattr(name)} format="appended" offset="{offset}">{key}</DataArray>\n'
        )
        pieces += [np.uint64(len(content)).astype("<u8").tobytes(), content]
        offset += 8 + len(content)
    extent = " ".join(f"0 {side - 1}" for side in field.values.shape[::-1])
    origin, spacing = (" ".join(map(repr, map(float, three))) for three in (field.origin, field.spacing))
    head = (
        '<?xml version="1.0" encoding="UTF-8"?>\n'
        '<VTKFile type="ImageData" version="1.0" byte_order="LittleEndian" header_type="UInt64">\n'
        f'<ImageData WholeExtent="{extent}" Origin="{origin}" Spacing="{spacing}">\n<Piece Extent="{extent}">\n'
        f"<PointData Scalars={quoteattr(next(iter(arrays)))}>\n{described}</PointData>\n</Piece>\n</ImageData>\n"
        '<AppendedData encoding="raw">\n_'
    )
    durable.replace(Path(path), [head.encode(), *pieces, b"\n</AppendedData>\n</VTKFile>\n"])


def to_xarray(field: EmulatedField, quantity: Quantity | None = None) -> xarray.Dataset:
    """The field and its standard deviations, NaN in holes, over world coordinates z, y, x; needs xarray."""
    import xarray

    attributes = {"units": quantity.unit} if quantity and quantity.unit else {}
    axes = ("z", "y", "x")
    lines = {
        axis: field.origin[2 - i] + field.spacing[2 - i] * np.arange(field.values.shape[i])
        for i, axis in enumerate(axes)
    }
    named = {name: (axes, values, attributes) for name, values in _arrays(field, quantity).items()}
    return xarray.Dataset(named, lines)


def _arrays(field: EmulatedField, quantity: Quantity | None) -> dict[str, NDArray[np.float32]]:
    """Values and standard deviations (Z, Y, X), NaN in holes, by name."""
    name = (quantity.name if quantity else "") or UNNAMED
    arrays = {name: field.values}
    if (deviations := field.deviations) is not None:
        arrays[f"{name}, {DEVIATION}"] = deviations
    if field.holes is None:
        return arrays
    return {key: np.where(field.holes, np.float32(np.nan), values) for key, values in arrays.items()}
