"""The ablations of a scene with its present settings."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from research.studies.ablation.comparison import VariantRow, compared
from research.studies.ablation.experiments import BASE_FOLDER, VISUALIZATION_FOLDER
from research.studies.ablation.records import DECIDING, AblationResult, load_results
from research.studies.ablation.variants import VARIANTS, VISUALIZATION_VARIANTS, Variant
from surrogate.provenance import code


@dataclass(frozen=True)
class StudyKind:
    """The subject of a study: the folder of a scene's records, a title, and further options of `ablate`."""

    folder: str
    title: str
    variants: tuple[Variant, ...]
    option: str = ""

    def command(self, scene: str) -> str:
        """The command that makes such a study of a scene."""
        return f"python -m research.studies ablate scenes/{scene}.toml{self.option}"


BASE = StudyKind(BASE_FOLDER, "the base appearance", VARIANTS)
VISUALIZATION = StudyKind(VISUALIZATION_FOLDER, "F_vis alone", VISUALIZATION_VARIANTS, " --visualization")
KINDS = (BASE, VISUALIZATION)


@dataclass(frozen=True, eq=False)
class StudyResults:
    """One study of one scene.

    Attributes
    ----------
    budget : seconds for each fit.
    rows : of its table, the best first.
    published : the "lines" of an earlier page about it, and its "sources", where no records are left.
    """

    kind: StudyKind
    budget: float = 0.0
    rows: Sequence[VariantRow] = ()
    published: Mapping[str, Any] = field(default_factory=dict)

    @property
    def results(self) -> list[AblationResult]:
        """All successful fits."""
        return [result for row in self.rows for result in row.results]

    @property
    def earlier(self) -> bool:
        """True if other code than the present made any of it."""
        return bool(self.published) or {result.provenance.code for result in self.results} != {code(DECIDING)}


def kinds_of(variations: int) -> list[StudyKind]:
    """The studies of a scene with this number of variations."""
    return [BASE, VISUALIZATION] if variations else [BASE]


def read_studies(records: Path, settings: Mapping[str, Any]) -> list[StudyResults]:
    """The studies in the folder of a scene's records with any result of these settings."""
    studies = [_read_study(kind, records, settings) for kind in KINDS]
    return [study for study in studies if study.results]


def _read_study(kind: StudyKind, records: Path, settings: Mapping[str, Any]) -> StudyResults:
    """The study with the most results, of several with other data or budgets."""
    results = load_results(records / kind.folder, scene=settings)
    counts = Counter((result.mark, result.budget) for result in results)
    mark, budget = max(counts, key=lambda one: (counts[one], one[1]), default=("", 0.0))
    same = [result for result in results if (result.mark, result.budget) == (mark, budget)]
    return StudyResults(kind, budget, compared(same, kind.variants))


def published_study(folder: str, published: Mapping[str, Any]) -> StudyResults:
    """A study as an earlier page describes it."""
    kind = next(kind for kind in KINDS if kind.folder == folder)
    return StudyResults(kind, published=published)
