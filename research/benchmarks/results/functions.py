"""The table of transfer functions that training never showed, measured against the field itself."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from research.benchmarks.results.scenes import SceneResults
from research.benchmarks.results.sources import made_from
from research.benchmarks.training.functions.departures import PEAK, TRAINED
from research.benchmarks.training.functions.measured import mean_and_worst, unseen
from surrogate.evaluation.tables import NOTHING, table

TEXT = (
    "Test members at test views, rendered again from their fields under functions that differ from the one that was trained.  "
    "These are half and twice its opacity, a ramp, its high values only, low values only, a bump in the middle, and its colours "
    "exchanged.  A narrow peak is apart from the others.  PSNR in dB, in brackets that of the image under the trained function "
    "instead."
)


def functions_section(scenes: Sequence[SceneResults]) -> list[str]:
    """The section in Markdown; nothing where no scene was measured."""
    measured = [scene for scene in scenes if scene.functions]
    if not measured:
        return []
    names = list(dict.fromkeys(row.function for scene in measured for _, rows in scene.functions for row in rows))
    names = [name for name in names if name not in (TRAINED, PEAK)]
    header = ("scene", "mean", "worst function", *names, PEAK, TRAINED, "seeds", "images")
    return [
        "## Transfer functions never trained",
        TEXT,
        table(header, (_row(scene, names) for scene in measured)),
        f"<sub>{'; '.join(map(_source, measured))}.</sub>",
    ]


def _row(scene: SceneResults, names: Sequence[str]) -> list[str]:
    seeds = [rows for _, rows in scene.functions]
    means, worst = zip(*map(mean_and_worst, seeds), strict=True)
    of_worst = min(unseen(seeds[0]), key=lambda row: row.psnr).function
    return [
        f"`{scene.name}`",
        f"**{_spread(means)}**",
        f"**{_spread(worst)}** ({of_worst})",
        *(_cell(scene, name) for name in (*names, PEAK, TRAINED)),
        str(len(seeds)),
        str(seeds[0][0].images),
    ]


def _cell(scene: SceneResults, function: str) -> str:
    matching = [row for _, rows in scene.functions for row in rows if row.function == function]
    if not matching:
        return NOTHING
    instead = "" if function == TRAINED else f" ({np.mean([row.instead for row in matching]):.1f})"
    return f"{_spread([row.psnr for row in matching])}{instead}"


def _spread(values: Sequence[float]) -> str:
    return f"{np.mean(values):.2f}" + (f" ± {np.std(values, ddof=1):.2f}" if len(values) > 1 else "")


def _source(scene: SceneResults) -> str:
    records = [record for record, _ in scene.functions]
    measured = [{"commit": r.provenance.commit, "machine": r.provenance.machine} for r in records]
    command = f"python -m research.benchmarks.training.functions scenes/{scene.name}.toml"
    return f"`{command}`: {made_from(measured, [r.key['seed'] for r in records])}"
