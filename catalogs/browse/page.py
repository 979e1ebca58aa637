"""Write a catalog's page: one `index.html` with everything in it but the pictures.

The page works from any static host and straight from the file system, where a script may not fetch files: so the members and
viewpoints travel inside it.  It asks nobody else for anything, and its content security policy holds it to that.
"""

from __future__ import annotations

import base64
import hashlib
import json
from collections.abc import Sequence
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np

from catalogs import durable
from catalogs.appearance import Appearance, Isosurface, field_of
from catalogs.cameras import Camera
from catalogs.catalog import Catalog, CatalogError, CatalogPlan, Member

PAGE = "index.html"


def write_page(path: Path) -> Path:
    """Write `index.html` into the catalog at `path` and return its path.

    Raises CatalogError where there is no catalog or its pictures are none that browsers show, OSError where the folder refuses.
    """
    page = path / PAGE
    durable.replace(page, page_of(Catalog.open(path)).encode())
    return page


def page_of(catalog: Catalog) -> str:
    """The HTML of the page, as it stands with the catalog's present members."""
    if catalog.plan.image_format != "png":
        raise CatalogError(f"{catalog.path} holds {catalog.plan.image_format} images, which no browser shows: only png")
    style, script = _asset("page.css"), _asset("page.js")
    # "<" in a name must not end the script element that carries the data.
    data = json.dumps(describe(catalog), allow_nan=False, separators=(",", ":")).replace("<", "\\u003c")
    policy = (
        f"default-src 'none'; img-src 'self' file: data:; style-src '{_hash(style)}'; script-src '{_hash(script)}'; "
        "base-uri 'none'; form-action 'none'"
    )
    page = _asset("page.html")
    for place, content in (("STYLE", style), ("SCRIPT", script), ("POLICY", policy), ("CATALOG", data)):
        page = page.replace(f"/*{place}*/", content)
    return page


def describe(catalog: Catalog) -> dict[str, Any]:
    """What the page needs to know of the catalog, as JSON values.

    Keys: `title`; `parameters`; `appearances` (`name`, `title`, and `group` of those in a variation); `background` as a CSS
    color or None; `files`, the file name of each view; `viewpoints`, sets of [x, y, z, up x, up y, up z] per view, unit
    vectors from the volume's middle towards the camera and to the top of its picture; `splits`, of the views of each set;
    `members` (`name`, `split`, `values`, `viewpoints`: which set, and `appearances`: which, by number, unless all).
    """
    plan = catalog.plan
    members = catalog.members
    sets: dict[tuple[Any, ...], int] = {}
    rows = []
    for member in members:
        views = _viewpoints(member.cameras, plan.bounds), member.view_splits
        rows.append(
            {
                "name": member.name,
                "split": member.split,
                "values": [member.parameters[name] for name in plan.space.names],
                "viewpoints": sets.setdefault(views, len(sets)),
                **_appearances_of(member, plan.appearance_names),
            }
        )
    most = max((len(m.cameras) for m in members), default=0)
    return {
        "title": _title(catalog),
        "parameters": plan.space.to_json(),
        "appearances": [_appearance(a, plan) for a in plan.appearances],
        "background": _css(plan.background),
        "files": _file_names(catalog, members, most),
        "viewpoints": [points for points, _ in sets],
        "splits": [splits for _, splits in sets],
        "members": rows,
    }


def _appearances_of(member: Member, names: Sequence[str]) -> dict[str, list[int]]:
    """Which of the catalog's appearances the member shows; nothing where it shows all."""
    if len(member.appearances) == len(names):
        return {}
    shown = set(member.appearances)
    return {"appearances": [i for i, name in enumerate(names) if name in shown]}


def _viewpoints(cameras: Sequence[Camera], bounds: Any) -> tuple[tuple[float, ...], ...]:
    middle = np.mean(bounds, axis=0)  # [3]
    points = []
    for camera in cameras:
        offset = camera.position - middle  # [3]
        distance = float(np.linalg.norm(offset))
        direction = offset / distance if distance > 0 else -camera.forward
        points.append(tuple(round(float(x), 6) + 0.0 for x in (*direction, *camera.up)))
    return tuple(points)


def _file_names(catalog: Catalog, members: Sequence[Member], count: int) -> list[str]:
    if not members:
        return []
    appearance = catalog.appearance_names[0]
    return [catalog.image_path(members[0], appearance, view).name for view in range(count)]


def _title(catalog: Catalog) -> str:
    """The scene's name where one is known; else the folder's, or its parent's where every catalog is called "catalog"."""
    path = catalog.path.resolve()
    return str(catalog.plan.provenance.get("scene") or (path.parent.name if path.stem == "catalog" else path.stem))


def _appearance(appearance: Appearance, plan: CatalogPlan) -> dict[str, str]:
    said = {"name": appearance.name, "title": _appearance_title(appearance, plan)}
    setting = plan.setting(appearance.name)
    variation = next((v for v in plan.variations if v.setting(appearance.name) is not None), None)
    if setting is None or variation is None or not variation.in_table:
        return said
    kind = variation.kind
    return {**said, "group": f"{kind.replace('_', ' ')}s, {setting.split}"}


def _appearance_title(appearance: Appearance, plan: CatalogPlan) -> str:
    """Its name and what sets it apart: its field, an isovalue, or how the points of a transfer function are displaced."""
    said = [field_of(appearance)] if field_of(appearance) else []
    if isinstance(appearance, Isosurface):
        said.append(f"isovalue {appearance.isovalue:g}")
    else:
        said += [f"{name} {value:+.3g}" for name, value in plan.varied(appearance.name).items() if value]
    return f"{appearance.name} ({', '.join(said)})" if said else appearance.name


def _css(color: Sequence[float] | None) -> str | None:
    return None if color is None else "#" + "".join(f"{round(255 * value):02x}" for value in color)


def _asset(name: str) -> str:
    return files("catalogs.browse").joinpath(name).read_text(encoding="utf-8")


def _hash(content: str) -> str:
    return f"sha256-{base64.b64encode(hashlib.sha256(content.encode()).digest()).decode()}"
