"""Summaries of fields that are not stored themselves: kilobytes on the distribution of values and where they were visible.

A member's summary file is one numpy archive of plain arrays, named like the attributes of `FieldSummary`.  For several fields these
are the arrays of the first; those of the others are called "1/minimum" and so on, and `fields` holds all names.  Unknown arrays are
ignored.
"""

from __future__ import annotations

import io
import zipfile
import zlib
from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from catalogs.files import durable
from catalogs.files.digests import digest_of

FIELDS = "fields"  # names of the fields in an archive of several
DAMAGED = KeyError, ValueError, TypeError, OSError, EOFError, RuntimeError, MemoryError, zipfile.BadZipFile, zlib.error


@dataclass(frozen=True, eq=False)
class FieldSummary:
    """Summary of one field of a member.

    Attributes
    ----------
    minimum, maximum : of the field's finite values, in its unit.
    clipped_fraction : fraction of values outside the transfer function's control points.
    histogram : (256,) int64, samples per bin over a range that is fixed for the ensemble.
    bin_edges : (257,) float64.
    points : (M, 3) world coordinates sampled in proportion to opacity (isosurface: on the surface).
    point_values, point_opacities : (M,), the field and its opacity there; all float32, or float64 where that would round by a
        thousandth of a grid spacing or of the histogram's range.
    even_points : (E, 3) world coordinates that fill the field's box evenly, different for every field; none in holes.
    even_values : (E,), the field there, interpolated between its samples; types as above.

    Examples
    --------
    >>> from blobs import make_run
    >>> from catalogs import Catalog
    >>> summary = Catalog.open(make_run() / "blobs.cdb").members[0].summary()
    >>> print(f"{summary.minimum:.2f} to {summary.maximum:.2f}, {len(summary.points)} points")
    0.00 to 0.91, 4000 points
    """

    minimum: float
    maximum: float
    clipped_fraction: float
    histogram: NDArray[np.int64]  # [256]
    bin_edges: NDArray[np.float64]  # [257]
    points: NDArray[np.floating]  # [M, 3]
    point_values: NDArray[np.floating]  # [M]
    point_opacities: NDArray[np.float32]  # [M]
    even_points: NDArray[np.floating] = field(default_factory=lambda: np.empty((0, 3), np.float32))  # [E, 3]
    even_values: NDArray[np.floating] = field(default_factory=lambda: np.empty(0, np.float32))  # [E]

    def __post_init__(self) -> None:
        count = len(self.points)
        if self.points.shape != (count, 3) or self.point_values.shape != (count,):
            raise ValueError(f"points must be [M, 3] with M values, got {self.points.shape}, {self.point_values.shape}")
        if self.point_opacities.shape != (count,) or len(self.bin_edges) != len(self.histogram) + 1:
            raise ValueError("every point needs an opacity, and n bins n + 1 edges")
        even = len(self.even_points)
        if self.even_points.shape != (even, 3) or self.even_values.shape != (even,):
            shapes = f"{self.even_points.shape}, {self.even_values.shape}"
            raise ValueError(f"even_points must be [E, 3] with E even_values, got {shapes}")

    def __repr__(self) -> str:
        points = f"{len(self.points):,} points by opacity, {len(self.even_points):,} evenly"
        clipped = f"{100 * self.clipped_fraction:.2f} % clipped"
        return f"<FieldSummary from {self.minimum:.5g} to {self.maximum:.5g}, {clipped}, {points}>"

    @classmethod
    def _of_arrays(cls, archive: Mapping[str, Any], prefix: str) -> FieldSummary:
        values = {f.name: archive[prefix + f.name] for f in fields(cls)}
        scalars = {name: float(values[name]) for name in ("minimum", "maximum", "clipped_fraction")}
        return cls(**{**values, **scalars})


def save_summaries(path: Path, summaries: Mapping[str, FieldSummary]) -> str:
    """Write the summaries of a member's fields, by name ("" for a single field), as one numpy archive; returns its digest."""
    arrays: dict[str, Any] = {} if list(summaries) == [""] else {FIELDS: np.array(list(summaries), dtype=np.str_)}
    for number, summary in enumerate(summaries.values()):
        arrays |= {f"{_prefix(number)}{name}": value for name, value in vars(summary).items()}
    stream = io.BytesIO()
    np.savez_compressed(stream, allow_pickle=False, **arrays)
    durable.write(path, stream.getvalue())
    return digest_of(stream.getvalue())


def load_summaries(path: Path) -> dict[str, FieldSummary]:
    """The summaries in an archive, at least one, by the names of their fields; "" for a single field.

    Raises ValueError naming a file that is absent or damaged.  Never unpickles.
    """
    try:
        with durable.opened(path) as stream, np.load(stream, allow_pickle=False) as archive:
            names = [str(name) for name in archive[FIELDS]] if FIELDS in archive else [""]
            summaries = {name: FieldSummary._of_arrays(archive, _prefix(number)) for number, name in enumerate(names)}
    except durable.SpecialFileError as error:
        raise ValueError(str(error)) from None
    except DAMAGED as error:
        raise ValueError(f"{path} is not a field summary: {error}") from error
    if len(summaries) != len(names) or not summaries:
        raise ValueError(f"{path} is not a field summary: its fields are {names}")
    return summaries


def _prefix(number: int) -> str:
    return f"{number}/" if number else ""
