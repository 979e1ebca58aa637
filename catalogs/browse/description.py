"""A catalog as its page needs it: columns rather than an object per member, so that 100,000 members stay a few megabytes."""

from __future__ import annotations

from collections.abc import Hashable, Iterable, Sequence
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from catalogs.store.catalog import Catalog, CatalogPlan, Member
from catalogs.vocabulary.appearance import Appearance, Isosurface, VolumeRendering, field_of
from catalogs.vocabulary.cameras import Camera
from catalogs.vocabulary.numbers import texts
from catalogs.vocabulary.parameters import SPLITS
from catalogs.vocabulary.variations import ISOVALUE, origins_of
from catalogs.vocabulary.variations.variation import appearance_named

DIGITS = 9  # of a parameter's value, at least: what tells any two float32 apart

Item = TypeVar("Item", bound=Hashable)


def describe(catalog: Catalog) -> dict[str, Any]:
    """The catalog as JSON values.

    Keys
    ----
    title : of the page.
    splits : names, of which all other splits are numbers.
    parameters, visualization : `name`, `unit`, `low`, `high`; of the latter also `values`, one per appearance or None.
    appearances : `name`, `title`, `kind`, and `group` of those in a variation.
    background : a CSS color or None.
    files : the file name of each view.
    viewpoints : sets of [x, y, z, up x, up y, up z] per view, unit vectors from the volume's middle to the camera, and upwards.
    view_splits : of each such set, a digit per view.
    appearance_sets : lists of numbers of appearances.
    members : columns `names`, `splits` (a digit each), `values` (a list per parameter), `viewpoints` and `appearances`.  The last
        two are numbers of sets, or None where all members have the first.
    """
    plan = catalog.plan
    members = catalog.members
    sets, which = _numbered(_view_keys(members, plan))
    orders, offered = _numbered(member.appearances for member in members)
    numbers = {name: i for i, name in enumerate(plan.appearance_names)}
    return {
        "title": _title(catalog),
        "splits": list(SPLITS),
        "parameters": plan.space.to_json(),
        "visualization": _visualization(plan),
        "appearances": [_appearance(a, plan) for a in plan.appearances],
        "background": _css(plan.background),
        "files": _file_names(catalog, members),
        "viewpoints": [points for points, _ in sets],
        "view_splits": [splits for _, splits in sets],
        "appearance_sets": [[numbers[name] for name in names] for names in orders],
        "members": {
            "names": [m.name for m in members],
            "splits": _digits(m.split for m in members),
            "values": [_short([m.parameters[name] for m in members]) for name in plan.space.names],
            "viewpoints": which if len(sets) > 1 else None,
            "appearances": offered if len(orders) > 1 else None,
        },
    }


def _numbered(items: Iterable[Item]) -> tuple[list[Item], list[int]]:
    """The different items in order of appearance, and which of them each is."""
    numbers: dict[Item, int] = {}
    which = [numbers.setdefault(item, len(numbers)) for item in items]
    return list(numbers), which


def _digits(splits: Iterable[str]) -> str:
    return "".join(str(SPLITS.index(split)) for split in splits)


def _short(values: Sequence[float]) -> list[float]:
    return [float(text) for text in texts(values, DIGITS)]


def _view_keys(members: Sequence[Member], plan: CatalogPlan) -> list[tuple[Any, str]]:
    """Viewpoints and splits of each member's views; worked out once for cameras that are shared."""
    shared = _viewpoints(plan.cameras, plan.bounds)
    return [
        (shared if m.cameras is plan.cameras else _viewpoints(m.cameras, plan.bounds), _digits(m.view_splits))
        for m in members
    ]


def _viewpoints(cameras: Sequence[Camera], bounds: Any) -> tuple[tuple[float, ...], ...]:
    middle = np.mean(bounds, axis=0)  # [3]
    points = []
    for camera in cameras:
        offset = camera.position - middle  # [3]
        distance = float(np.linalg.norm(offset))
        direction = offset / distance if distance > 0 else -camera.forward
        points.append(tuple(round(float(x), 6) + 0.0 for x in (*direction, *camera.up)))
    return tuple(points)


