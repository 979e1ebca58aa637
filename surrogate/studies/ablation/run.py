"""A study from start to end, with its page kept up to date."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

from catalogs import durable
from surrogate.studies.ablation import table
from surrogate.studies.ablation.comparison import Row, compared
from surrogate.studies.ablation.fits import Fits
from surrogate.studies.ablation.records import Records, Result
from surrogate.studies.ablation.study import Standing, Study

LOCK = ".page.lock"


def ablate(
    scene: str,
    fits: Fits,
    folder: Path,
    *,
    progress: Callable[[Standing], None] = lambda _: None,
    tell: Callable[[Result], None] = lambda _: None,
    **options: Any,
) -> list[Row]:
    """Fit what is missing in `folder`, writing ablation.md and ablation.png after every fit; returns the rows of the table.

    `options` and errors are those of `Study`.
    """
    study = Study(fits, folder, **options)
    durable.make_folder(folder)
    durable.remove_abandoned(folder)

    def keep(result: Result) -> None:
        _write_page(scene, study.records)
        tell(result)

    study.run(progress=progress, tell=keep)
    _write_page(scene, study.records)
    return compared(study.records)


def _write_page(scene: str, records: Records) -> None:
    """One process after the other, or the last to write might not know the last result."""
    with durable.locked(records.folder / LOCK):
        table.write(scene, records)
