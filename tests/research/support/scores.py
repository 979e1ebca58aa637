"""Scores made by hand, so that their means and deviations are known."""

from __future__ import annotations

from typing import Any

from research.studies.repeats.seeds import Scores
from surrogate.evaluation.cases import PARAMETERS, SETTINGS, VIEWS
from surrogate.evaluation.scoring import METRICS
from surrogate.storage.records import Provenance


def cells_of(value: float | None, rows: Any = VIEWS, images: int = 7) -> dict[str, Any]:
    """The same value of every metric in every cell."""
    filled = {row: dict.fromkeys(PARAMETERS, value) for row in rows}
    counts = {row: dict.fromkeys(PARAMETERS, images if value is not None else 0) for row in rows}
    return {**dict.fromkeys(METRICS, filled), "images": counts}


def scores_of(seed: int, value: float | None, *, varied: float | None = None, base: str = "base") -> Scores:
    """A seed that scores `value` everywhere, and `varied` under isovalues where that is given."""
    isovalues = {"kind": "isovalue", "base": "dvr", **cells_of(varied, SETTINGS)}
    return Scores(
        seed=seed,
        fingerprint=f"seed {seed}",
        base=base,
        settings={},
        cells=cells_of(value),
        variations=() if varied is None else (isovalues,),
        gaussians=1000 + 10 * seed,
        megabytes=0.5 + seed,
        seconds=100.0 + seed,
        provenance=Provenance(
            "abc", "", {"processor": "abacus", "cores": 2, "system": "wood"}, "2026-01-01T00:00:00+00:00"
        ),
    )
