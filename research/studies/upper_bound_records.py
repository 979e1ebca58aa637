"""Per-member upper bounds: records of as many Gaussians fitted to one unseen member alone."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from surrogate.storage.records import Record

FOLDER = "ceiling"  # of a scene's records
KIND, VERSION = "ceiling", 3
SHOWN = ("member", "split", "appearance", "parameters", "psnr", "ssim", "surrogate")  # in tables


def load_upper_bounds(records: Path) -> list[dict[str, Any]]:
    """All entries in the folder of a scene's records, the base appearance first."""
    found = map(entry_of, Record.load_all(records / FOLDER, KIND, VERSION).values())
    whole = [entry for entry in found if set(SHOWN) <= set(entry)]
    return sorted(whole, key=lambda entry: (len(entry["parameters"]), entry["appearance"]))


def entry_of(record: Record) -> dict[str, Any]:
    """A record as tables show it, with the machine and the commit that made it."""
    made = {"machine": dict(record.provenance.machine), "commit": record.provenance.commit}
    return {**{name: value for name, value in record.key.items() if name != "settings"}, **made, **record.values}
