"""The explorer as one file that needs no program: its page, the scripts that draw, and the surrogate.

Modules are compressed.  The page makes `data:` addresses of them, for an import map of names such as "draw/cards.js".  Nothing else
may run: the content security policy holds the digests of this map and of the script that makes it.  The model is data, as it is
stored.
"""

from __future__ import annotations

import base64
import gzip
import hashlib
import html
import json
import re
from dataclasses import replace
from importlib.resources import files
from typing import Any

from catalogs.vocabulary.variations.isovalue import IsovalueVariation
from catalogs.web import ASSETS
from surrogate.deformation.visualization import Visualization
from surrogate.explore.exporting.expectations import Expectations
from surrogate.explore.facts import facts
from surrogate.explore.run import Run
from surrogate.model import Surrogate
from surrogate.model.form import stored_form
from surrogate.model.representation import GAUSSIANS, VIEW
from surrogate.storage.models import StoredModel

PAGE = files("surrogate.explore") / "page"
DRAWN = ("parameters", "normalization", "deformation", "rasterizer", "field", "background")  # of the record
IMPORT = re.compile(r'from "(?:\./|\.\./web/|(draw/|web/))([a-z_]+\.js)"')
COMMENT = re.compile(r"^\s*(?://[^\n]*|/\*\*.*?\*/)\n", re.MULTILINE | re.DOTALL)
LOCAL, PROGRAM = "draw/local.js", "connection.js"
ENTRY = """(async () => {
const packed = Uint8Array.from(atob(document.getElementById("modules").textContent), letter => letter.charCodeAt(0));
const stream = new Blob([packed]).stream().pipeThrough(new DecompressionStream("gzip"));
const imports = JSON.parse(await new Response(stream).text());
for (const name in imports)
imports[name] = "data:text/javascript;base64," + btoa(String.fromCharCode(...new TextEncoder().encode(imports[name])));
const map = Object.assign(document.createElement("script"), { type: "importmap", textContent: JSON.stringify({ imports }) });
document.head.append(map);
await import("explore/explore.js");
})();"""
TEMPLATE = """<!doctype html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta http-equiv="Content-Security-Policy" content="{policy}">
<meta name="viewport" content="width=device-width, initial-scale=1">
<meta name="generator" content="gs-surrogate">
<title>{title}</title>
<link rel="icon" href="data:,">
<style>{styles}</style>
<script type="text/plain" id="surrogate">{given}</script>
<script type="text/plain" id="tensors">{tensors}</script>
<script type="text/plain" id="modules">{modules}</script>
</head>
<body><script>{entry}</script></body>
</html>
"""


def page_bytes(run: Run, expected: Expectations | None = None) -> bytes:
    """The page of a run, as HTML, which says what error to expect where that is known.

    Raises ValueError for a surrogate without Gaussians, which the page can't draw.
    """
    surrogate = run.surrogate
    require_drawable(surrogate)
    whole = stored_form(surrogate)
    modules = _modules()
    imports = {name: f"data:text/javascript;base64,{_base64(text.encode())}" for name, text in modules.items()}
    map_of_them = json.dumps({"imports": imports}, separators=(",", ":"))  # as `JSON.stringify` writes it
    policy = (
        f"default-src 'none'; script-src {_digest(map_of_them)} {_digest(ENTRY)} data:; style-src 'unsafe-inline'; "
        "img-src data: blob:; base-uri 'none'; form-action 'none'"
    )
    styles = "".join(part.read_text(encoding="utf-8") for part in (ASSETS / "look.css", PAGE / "explore.css"))
    return TEMPLATE.format(
        policy=policy,
        title=html.escape(f"{run.title} · gs-surrogate"),
        styles=styles,
        given=_packed(json.dumps(_content(run, whole, expected or Expectations())).encode()),
        tensors=_packed(whole.contents()[0]),
        modules=_packed(json.dumps(modules).encode()),
        entry=ENTRY,
    ).encode()


def require_drawable(surrogate: Surrogate) -> None:
    """Raise ValueError for a surrogate whose pictures a page can't draw."""
    if not len(surrogate.gaussians):
        raise ValueError(
            "a page is drawn by Gaussians, and this surrogate has none: explore the run with `surrogate explore RUN` instead"
        )


def _content(run: Run, whole: StoredModel, expected: Expectations) -> dict[str, Any]:
    """Everything that the page must know, as JSON values."""
    surrogate = replace(run.surrogate, field=None)
    page_facts = facts(replace(run, surrogate=surrogate))
    record = {name: whole.record[name] for name in DRAWN if name in whole.record}
    return {
        "facts": page_facts | {"truth": False, "exports": {"png": "PNG"}},
        "record": record | {"visualizations": [_visualization(v) for v in surrogate.visualizations]},
        "expected": expected.to_json() | {"sentence": expected.why or _average(run.surrogate)},
    }


def _visualization(one: Visualization) -> dict[str, Any]:
    """A visualization's record, with what normalizes its parameters in place of all its settings."""
    variation = one.variation
    form = {"kind": variation.kind, "base": variation.base, "parameters": variation.space.to_json()}
    trained = sorted(values[0] for values in variation.trained) if variation.kind == IsovalueVariation.kind else []
    return one.record() | {"variation": form | {"trained": trained}}


def _average(surrogate: Surrogate) -> str:
    psnr = surrogate.scores.psnr.get(VIEW, {}).get(GAUSSIANS)
    return "" if psnr is None else f"Pictures of runs that training did not see: PSNR {psnr:.1f} dB on average"


def _modules() -> dict[str, str]:
    """The text of every module by a name of its own."""
    rooms = {"draw": PAGE / "draw", "explore": PAGE, "web": ASSETS}
    return {
        f"{room}/{file.name}": _short(_named(room, file.read_text(encoding="utf-8")))
        for room, folder in rooms.items()
        for file in sorted(folder.iterdir(), key=lambda file: file.name)
        if file.name.endswith(".js") and (room, file.name) != ("explore", PROGRAM)
    }


def _named(room: str, text: str) -> str:
    """A module whose imports have names: relative addresses mean nothing in `data:`."""

    def name(match: re.Match[str]) -> str:
        address, file = match.group(0), match.group(2)
        if file == PROGRAM:
            return f'from "{LOCAL}"'
        if match.group(1):
            return address
        return f'from "{"web" if "../web/" in address else room}/{file}"'

    return IMPORT.sub(name, text)


def _short(text: str) -> str:
    """A module without indentation, and without comments that have lines of their own."""
    return "\n".join(filter(None, (line.strip() for line in COMMENT.sub("", text).splitlines())))


def _packed(content: bytes) -> str:
    """The base64 of gzip."""
    return _base64(gzip.compress(content, mtime=0))


def _digest(script: str) -> str:
    """The source expression of an inline script (Content Security Policy Level 3, section 8.3)."""
    return f"'sha256-{_base64(hashlib.sha256(script.encode()).digest())}'"


def _base64(content: bytes) -> str:
    return base64.b64encode(content).decode()
