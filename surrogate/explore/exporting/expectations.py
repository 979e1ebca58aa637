"""All that a page without a program must hold to say what error to expect of its pictures."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from catalogs.vocabulary.words import one_line
from surrogate.answers.doubt import Doubt
from surrogate.answers.survey import Survey
from surrogate.evaluation.scoring import Report
from surrogate.explore.run import Run

NO_CATALOG = "without its catalog nobody can say how far off a picture is"


@dataclass(frozen=True, eq=False)
class Expectations:
    """The doubt of a run and its survey; without these a sentence that says why there are none."""

    doubt: Doubt | None = None
    survey: Survey | None = None
    why: str = ""

    __repr__ = one_line

    @classmethod
    def of(cls, run: Run, doubt: Doubt | None, progress: Report) -> Expectations:
        """Those of a run, measured where nobody did so before; that takes a minute or two."""
        if run.catalog is None:
            return cls(why=NO_CATALOG)
        try:
            doubt = doubt or Doubt.of(run.surrogate, run.catalog, run.folder, progress)
        except ValueError as error:  # too few members
            return cls(why=str(error))
        return cls(doubt, Survey.of(doubt, run.catalog, run.cameras, run.folder, progress))

    def to_json(self) -> dict[str, Any]:
        """JSON values: the survey, the stored views and what training showed, each null where it is not known; a `sentence` why."""
        if self.doubt is None or self.survey is None:
            return {"survey": None, "views": None, "seen": None, "sentence": self.why}
        views, values = self.doubt.views, self.doubt.seen_values
        names = ("edges", "frequency", "extinctions")
        return {
            "sentence": "",
            "survey": self.survey.to_json(),
            "views": None if views is None else views.to_json(),
            "seen": None if values is None else {name: getattr(values, name).tolist() for name in names},
        }
