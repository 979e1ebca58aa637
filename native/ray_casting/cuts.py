"""Cuts through a field: a box to which what is drawn is cut, and a slice perpendicular to an axis."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from catalogs.vocabulary.appearance import TransferFunction, VolumeRendering
from catalogs.vocabulary.numbers import text
from native.ray_casting.fields import SampledField, Triple

AXES = "xyz"
THICKNESS = 1e-2  # of a slice, in samples: single precision meets it from far away
OPAQUE = 1e-6  # of its thickness: the length that opacities of 1 are of


@dataclass(frozen=True)
class Cut:
    """All that is drawn of a field: what lies in a box, and of that a slice alone where there is one.

    Attributes
    ----------
    box : its lowest and highest corner, x, y, z in world units; None for the whole field.
    plane : axis 0, 1 or 2 and place, world units, of the slice; None without one.

    Raises ValueError for a box that ends before it begins, a place that is not finite, and other axes.

    Examples
    --------
    >>> from blobs import APPEARANCE, CAMERA, PLACE, simulate
    >>> from native.ray_casting import Cut, SampledField, VolumeCaster
    >>> field = SampledField(simulate(0.8, 0.3), **PLACE)
    >>> half = Cut(box=((-1, -1, -1), (0, 1, 1)))
    >>> picture = VolumeCaster.of(field, APPEARANCE).within(half.bounds(field)).draw(CAMERA)
    >>> print(half)
    x = -1 to 0, y = -1 to 1, z = -1 to 1
    """

    box: tuple[Triple, Triple] | None = None
    plane: tuple[int, float] | None = None

    def __post_init__(self) -> None:
        for axis, low, high in self._ends:
            if not -math.inf < low <= high < math.inf:
                raise ValueError(f"a box goes from a place to a higher one, got {axis} {text(low)} to {text(high)}")
        if self.plane is not None and not (self.plane[0] in (0, 1, 2) and math.isfinite(self.plane[1])):
            raise ValueError(f"a slice is perpendicular to x, y or z at a finite place, got {self.plane}")

    @property
    def _ends(self) -> list[tuple[str, float, float]]:
        return [] if self.box is None else list(zip(AXES, *self.box, strict=True))

    def left_of(self, box: NDArray[np.float64]) -> NDArray[np.float64] | None:
        """The corners of what is left of a box (2, 3), world units: of a slice, flat; None where it lies outside."""
        left = box.copy() if self.box is None else np.clip(self.box, *box)
        if self.plane is None:
            return left
        axis, place = self.plane
        is_inside = left[0, axis] <= place <= left[1, axis]
        left[:, axis] = place
        return left if is_inside else None

    def bounds(self, field: SampledField) -> NDArray[np.float64]:
        """The lowest and the highest place of what is drawn, (2, 3) in samples; equal along an axis where nothing is."""
        last = field.size - 1.0
        low, high = np.zeros(3), last.copy()
        if self.box is not None:
            with np.errstate(over="ignore"):
                low, high = np.clip((np.array(self.box) - field.origin) / field.spacing, 0.0, last)
        if self.plane is not None:
            axis, place = self.plane
            at = (place - field.origin[axis]) / field.spacing[axis]
            if low[axis] <= at <= high[axis]:  # it has a side, so that cells beside holes are all of one side
                low[axis] = min(at, last[axis] - THICKNESS)
                high[axis] = low[axis] + THICKNESS
            else:
                high[axis] = low[axis]
        return np.stack([low, high])

    def __str__(self) -> str:
        """In words, such as "x = 0 to 0.5, y = 0 to 1, z = 0 to 1, slice at z = 0.2"."""
        box = [f"{axis} = {text(low)} to {text(high)}" for axis, low, high in self._ends]
        plane = [] if self.plane is None else [f"slice at {AXES[self.plane[0]]} = {text(self.plane[1])}"]
        return ", ".join([*box, *plane])


def opaque(transfer: TransferFunction) -> TransferFunction:
    """The same colours, opaque at all values."""
    return replace(transfer, opacity_points=tuple((value, 1.0) for value, _ in transfer.opacity_points))


def sliced(appearance: VolumeRendering, field: SampledField) -> VolumeRendering:
    """The appearance of a slice: the colours of a volume, opaque and without light."""
    unit = OPAQUE * THICKNESS * min(field.spacing)
    transfer = replace(opaque(appearance.transfer_function), opacity_unit_distance=unit)
    return replace(appearance, transfer_function=transfer, shaded=False)
