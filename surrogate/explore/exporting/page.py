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
from importlib.resources import files

from catalogs.vocabulary.words import plural
from catalogs.web import ASSETS
from surrogate.explore.exporting.expectations import Expectations
from surrogate.explore.exporting.page_field import field_of_page, stored_field
from surrogate.explore.exporting.page_model import PageModel, average
from surrogate.explore.run import Run

PAGE = files("surrogate.explore") / "page"
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
    """The page of a run, as HTML, which says what error to expect where that is measured; see `PageModel.of`."""
    model = PageModel.of(run, modes)
    expectations = expected or Expectations(why=average(run.surrogate, model.content["megabytes"]))
    content = model.content | {"expected": expectations.to_json()}
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
        tensors=_packed(model.tensors),
        field=_packed(model.field),
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
        count, size = sum(len(one["groups"]) for one in fields), len(_packed(emulation.contents()[0])) / 1e6
        parts.append(f"{plural(len(fields), 'emulated field')} ({plural(count, 'mode')}, which add {size:.1f} MB)")
    return " and ".join(parts)


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
    """The base64 of gzip; of nothing nothing."""
    return "" if not content else _base64(gzip.compress(content, mtime=0))


def _digest(script: str) -> str:
    """The source expression of an inline script (Content Security Policy Level 3, section 8.3)."""
    return f"'sha256-{_base64(hashlib.sha256(script.encode()).digest())}'"


def _base64(content: bytes) -> str:
    return base64.b64encode(content).decode()
