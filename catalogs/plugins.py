"""Kinds that other packages add by entry points, such as appearances and readers."""

from __future__ import annotations

import sys
import warnings
from functools import lru_cache
from typing import Any

APPEARANCES, READERS = "gs_surrogate.appearances", "gs_surrogate.readers"


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
            warnings.warn(
                f"{point.name!r} of {package} in {group} is left out: another package has this name", stacklevel=3
            )
            continue
        try:
            loaded[point.name] = point.load()
        except Exception as error:
            problem = f"{type(error).__name__}: {error}"
            warnings.warn(
                f"{point.name!r} of {package} in {group} is left out, it does not load: {problem}", stacklevel=3
            )
    return loaded
