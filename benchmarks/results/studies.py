"""The ablations of a scene as they lie in runs/, as far as they are of its present settings and data."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from catalogs.catalog import Catalog
from surrogate.model import Surrogate
from surrogate.settings import TrainingSettings
from surrogate.studies.ablation.comparison import Row, compared
from surrogate.studies.ablation.fits import BASE_FOLDER, VISUALIZATION_FOLDER, BaseFits, Fits, VisualizationFits
from surrogate.studies.ablation.records import Records, Result, load_results


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
    results = load_results(folder, mark=fits.mark)
    counts = Counter(result.budget for result in results)
    budget = max(
        counts, key=lambda budget: (counts[budget], budget), default=0.0
    )  # of most results, the largest of several
    rows = compared(Records(folder, fits, budget).all(), fits.variants)
    return StudyResults(kind, folder, budget, rows) if any(row.results for row in rows) else None
