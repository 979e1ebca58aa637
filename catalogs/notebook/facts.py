"""What a catalog holds, in words."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from catalogs.appearance import Appearance, Isosurface, VolumeRendering, field_of
from catalogs.members import Member
from catalogs.parameters import Parameter
from catalogs.plan import CatalogPlan
from catalogs.words import counted


def megabytes(folder: Path) -> float:
    """What the files in and below the folder take on disk."""
    return sum(file.stat().st_size for file in folder.rglob("*") if file.is_file()) / 1e6


def facts(plan: CatalogPlan, members: Sequence[Member]) -> list[tuple[str, str]]:
    """What a catalog's plan and these members say, as (what, in words); no image and no summary is opened."""
    low, high = plan.bounds
    return [
        ("members", f"{len(members)} ({counted(m.split for m in members)})" if members else "none yet"),
        *(("parameter", _parameter(parameter, members)) for parameter in plan.space.parameters),
        *(("field", str(quantity)) for quantity in plan.quantities.values() if quantity),
        *(("appearance", _appearance(appearance, plan)) for appearance in plan.plain_appearances),
        *(("variation", str(variation)) for variation in plan.variations),
        *(("views", line) for line in _views(plan, members)),
        ("images", _images(plan, members)),
        ("box", f"{_numbers(low)} to {_numbers(high)}"),
    ]


def _parameter(parameter: Parameter, members: Sequence[Member]) -> str:
    if not members:
        return str(parameter)
    values = [member.parameters[parameter.name] for member in members]
    return f"{parameter}; members from {min(values):g} to {max(values):g}, {len(set(values))} values"


def _appearance(appearance: Appearance, plan: CatalogPlan) -> str:
    quantity = plan.quantity(field_of(appearance))
    of, unit = (f" of {quantity.name}" if quantity.name else ""), (f" {quantity.unit}" if quantity.unit else "")
    if isinstance(appearance, VolumeRendering):
        low, high = appearance.transfer_function.bounds
        shading = "shaded" if appearance.shaded else "unshaded"
        return f"{appearance.name}: volume rendering{of} over [{low:g}, {high:g}]{unit}, {shading}"
    if isinstance(appearance, Isosurface):
        return f"{appearance.name}: isosurface{of} at {appearance.isovalue:g}{unit}"
    return f"{appearance.name}: imported{f', {appearance.note}' if appearance.note else ''}"


def _views(plan: CatalogPlan, members: Sequence[Member]) -> list[str]:
    if plan.cameras:
        return [f"{len(plan.cameras)} shared by all members ({counted(plan.view_splits)})"]
    numbers = sorted(len(member.cameras) for member in members) or [0]
    splits = counted(split for member in members for split in member.view_splits)
    return [f"every member its own, {numbers[0]} to {numbers[-1]} ({splits} in all)"]


def _images(plan: CatalogPlan, members: Sequence[Member]) -> str:
    cameras = [camera for member in members for camera in member.cameras] or list(plan.cameras)
    count = sum(len(member.cameras) * len(member.appearances) for member in members)
    sizes = sorted({(camera.width, camera.height) for camera in cameras})
    size = ", ".join(f"{width}x{height}" for width, height in sizes[:4]) + (", ..." if len(sizes) > 4 else "")
    kind = "8-bit PNG" if plan.image_format == "png" else "float32 EXR"
    kind += ", one HDF5 file for each member" if plan.packed else ""
    ground = "with alpha" if plan.background is None else f"opaque on the background {_numbers(plan.background)}"
    return f"{count:,} of {size or 'no size yet'}, {kind}, {ground}"


def _numbers(values: Sequence[float]) -> str:
    return f"({', '.join(f'{value:g}' for value in values)})"
