"""Write the page into the catalog: `index.html` with everything in it but the images.

The page works from any static host and from the file system (where scripts may not fetch), so the table travels inside it.
"""

from __future__ import annotations

import json
from importlib.resources import files
from pathlib import Path
from typing import Any

from catalogs import durable
from catalogs.catalog import Catalog

PAGE = "index.html"
PLACE = "/*CATALOG*/null"


def write_page(path: Path) -> Path:
    """Write `index.html` into the catalog at `path` and return its path; raises CatalogError where there is none."""
    catalog = Catalog.open(path)
    template = files("catalogs.browse").joinpath("page.html").read_text(encoding="utf-8")
    # "<" in a name must not end the script element.
    data = json.dumps(describe(catalog), allow_nan=False, separators=(",", ":")).replace("<", "\\u003c")
    page = path / PAGE
    durable.replace(page, template.replace(PLACE, data).encode())
    return page


def describe(catalog: Catalog) -> dict[str, Any]:
    """What the page needs: parameters, appearances, members and the directions of their views."""
    plan = catalog.plan
    members = catalog.members
    shared = _directions(plan.cameras)
    return {
        "title": str(plan.provenance.get("scene", catalog.path.stem)),
        "parameters": plan.space.to_json(),
        "appearances": catalog.appearance_names,
        "image": catalog.image_name("{appearance}", 0).replace("000", "{view}"),
        "members": [
            {
                "name": m.name,
                "split": m.split,
                "values": [m.parameters[n] for n in plan.space.names],
                "views": None if plan.cameras else _directions(m.cameras),
            }
            for m in members
        ],
        "views": shared,
    }


def _directions(cameras: Any) -> list[list[float]]:
    """Per camera the unit vector towards it and its up vector, six numbers."""
    return [[round(float(x), 5) for x in (*(-c.forward), *c.up)] for c in cameras]
