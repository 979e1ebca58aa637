"""Names of exported files: the run, what is shown, and a mark that tells exports apart."""

from __future__ import annotations

import hashlib
import json
import re
from dataclasses import fields, is_dataclass
from typing import Any

from catalogs.vocabulary.cameras import Camera
from catalogs.vocabulary.numbers import text
from native.ray_casting.cuts import AXES
from surrogate.explore.cuts import record_of_cut
from surrogate.explore.functions import record_of_function
from surrogate.explore.run import Run
from surrogate.explore.setting import Setting, with_origins

MOST_LETTERS = 72  # before the mark
MARK = 6  # hexadecimal digits of a SHA-256 over all that is asked for


def file_name(run: Run, request: Any) -> str:
    """Such as `tgv-tf-Re-1830-c2_opacity-0.45-3f9a1c`, without an ending: of letters, digits, `.`, `_` and `-`, at most 79.

    `request` is a record of `surrogate.explore.exporting.exports`; equal ones have equal names.
    """
    words = [run.title or "surrogate", *_words(run, request)]
    stem = "-".join(filter(None, map(_safe, words)))[:MOST_LETTERS].strip("-.") or "surrogate"
    content = json.dumps([type(request).__name__, _plain(request)], sort_keys=True)
    return f"{stem}-{hashlib.sha256(content.encode(errors='replace')).hexdigest()[:MARK]}"


def _words(run: Run, request: Any) -> list[str]:
    sweep = getattr(request, "sweep", None)
    if sweep is None:
        against = ["compared"] if hasattr(request, "other") else []
        return [*against, *_values(run, request.setting.values), *_looks(request.setting)]
    over = [
        f"{axis.name}-{text(axis.low + axis.origin)}-to-{text(axis.high + axis.origin)}"
        for axis in reversed(sweep.axes)
    ]
    return [*over, *_values(run, sweep.fixed), *_looks(sweep.base)]


def _looks(setting: Setting) -> list[str]:
    clip, plane = (setting.cut.box, setting.cut.plane) if setting.cut else (None, None)
    cut = [clip and "clip", plane and f"slice-{AXES[plane[0]]}-{text(plane[1])}"]
    return [word or "" for word in (setting.function and "function", setting.color_map, *cut, setting.using)]


def _values(run: Run, values: dict[str, float | str]) -> list[str]:
    """Each with its name, but control points that stand where the base has them."""
    moved = {name: value for name, value in values.items() if name not in run.origins or value}
    return [
        f"{name}-{value if isinstance(value, str) else format(value, 'g')}"
        for name, value in with_origins(moved, run.origins).items()
    ]


def _safe(word: str) -> str:
    return re.sub(r"[^A-Za-z0-9._-]+", "-", word).strip("-.")


def _plain(value: Any) -> Any:
    """A record in JSON values."""
    if isinstance(value, Camera):
        return value.to_json()
    if isinstance(value, Setting):
        function = [] if value.function is None else [record_of_function(value.function)]
        cut = [record_of_cut(value.cut)] if value.cut else []
        return [dict(value.values), value.color_map, *filter(None, [value.using]), *function, *cut]
    if is_dataclass(value):
        return [_plain(getattr(value, field.name)) for field in fields(value)]
    return [_plain(part) for part in value] if isinstance(value, tuple | list) else value
