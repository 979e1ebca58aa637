"""Appearances under which a member shows nothing, and what may be the reason."""

from __future__ import annotations

from collections.abc import Iterable
from itertools import pairwise
from typing import NamedTuple

from catalogs.store.summary import FieldSummary
from catalogs.vocabulary.appearance import Appearance, Isosurface, TransferFunction, VolumeRendering

BLANK, ONE_COLOR = "every picture is blank", "all of the field has one colour"
CLIPPED = "much of the field has the colours of the transfer function's ends"
CLIPPED_FROM = ((0.9, 20.0), (0.25, 200.0))  # of a field's values, and their range in widths of the function


class PictureNote(NamedTuple):
    """A warning about all images of a member under an appearance: the problem, and the likely reason."""

    appearance: str
    problem: str
    reason: str

    def __str__(self) -> str:
        return f"{self.appearance}: {self.problem}: {self.reason}"


def note_on_pictures(appearance: Appearance, summary: FieldSummary, *, blank: bool) -> PictureNote | None:
    """The note, if there is one; `blank` says that no pixel of the pictures is covered.

    Pictures that are not blank are worth it where the field lies wholly out of the transfer function's values: all of it has
    the colour of one end.
    """
    values = f"the field's values run from {summary.minimum:.6g} to {summary.maximum:.6g}"
    if isinstance(appearance, VolumeRendering):
        function = appearance.transfer_function
        low, high = function.bounds
        if blank:
            return PictureNote(appearance.name, BLANK, f"{values}, {_reason(function, summary)}")
        if summary.maximum < low or summary.minimum > high:
            return PictureNote(
                appearance.name, ONE_COLOR, f"{values}, the transfer function's from {low:.6g} to {high:.6g}"
            )
        widths, clipped = (summary.maximum - summary.minimum) / (high - low), summary.clipped_fraction
        if any(clipped > part and widths > far for part, far in CLIPPED_FROM):
            return PictureNote(
                appearance.name,
                CLIPPED,
                f"{100 * clipped:.1f} % of its values are clipped, {values}, the function's from {low:.6g} to "
                f"{high:.6g}: are they in other units?",
            )
    elif isinstance(appearance, Isosurface) and blank:
        inside = summary.minimum < appearance.isovalue <= summary.maximum
        reason = "no camera sees the surface at" if inside else "not through the isovalue"
        return PictureNote(appearance.name, BLANK, f"{values}, {reason} {appearance.isovalue:.6g}")
    return None


def _reason(function: TransferFunction, summary: FieldSummary) -> str:
    """Why a volume may be invisible."""
    intervals = opaque_values(function)
    if not intervals:
        return "the transfer function is transparent everywhere"
    where = f"the transfer function is opaque {_listed(intervals)}"
    overlaps = any(start < summary.maximum and summary.minimum < end for start, end in intervals)
    return f"{where}: no camera sees these values, or they are too faint or too thin" if overlaps else where


def opaque_values(function: TransferFunction) -> list[tuple[float, float]]:
    """The open intervals of values with an opacity above 0; the first and last may reach to infinity."""
    infinity = float("inf")
    points = function.opacity_points
    extended = [(-infinity, points[0][1]), *points, (infinity, points[-1][1])]
    intervals: list[tuple[float, float]] = []
    for (start, before), (end, after) in pairwise(extended):
        if before > 0 or after > 0:
            joins = bool(intervals) and intervals[-1][1] == start and before > 0
            intervals[-1:] = [(intervals[-1][0], end)] if joins else [*intervals[-1:], (start, end)]
    return intervals


def _listed(intervals: Iterable[tuple[float, float]]) -> str:
    infinity = float("inf")
    parts = []
    for start, end in intervals:
        if (start, end) == (-infinity, infinity):
            parts.append("everywhere")
        elif start == -infinity:
            parts.append(f"below {end:.6g}")
        elif end == infinity:
            parts.append(f"above {start:.6g}")
        else:
            parts.append(f"from {start:.6g} to {end:.6g}")
    return " and ".join(parts)
