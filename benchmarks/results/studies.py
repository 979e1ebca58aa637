"""The ablations of a scene as they lie in runs/, as far as they are of its present settings and data."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from catalogs.catalog import Catalog
from surrogate.model import Surrogate
from surrogate.settings import TrainingSettings
from surrogate.studies.ablation.comparison import Row, compared
from surrogate.studies.ablation.fits import BASE_FOLDER, VISUALIZATION_FOLDER, BaseFits, Fits, VisualizationFits
from surrogate.studies.ablation.records import Records, Result


@dataclass(frozen=True)
class StudyKind:
    """What is varied: the folder in runs/<scene>, a title, and what `surrogate ablate` is told besides the scene."""

    folder: str
    title: str
    option: str = ""

    def command(self, scene: str) -> str:
        """The command that makes such a study of a scene."""
        return " ".join(filter(None, ["surrogate ablate", f"scenes/{scene}.toml", self.option]))


BASE = StudyKind(BASE_FOLDER, "the base appearance")
VISUALIZATION = StudyKind(VISUALIZATION_FOLDER, "F_vis alone", "--visualization")


@dataclass(frozen=True, eq=False)
class StudyResults:
    """One study of one scene.

    Attributes
    ----------
    folder : that keeps its results and its plot.
    budget : seconds that each fit was given.
    rows : of its table, the best first; at least one.
    """

    kind: StudyKind
    folder: Path
    budget: float
    rows: Sequence[Row]

    @property
    def results(self) -> list[Result]:
        """All fits that have a result."""
        return [result for row in self.rows for result in row.results]


def kinds_of(variations: int) -> list[StudyKind]:
    """The studies that a scene with so many variations can have."""
    return [BASE, VISUALIZATION] if variations else [BASE]


def read_study(kind: StudyKind, run: Path, settings: TrainingSettings, catalog: Catalog) -> StudyResults | None:
    """The study of that kind with the most results; None without any of these settings and this catalog."""
    folder = run / kind.folder
    if not any(folder.glob("*.json")):
        return None
    try:
        fits: Fits = (
            BaseFits(settings, catalog)
            if kind == BASE
            else VisualizationFits(settings, catalog, Surrogate.load(run / "surrogate"))
        )
    except (ValueError, FileNotFoundError):  # such a study can't be of this scene
        return None
    budget = _usual_budget(folder, fits.mark)
    rows = [] if budget is None else compared(Records(folder, fits.mark, fits.base, budget, fits.variants))
    return StudyResults(kind, folder, budget, rows) if budget is not None and any(row.results for row in rows) else None


def _usual_budget(folder: Path, mark: str) -> float | None:
    """The budget of most results that have the mark, the largest of several; None without any."""
    counts: Counter[float] = Counter()
    for path in folder.glob("*.json"):
        try:
            record = json.loads(path.read_text(encoding="utf-8"))
            if record["mark"] == mark:
                counts[float(record["budget"])] += 1
        except (OSError, ValueError, KeyError, TypeError):
            continue
    return max(counts, key=lambda budget: (counts[budget], budget), default=None)
