"""Write a catalog's page: one `index.html` with everything in it but the pictures.

The page works from any static host and straight from the file system, where a script may not fetch files: so the members and
viewpoints travel inside it.  It asks nobody else for anything, and its content security policy holds it to that.

Plain files are joined here in a fixed order rather than by a bundler: a catalog needs no Node.js where it is made.
"""

from __future__ import annotations

import base64
import hashlib
import json
from pathlib import Path
from urllib.parse import urlsplit

from catalogs.browse.description import describe
from catalogs.files import durable
from catalogs.store.catalog import Catalog, CatalogError
from catalogs.web import ASSETS

PAGE = "index.html"
FOLDER = Path(__file__).parent
SHARED_SCRIPTS = ("vectors", "elements")
SCRIPTS = (
    "catalog",
    "state",
    "pictures",
    "turning",
    "controls",
    "difference",
    "grid",
    "lines",
    "brushes",
    "start",
)


def write_page(path: Path) -> Path:
    """Write `index.html` into the catalog at `path` and return its path.

    Raises CatalogError where there is no catalog or browsers can't show its image format, OSError where the folder refuses.
    """
    durable.replace(path / PAGE, page_of(Catalog.open(path)).encode())
    return path / PAGE


def page_of(catalog: Catalog, explorer: str = "") -> str:
    """The HTML of the page with the catalog's present members, whose pictures link to the address of an `explorer`.

    Raises ValueError for an address that is not of HTTP.
    """
    if explorer and urlsplit(explorer).scheme not in ("http", "https"):
        raise ValueError(
            f"the address of an explorer begins with http://, as `surrogate explore` prints it, got {explorer!r}"
        )
    if catalog.plan.image_format != "png":
        raise CatalogError(f"{catalog.path} holds {catalog.plan.image_format} images, which no browser shows: only png")
    style = _text(ASSETS / "look.css") + _text(FOLDER / "page.css")
    shared = "".join(_text(ASSETS / f"{name}.js") for name in SHARED_SCRIPTS).replace("\nexport ", "\n")
    script = '"use strict";\n' + shared + "".join(_text(FOLDER / "script" / f"{name}.js") for name in SCRIPTS)
    # "<" in a name must not end the script element that carries the data.
    data = json.dumps(
        describe(catalog) | {"explorer": explorer.partition("#")[0]}, allow_nan=False, separators=(",", ":")
    ).replace("<", "\\u003c")
    policy = (
        f"default-src 'none'; img-src 'self' file: data:; style-src '{_hash(style)}'; script-src '{_hash(script)}'; "
        "base-uri 'none'; form-action 'none'"
    )
    page = _text(FOLDER / "page.html")
    for place, content in (("STYLE", style), ("SCRIPT", script), ("POLICY", policy), ("CATALOG", data)):
        page = page.replace(f"/*{place}*/", content)
    return page


def _text(path: Path) -> str:
    return path.read_text(encoding="utf-8")


def _hash(content: str) -> str:
    return f"sha256-{base64.b64encode(hashlib.sha256(content.encode()).digest()).decode()}"
