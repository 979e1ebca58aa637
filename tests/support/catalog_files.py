"""Every file of a catalog, to compare before and after."""

from __future__ import annotations

from pathlib import Path

from catalogs.store.table import JOURNAL, SPARE


def tree(path: Path) -> dict[str, bytes]:
    """Every file below `path` but the lock and what is derived and hidden."""
    derived = {".lock", JOURNAL, SPARE}
    return {str(p.relative_to(path)): p.read_bytes() for p in path.rglob("*") if p.is_file() and p.name not in derived}
