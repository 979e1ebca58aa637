"""Names and counts in words."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence

from catalogs.parameters import SPLITS


def shortened(names: Sequence[str], most: int = 12) -> str:
    """The names with commas between; of many only the first, and how many there are."""
    return ", ".join(names[:most]) + (f", ... ({len(names)} in all)" if len(names) > most else "")


def counted(splits: Iterable[str]) -> str:
    """How many of these are of each split, such as "2 train, 0 validation, 1 test"."""
    counts = Counter(splits)
    return ", ".join(f"{counts[split]} {split}" for split in SPLITS)
