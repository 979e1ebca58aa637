"""Kinds that other packages add by entry points, such as appearances and readers."""

from __future__ import annotations

import sys
import warnings
from functools import lru_cache
from types import FrameType
from typing import Any

OURS = {"catalogs", "insitu", "native", "render", "surrogate"}
APPEARANCES, READERS = "gs_surrogate.appearances", "gs_surrogate.readers"
TABLES = "gs_surrogate.scene_tables"  # of scenes, checked by the functions that read them


class PluginWarning(UserWarning):
    """An object of another package was left out."""


def leave_out(name: str, package: str, group: str, problem: str) -> None:
    """Warn that an object of another package is not used, at the line that called into this project."""
    frame: FrameType | None = sys._getframe()
    level = 1
    while frame is not None and frame.f_globals.get("__name__", "").partition(".")[0] in OURS:
        frame, level = frame.f_back, level + 1
    warnings.warn(f"{name!r} of {package} in {group} is left out: {problem}", PluginWarning, stacklevel=level)


def package_of(name: str, group: str) -> str:
    """The package that registers a name."""
    from importlib.metadata import entry_points

    entry = next(iter(entry_points(group=group, name=name)), None)
    return "another package" if entry is None else entry.dist.name if entry.dist else entry.module


def plugins(group: str) -> dict[str, Any]:
    """Objects that installed packages register under an entry point group, loaded, by the names they give them.

    One that does not load is left out, with a warning that names its package.
    """
    return dict(_loaded(group, tuple(sys.path)))


@lru_cache
def _loaded(group: str, path: tuple[str, ...]) -> dict[str, Any]:
    """Plugins on one search path: the cache forgets them where it changes."""
    from importlib.metadata import entry_points  # 10 ms

    loaded: dict[str, Any] = {}
    for point in entry_points(group=group):
        package = point.dist.name if point.dist else point.module
        if point.name in loaded:
            leave_out(point.name, package, group, "another package has this name")
            continue
        try:
            loaded[point.name] = point.load()
        except Exception as error:
            leave_out(point.name, package, group, f"it does not load: {type(error).__name__}: {error}")
    return loaded
