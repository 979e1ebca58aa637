"""Files that another file names."""

from __future__ import annotations

from pathlib import Path


def require_named(path: Path, name: str = "") -> None:
    """Raise ValueError unless there is a file at `path`, which another file calls `name`, by default its last part."""
    if not path.is_file():
        raise ValueError(f"there is no file {name or path.name}, which it names")
