"""The samples of a field as rays meet them: checked, with their place in the world."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from catalogs.vocabulary.cameras import Camera
from catalogs.vocabulary.holes import continued
from catalogs.vocabulary.numbers import finite, positive, row

Triple = tuple[float, float, float]


@dataclass(frozen=True, eq=False)
class SampledField:
    """Samples on a regular grid; between them the field is trilinear, and it ends at the first and last of each axis.

    Attributes
    ----------
    values : (nz, ny, nx) real, finite but in holes; sample [k, j, i] lies at `origin + spacing * (i, j, k)`.
    holes : (nz, ny, nx) bool or None: samples without a value; grid cells with one at a corner are transparent.
    spacing, origin : world units, in the order x, y, z.
    is_filled : true where values in holes are those of neighbours already.

    Raises ValueError or TypeError naming what is wrong with shapes, types or values.

    Examples
    --------
    >>> from blobs import PLACE, simulate
    >>> from native.ray_casting import SampledField
    >>> field = SampledField(simulate(0.8, 0.3), **PLACE)
    >>> print("{:.2f} to {:.2f}".format(*field.range))
    0.00 to 0.96
    """

    values: NDArray[Any]
    holes: NDArray[np.bool_] | None = None
    spacing: Triple = (1.0, 1.0, 1.0)
    origin: Triple = (0.0, 0.0, 0.0)
    is_filled: bool = False

    def __post_init__(self) -> None:
        values = np.asarray(self.values)
        if values.dtype.kind not in "fiu":
            raise TypeError(f"a field must hold real numbers, got {values.dtype}")
        if values.ndim != 3 or min(values.shape) < 2:
            raise ValueError(f"values must have shape (z, y, x) with at least 2 samples each, got {values.shape}")
        object.__setattr__(self, "values", values)
        object.__setattr__(self, "spacing", triple(self.spacing, "spacing", positive))
        object.__setattr__(self, "origin", triple(self.origin, "origin", finite))
        holes = None if self.holes is None else np.asarray(self.holes)
        if holes is not None and (holes.shape != values.shape or holes.dtype != bool):
            raise ValueError(
                f"holes must be truth values of the shape of values {values.shape}, got {holes.dtype} {holes.shape}"
            )
        object.__setattr__(self, "holes", holes if holes is not None and holes.any() else None)
        valid = np.isfinite(values) if self.holes is None else np.isfinite(values) | self.holes
        if not valid.all():
            first = tuple(int(i) for i in np.argwhere(~valid)[0])
            raise ValueError(
                f"{int((~valid).sum())} of {values.size} values are NaN or infinite, the first at (z, y, x) = {first}: "
                "mark them in holes to leave them out of the image"
            )
        if self.holes is not None and self.holes.all():
            raise ValueError("every sample of the field is a hole: there is nothing to draw")

    @cached_property
    def filled(self) -> NDArray[Any]:
        """`values`, holes with the value of a neighbour, so that gradients beside them are those of the field."""
        return self.values if self.holes is None or self.is_filled else continued(self.values, self.holes)

    @cached_property
    def range(self) -> tuple[float, float]:
        """Smallest and largest value."""
        valid = self.values if self.holes is None or self.is_filled else self.values[~self.holes]
        return float(valid.min()), float(valid.max())

    @property
    def size(self) -> NDArray[np.int64]:
        """Samples along x, y and z, (3,)."""
        return np.array(self.values.shape[::-1])

    def rays(self, camera: Camera) -> NDArray[np.float64]:
        """The camera's rays in samples, (5, 3): eye, directions per column and per row and of the corner, and the spacing.

        The ray of the pixel whose middle is at (u, v) is eye + t (u across + v down + corner).
        """
        right, down, forward = camera.rotation
        corner = forward - camera.cx / camera.fx * right - camera.cy / camera.fy * down
        world = np.stack([camera.position - self.origin, right / camera.fx, down / camera.fy, corner])  # [4, 3]
        return np.concatenate([world / self.spacing, [self.spacing]])


def triple(value: ArrayLike, name: str, check: Any) -> Triple:
    """Three numbers, or one for all, each as `check(number, name)` gives it."""
    x, y, z = (
        check(number, name) for number in row(np.broadcast_to(value, 3) if np.ndim(value) == 0 else value, 3, name)
    )
    return x, y, z
