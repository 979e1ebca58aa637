"""Figures of a scene on other processors: the instruction sets of older processors beside the best available."""

from __future__ import annotations

from collections.abc import Sequence

from research.benchmarks.results.scenes import SceneResults
from research.benchmarks.results.sources import made_from
from research.studies.repeats.seeds import Scores, spread
from surrogate.evaluation.tables import plain_spread, table

HEADER = ("scene", "instructions", "unseen views and parameters, PSNR (dB)", "of all cores together (s)", "seeds")
TEXT = (
    "The settings are the same, but kernels and torch use no later instructions than those of an older processor.  This shows what "
    "to expect on another machine, as far as its instructions make a difference.  Rounding differs between sets as it does "
    "between seeds, so the last row of a scene is over seeds and sets together."
)


def processors_section(scenes: Sequence[SceneResults]) -> list[str]:
    """The section in Markdown; nothing where no scene was measured."""
    measured = [scene for scene in scenes if scene.instruction_sets]
    if not measured:
        return []
    rows = [row for scene in measured for row in _rows(scene)]
    sources = "; ".join(map(_source, measured))
    return ["## On other processors", TEXT, table(HEADER, rows), f"<sub>{sources}.</sub>"]


def _rows(scene: SceneResults) -> list[list[str]]:
    sets = {"all of the machine": scene.seeds} if scene.seeds else {}
    sets |= {f"no later than {name}": scores for name, scores in scene.instruction_sets.items()}
    rows = [_row(scene.name, name, scores) for name, scores in sets.items()]
    together = [one for scores in sets.values() for one in scores]
    return [*rows, _row(scene.name, "**together**", together, seconds=False)]


def _row(scene: str, name: str, scores: Sequence[Scores], *, seconds: bool = True) -> list[str]:
    psnr = spread([one.cells["psnr"]["unseen_views"]["unseen_parameters"] for one in scores])
    taken = spread([one.processor_seconds for one in scores]) if seconds else None
    cells = [plain_spread(psnr, 2) if psnr else "–", plain_spread(taken, 0) if taken else "–"]
    return [f"`{scene}`", name, *cells, str(len(scores))]


def _source(scene: SceneResults) -> str:
    scores = [one for of_set in scene.instruction_sets.values() for one in of_set]
    made = [{"commit": one.provenance.commit, "machine": one.provenance.machine} for one in scores]
    command = f"python -m research.benchmarks.splatting.instruction_sets scenes/{scene.name}.toml"
    return f"`{command}`: {made_from(made, sorted({one.seed for one in scores}))}"
