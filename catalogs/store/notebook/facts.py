"""Facts about a catalog in words."""

from __future__ import annotations

from array import array
from collections import Counter
from collections.abc import Iterable, Sequence

import numpy as np

from catalogs.store.members import Member
from catalogs.store.plan import CatalogPlan
from catalogs.vocabulary.appearance import (
    Appearance,
    ImportedImages,
    Isosurface,
    VolumeRendering,
    appearance_to_json,
    field_of,
)
from catalogs.vocabulary.parameters import Parameter
from catalogs.vocabulary.words import counted


def facts(plan: CatalogPlan, members: Iterable[Member]) -> list[tuple[str, str]]:
    """Facts about a catalog's plan and these members as (name, value); opens no image and no summary."""
    tally = Tally(plan)
    for member in members:
        tally.add(member)
    return tally.facts()


class Tally:
    """Counts of a catalog's members, added one by one; keeps only the values of their parameters."""

    def __init__(self, plan: CatalogPlan) -> None:
        self._plan = plan
        self._splits: Counter[str] = Counter()
        self._values = {name: array("d") for name in plan.space.names}
        self._images = 0
        self._sizes = {(camera.width, camera.height) for camera in plan.cameras}
        self._views: set[int] = set()  # numbers per member
        self._view_splits: Counter[str] = Counter()

    def add(self, member: Member) -> None:
        """Count a member."""
        self._splits[member.split] += 1
        for name, values in self._values.items():
            values.append(member.parameters[name])
        self._images += len(member.cameras) * len(member.appearances)
        if member.cameras is not self._plan.cameras:
            self._sizes.update((camera.width, camera.height) for camera in member.cameras)
            self._views.add(len(member.cameras))
            self._view_splits.update(member.view_splits)

    def facts(self) -> list[tuple[str, str]]:
        """Facts about the plan and the members as (name, value)."""
        plan, count = self._plan, self._splits.total()
        low, high = plan.bounds
        return [
            ("members", f"{count} ({counted(self._splits)})" if count else "none yet"),
            *(("parameter", self._parameter(parameter)) for parameter in plan.space.parameters),
            *(("field", str(quantity)) for quantity in plan.quantities.values() if quantity),
            *(("appearance", _appearance(appearance, plan)) for appearance in plan.plain_appearances),
            *(("variation", str(variation)) for variation in plan.variations),
            ("views", self._view_count()),
            ("images", self._image_count()),
            ("box", f"{_numbers(low)} to {_numbers(high)}"),
        ]

    def _parameter(self, parameter: Parameter) -> str:
        values = np.unique(self._values[parameter.name])
        learnt = "; learnt by its logarithm" if parameter.spans_decade and parameter.scale != "log" else ""
        if not len(values):
            return f"{parameter}{learnt}"
        if len(values) == 1:
            return f"{parameter}; all members at {parameter.text(values[0])}{learnt}"
        extent = f"members from {parameter.text(values[0])} to {parameter.text(values[-1])}, {len(values)} values"
        return f"{parameter}; {extent}{learnt}"

    def _view_count(self) -> str:
        plan, numbers = self._plan, self._views or {0}
        if plan.cameras:
            return f"{len(plan.cameras)} shared by all members ({counted(Counter(plan.view_splits))})"
        return f"each member's own, {min(numbers)} to {max(numbers)} ({counted(self._view_splits)} in all)"

    def _image_count(self) -> str:
        plan, sizes = self._plan, sorted(self._sizes)
        size = ", ".join(f"{width}x{height}" for width, height in sizes[:4]) + (", ..." if len(sizes) > 4 else "")
        kind = "8-bit PNG" if plan.image_format == "png" else "float32 EXR"
        kind += ", one HDF5 file for each member" if plan.packed else ""
        ground = "with alpha" if plan.background is None else f"opaque on the background {_numbers(plan.background)}"
        return f"{self._images:,} of {size or 'no size yet'}, {kind}, {ground}"


def _appearance(appearance: Appearance, plan: CatalogPlan) -> str:
    quantity = plan.quantity(field_of(appearance))
    of, unit = (f" of {quantity.name}" if quantity.name else ""), (f" {quantity.unit}" if quantity.unit else "")
    if isinstance(appearance, VolumeRendering):
        low, high = appearance.transfer_function.bounds
        shading = "shaded" if appearance.shaded else "unshaded"
        return f"{appearance.name}: volume rendering{of} over [{low:g}, {high:g}]{unit}, {shading}"
    if isinstance(appearance, Isosurface):
        return f"{appearance.name}: isosurface{of} at {appearance.isovalue:g}{unit}"
    if isinstance(appearance, ImportedImages):
        return f"{appearance.name}: imported{f', {appearance.note}' if appearance.note else ''}"
    return f"{appearance.name}: {appearance_to_json(appearance)['kind']}{of}"


def _numbers(values: Sequence[float]) -> str:
    return f"({', '.join(f'{value:g}' for value in values)})"
