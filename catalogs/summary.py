"""What is kept of a field before it is gone: kilobytes that say how its values were spread and where it was seen."""

from __future__ import annotations

import io
import zipfile
from dataclasses import dataclass, fields
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from catalogs import durable


@dataclass(frozen=True, eq=False)
class FieldSummary:
    """The sidecar of a member.

    Attributes
    ----------
    minimum, maximum : of the field's finite values, in its unit.
    clipped_fraction : fraction of values outside the transfer function's control points.
    histogram : (256,) int64, samples per bin over a range that is fixed for the ensemble.
    bin_edges : (257,) float64.
    points : (M, 3) float32 world coordinates sampled in proportion to opacity (isosurface: on the surface).
    point_values, point_opacities : (M,) float32, the field and its opacity there.
    """

    minimum: float
    maximum: float
    clipped_fraction: float
    histogram: NDArray[np.int64]  # [256]
    bin_edges: NDArray[np.float64]  # [257]
    points: NDArray[np.float32]  # [M, 3]
    point_values: NDArray[np.float32]  # [M]
    point_opacities: NDArray[np.float32]  # [M]

    def __post_init__(self) -> None:
        count = len(self.points)
        if self.points.shape != (count, 3) or self.point_values.shape != (count,):
            raise ValueError(f"points must be [M, 3] with M values, got {self.points.shape}, {self.point_values.shape}")
        if self.point_opacities.shape != (count,) or len(self.bin_edges) != len(self.histogram) + 1:
            raise ValueError("every point needs an opacity, and n bins n + 1 edges")

    def save(self, path: Path) -> None:
        """Write as a numpy archive of plain arrays."""
        stream = io.BytesIO()
        np.savez_compressed(stream, allow_pickle=False, **{f.name: getattr(self, f.name) for f in fields(self)})
        durable.write(path, stream.getvalue())

    @classmethod
    def load(cls, path: Path) -> FieldSummary:
        """Read what `save` wrote; raises ValueError naming a file that is none.  Never runs code from it."""
        try:
            with np.load(path, allow_pickle=False) as archive:
                values = {f.name: archive[f.name] for f in fields(cls)}
        except (KeyError, ValueError, OSError, EOFError, zipfile.BadZipFile) as error:
            raise ValueError(f"{path} is no field summary: {error}") from error
        scalars = {name: float(values[name]) for name in ("minimum", "maximum", "clipped_fraction")}
        return cls(**{**values, **scalars})
