"""A study from start to end, with its page kept up to date."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

from catalogs import durable
from surrogate.studies.ablation import table
from surrogate.studies.ablation.comparison import Row, compared
from surrogate.studies.ablation.experiments import Experiment
from surrogate.studies.ablation.records import Result
from surrogate.studies.ablation.study import Study
from surrogate.studies.progress import StudyProgress

LOCK = ".page.lock"


def ablate(
    scene: str,
    experiment: Experiment,
    folder: Path,
    *,
    progress: Callable[[StudyProgress], None] = lambda _: None,
    tell: Callable[[Result], None] = lambda _: None,
    **options: Any,
) -> list[Row]:
    """Fit what is missing, writing ablation.md and ablation.png into `folder` after every fit; returns the rows of the table.

    `options` and errors are those of `Study`.
    """
    study = Study(experiment, folder, **options)
    durable.make_folder(folder)
    durable.remove_abandoned(folder)

    def write_page() -> list[Row]:
        with durable.locked(folder / LOCK):  # or the last process to write might not know the last result
            rows = compared(study.records.all(), experiment.variants)
            table.write(scene, folder, study.records.budget, rows)
        return rows

    def keep(result: Result) -> None:
        write_page()
        tell(result)

    study.run(progress=progress, tell=keep)
    return write_page()
