"""Snapshots as Xcompact3d's `visu.f90` writes them: a .bin file for each array, and an XDMF file that says what they are."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

HEAD = """<?xml version="1.0" ?>
 <!DOCTYPE Xdmf SYSTEM "Xdmf.dtd" []>
 <Xdmf xmlns:xi="http://www.w3.org/2001/XInclude" Version="2.0">
 <Domain>
"""
EVEN = """     <Topology name="topo" TopologyType="3DCoRectMesh"
         Dimensions="{counts}">
     </Topology>
     <Geometry name="geo" Type="ORIGIN_DXDYDZ">
         <!-- Origin -->
         <DataItem Format="XML" Dimensions="3">
         0.0 0.0 0.0
         </DataItem>
         <!-- DxDyDz -->
         <DataItem Format="XML" Dimensions="3">
         {steps}
         </DataItem>
     </Geometry>
"""
AXIS = """         <DataItem Dimensions="{count:12d}" NumberType="Float" Precision="4" Format="XML">
         {values}
         </DataItem>
"""
ARRAY = """         <Attribute Name="{name}" Center="Node">
            <DataItem Format="Binary"
             DataType="Float" Precision="{precision}" Endian="{endian}" Seek="0"
             Dimensions="{counts}">
               ././{file}
            </DataItem>
         </Attribute>
"""
TAIL = """

     </Grid>
 </Domain>
</Xdmf>
"""


def fortran(value: float) -> str:
    """A double as gfortran's list-directed output prints it: 17 significant digits."""
    return f"{value:24.17G}"


def write_snapshot(
    folder: Path,
    number: int,
    arrays: Mapping[str, NDArray[np.floating]],
    axes: Sequence[NDArray[np.float64]],
    *,
    kind: str = "<f8",
) -> Path:
    """A snapshot of arrays [z, y, x] at coordinates along x, y and z, the mesh stretched where y is uneven (`istret`)."""
    folder.mkdir(parents=True, exist_ok=True)
    nx, ny, nz = map(len, axes)
    counts = f"{nz:12d}{ny:12d}{nx:12d}"
    if np.allclose(np.diff(axes[1]), axes[1][1] - axes[1][0]):
        text = HEAD + EVEN.format(counts=counts, steps="  ".join(fortran(axis[1] - axis[0]) for axis in reversed(axes)))
    else:
        text = (
            HEAD
            + f'     <Topology name="topo" TopologyType="3DRectMesh"\n         Dimensions="{counts}">\n     </Topology>\n'
        )
        items = [AXIS.format(count=len(axis), values=" ".join(map(fortran, axis))) for axis in axes]
        text += '     <Geometry name="geo" Type="VXVYVZ">\n' + "".join(items) + "     </Geometry>\n"
    text += f'     <Grid Name="{number:04d}" GridType="Uniform">\n'
    text += '         <Topology Reference="/Xdmf/Domain/Topology[1]"/>\n         <Geometry Reference="/Xdmf/Domain/Geometry[1]"/>\n'
    for name, values in arrays.items():
        file = f"{name}-{number:04d}.bin"
        values.astype(kind).tofile(folder / file)
        endian = "big" if kind[0] == ">" else "little"
        text += ARRAY.format(name=name, precision=kind[-1], endian=endian, counts=counts, file=file)
    path = folder / f"snapshot-{number:04d}.xdmf"
    path.write_text(text + TAIL)
    return path
