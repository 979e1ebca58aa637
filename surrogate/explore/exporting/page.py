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
from catalogs.vocabulary.words import plural
from catalogs.web import ASSETS
from surrogate.deformation.visualization import Visualization
from surrogate.explore.exporting.expectations import Expectations
from surrogate.explore.exporting.page_field import field_of_page, stored_field
from surrogate.explore.facts import facts
from surrogate.explore.run import Run
from surrogate.model import Surrogate
from surrogate.model.form import stored_form
from surrogate.model.representation import FIELD, GAUSSIANS, KINDS, VIEW
from surrogate.storage.models import StoredModel

PAGE = files("surrogate.explore") / "page"
DRAWN = ("normalization", "deformation", "rasterizer", "field", "background")  # of the record
IMPORT = re.compile(r'from "(?:\./|\.\./web/|(draw/|web/|explore/))([a-z_]+\.js)"')
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
<script type="text/plain" id="field">{field}</script>
<script type="text/plain" id="modules">{modules}</script>
</head>
<body><script>{entry}</script></body>
</html>
"""


def page_bytes(run: Run, expected: Expectations | None = None, modes: int | None = None) -> bytes:
    """The page of a run, as HTML, which says what error to expect where that is known.

    It holds the Gaussians, and the emulated field with at most a number of `modes`: 0 leaves it out.  By default it is there
    where it draws best, or alone.  Raises ValueError for a surrogate that has nothing that a page can draw.
    """
    surrogate, field = run.surrogate, field_of_page(run.surrogate, modes)
    emulation = None if field is None else stored_field(field, modes)
    if emulation is None and not len(surrogate.gaussians):
        raise ValueError(
            "a page is drawn by Gaussians or an emulated field, and this one would hold neither: explore the run with "
            "`surrogate explore RUN` instead"
        )
    whole = stored_form(surrogate) if len(surrogate.gaussians) else None
    content = _content(run, whole, emulation, expected or Expectations(why=_average(surrogate)))
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
        given=_packed(json.dumps(content).encode()),
        tensors=_tensors(whole),
        field=_tensors(emulation),
        modules=_packed(json.dumps(modules).encode()),
        entry=ENTRY,
    ).encode()


def page_contents(run: Run, modes: int | None = None) -> str:
    """The contents of the page in words, with what the emulated field adds to it."""
    surrogate, field = run.surrogate, field_of_page(run.surrogate, modes)
    parts = [f"{len(surrogate.gaussians):,} Gaussians"] if len(surrogate.gaussians) else []
    if field is not None:
        emulation = stored_field(field, modes)
        fields = emulation.record["fields"]
        count, size = sum(len(one["groups"]) for one in fields), len(_tensors(emulation)) / 1e6
        parts.append(f"{plural(len(fields), 'emulated field')} ({plural(count, 'mode')}, which add {size:.1f} MB)")
    return " and ".join(parts)


def _tensors(model: StoredModel | None) -> str:
    return "" if model is None else _packed(model.contents()[0])


def _content(
    run: Run, whole: StoredModel | None, emulation: StoredModel | None, expected: Expectations
) -> dict[str, Any]:
    """Everything that the page must know, as JSON values."""
    surrogate = run.surrogate if emulation is not None else replace(run.surrogate, field=None)
    if whole is None:
        surrogate = surrogate.using(FIELD)
    sizes = {name: model.megabytes for name, model in ((GAUSSIANS, whole), (FIELD, emulation)) if model is not None}
    page_facts = facts(replace(run, surrogate=surrogate))
    record = {} if whole is None else {name: whole.record[name] for name in DRAWN if name in whole.record}
    return {
        "facts": page_facts | {"truth": False, "exports": {"png": "PNG"}},
        "record": {
            "parameters": surrogate.space.to_json(),
            **record,
            "visualizations": [_visualization(v) for v in surrogate.visualizations],
            "emulation": emulation and emulation.record,
        },
        "megabytes": sizes,
        "best": {kind: surrogate.representation(kind) for kind in KINDS},
        "expected": expected.to_json(),
    }


def _visualization(one: Visualization) -> dict[str, Any]:
    """A visualization's record, with what normalizes its parameters in place of all its settings."""
    variation = one.variation
    form = {"kind": variation.kind, "base": variation.base, "parameters": variation.space.to_json()}
    trained = sorted(values[0] for values in variation.trained) if variation.kind == IsovalueVariation.kind else []
    return one.record() | {"variation": form | {"trained": trained}}


def _average(surrogate: Surrogate) -> str:
    psnr = surrogate.scores.psnr.get(VIEW, {}).get(surrogate.representation(VIEW))
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