def _file_names(catalog: Catalog, members: Sequence[Member]) -> list[str]:
    if not members:
        return []
    most = max(len(member.cameras) for member in members)
    appearance = catalog.appearance_names[0]
    return [Path(catalog.plan.image_name(appearance, view)).name for view in range(most)]


def _title(catalog: Catalog) -> str:
    """The scene's name where one is known; else the folder's, or its parent's where every catalog is called "catalog"."""
    path = catalog.path.resolve()
    return str(catalog.plan.provenance.get("scene") or (path.parent.name if path.stem == "catalog" else path.stem))


def _visualization(plan: CatalogPlan) -> list[dict[str, Any]]:
    """The visualization parameters that differ between appearances: isovalues, places of a transfer function's points."""
    varied = [_places(plan, appearance.name) for appearance in plan.appearances]
    surfaces = {appearance.name for appearance in plan.appearances if isinstance(appearance, Isosurface)}
    having, units = {ISOVALUE: surfaces}, {ISOVALUE: _common_unit(plan)}
    for variation in (v for v in plan.variations if v.edits_base):
        for parameter in variation.space.parameters:
            having[parameter.name] = {variation.base, *variation.named(*SPLITS)}
            units[parameter.name] = parameter.unit or units.get(parameter.name, "")
    described = []
    for name in plan.varied_names:
        values = [v[name] if a.name in having[name] else None for a, v in zip(plan.appearances, varied, strict=True)]
        different = {value for value in values if value is not None}
        if len(different) > 1:
            described.append(
                {"name": name, "unit": units[name], "low": min(different), "high": max(different), "values": values}
            )
    return described


def _places(plan: CatalogPlan, name: str) -> dict[str, float]:
    """The values of an appearance as people read them: of control points their places, not how far they are displaced."""
    values = plan.varied(name)
    for variation in (v for v in plan.variations if v.edits_base and name in (v.base, *v.named(*SPLITS))):
        base = appearance_named(variation.base, plan.appearances)
        function = base.transfer_function if isinstance(base, VolumeRendering) else None
        origins = origins_of(function)
        values |= {n: float(f"{values[n] + origin:.12g}") for n, origin in origins.items() if n in values}
    return values


def _common_unit(plan: CatalogPlan) -> str:
    """The unit of all isovalues; "" where surfaces of fields in other units stand beside each other."""
    units = {plan.quantity(field_of(a)).unit for a in plan.appearances if isinstance(a, Isosurface)}
    return units.pop() if len(units) == 1 else ""


def _appearance(appearance: Appearance, plan: CatalogPlan) -> dict[str, str]:
    named = {"name": appearance.name, "title": _appearance_title(appearance, plan)}
    for variation in (v for v in plan.variations if v.continuous):
        setting = variation.setting(appearance.name)
        if setting is not None:
            return {**named, "kind": variation.plural, "group": f"{variation.plural}, {setting.split}"}
    return {**named, "kind": appearance.name}


def _appearance_title(appearance: Appearance, plan: CatalogPlan) -> str:
    """Its name and what sets it apart: its field, an isovalue, or where the moved points of a transfer function are."""
    said = [field_of(appearance)] if field_of(appearance) else []
    if isinstance(appearance, Isosurface):
        said.append(f"isovalue {appearance.isovalue:g} {plan.quantity(field_of(appearance)).unit}".rstrip())
    else:
        moved, places = plan.varied(appearance.name), _places(plan, appearance.name)
        said += [f"{name} {value:.3g}" for name, value in places.items() if moved[name]]
    return f"{appearance.name} ({', '.join(said)})" if said else appearance.name


def _css(color: Sequence[float] | None) -> str | None:
    return None if color is None else "#" + "".join(f"{round(255 * value):02x}" for value in color)
