"""The explorer without a program: its page, the scripts that draw, and the surrogate, in one file or in a folder for a web host.

In the one file modules and styles are compressed.  The page makes `data:` addresses of them, for an import map of names such as
"draw/cards.js".  Nothing else may run: the content security policy holds the digests of this map and of the script that makes it.
In a folder they are files, of which the policy allows those of its host.  The model is data, as it is stored.
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
BEHIND = re.compile(r"\s// [^\"'`\n]*$", re.MULTILINE)
LOCAL, PROGRAM = "draw/local.js", "connection.js"
ENTRY = """(async () => {
const packed = Uint8Array.from(atob(document.getElementById("modules").textContent), letter => letter.charCodeAt(0));
const stream = new Blob([packed]).stream().pipeThrough(new DecompressionStream("gzip"));
const { styles, imports } = JSON.parse(await new Response(stream).text());
for (const name in imports)
imports[name] = "data:text/javascript;base64," + btoa(String.fromCharCode(...new TextEncoder().encode(imports[name])));
const map = Object.assign(document.createElement("script"), { type: "importmap", textContent: JSON.stringify({ imports }) });
document.head.append(Object.assign(document.createElement("style"), { textContent: styles }), map);
await import("explore/explore.js");
})();"""
TEMPLATE = """<!doctype html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta http-equiv="Content-Security-Policy" content="{policy}">
<meta name="viewport" content="width=device-width, initial-scale=1">
<meta name="generator" content="gs-surrogate">
<meta name="color-scheme" content="dark light">
<title>{title}</title>
<link rel="icon" href="data:,">
{head}
</head>
<body>{body}</body>
</html>
"""
LOADING = "<p>Loading… Browsers open this page from a web server only, such as <code>python -m http.server</code>.</p>"
POLICY = "default-src 'none'; img-src data: blob:; base-uri 'none'; form-action 'none'"
DATA = ("surrogate", "tensors", "field")  # elements that hold the model, or say which file does
FILES = dict(zip(DATA, ("surrogate.json", "model.safetensors", "field.safetensors"), strict=True))
ROOMS = json.dumps({"imports": {f"{room}/": f"./{room}/" for room in ("draw", "explore", "web")}})


def page_bytes(run: Run, expected: Expectations | None = None, modes: int | None = None) -> bytes:
    """The page of a run, as HTML, which says what error to expect where that is measured; see `PageModel.of`."""
    modules, styles = _modules(), _styles()
    imports = {name: f"data:text/javascript;base64,{_base64(text.encode())}" for name, text in modules.items()}
    map_of_them = json.dumps({"imports": imports}, separators=(",", ":"))  # as `JSON.stringify` writes it
    # `data:` is for the modules, which a file has no other addresses for; `ENTRY` and the map are the only scripts that import any.
    scripts = f"script-src {_digest(map_of_them)} {_digest(ENTRY)} data:"
    packed = {**_data(run, expected, modes), "modules": json.dumps({"styles": styles, "imports": modules}).encode()}
    elements = [f'<script type="text/plain" id="{name}">{_packed(data)}</script>' for name, data in packed.items()]
    return _html(run, f"{scripts}; style-src {_digest(styles)}", "\n".join(elements), f"<script>{ENTRY}</script>")


def page_files(run: Run, expected: Expectations | None = None, modes: int | None = None) -> dict[str, bytes]:
    """The same page as files by their paths, for a folder on a web host: index.html, its modules, and the model as binary files."""
    data = {FILES[name]: part for name, part in _data(run, expected, modes).items() if part}
    elements = [f'<script type="text/plain" id="{i}" data-file="{file}"></script>' for i, file in FILES.items()]
    elements = [one for one, file in zip(elements, FILES.values(), strict=True) if file in data]
    head = [
        '<link rel="stylesheet" href="explore/page.css">',
        *elements,
        f'<script type="importmap">{ROOMS}</script>',
        '<script type="module" src="explore/explore.js"></script>',
    ]
    policy = f"script-src 'self' {_digest(ROOMS)}; style-src 'self'; connect-src 'self'"
    modules = {name: text.encode() for name, text in _modules().items()}
    page = {"index.html": _html(run, policy, "\n".join(head), LOADING), "explore/page.css": _styles().encode()}
    return {**page, **modules, **data}


def _data(run: Run, expected: Expectations | None, modes: int | None) -> dict[str, bytes]:
    """The surrogate, by the names of `DATA`; empty for what it does not have."""
    model = PageModel.of(run, modes)
    expectations = expected or Expectations(why=average(run.surrogate, model.content["megabytes"]))
    content = json.dumps(model.content | {"expected": expectations.to_json()}).encode()
    return dict(zip(DATA, (content, model.tensors, model.field), strict=True))


def _html(run: Run, policy: str, head: str, body: str) -> bytes:
    title = html.escape(f"{run.title} · gs-surrogate")
    return TEMPLATE.format(policy=f"{POLICY}; {policy}", title=title, head=head, body=body).encode()


def _styles() -> str:
    return "".join(part.read_text(encoding="utf-8") for part in (ASSETS / "look.css", PAGE / "explore.css"))


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
    """A module without indentation and comments; those behind code stay where they quote something."""
    return "\n".join(filter(None, (line.strip() for line in BEHIND.sub("", COMMENT.sub("", text)).splitlines())))


def _packed(content: bytes) -> str:
    """The base64 of gzip; of nothing nothing."""
    return "" if not content else _base64(gzip.compress(content, mtime=0))


def _digest(script: str) -> str:
    """The source expression of an inline script (Content Security Policy Level 3, section 8.3)."""
    return f"'sha256-{_base64(hashlib.sha256(script.encode()).digest())}'"


def _base64(content: bytes) -> str:
    return base64.b64encode(content).decode()
