"""A study from start to end, with its page kept up to date."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

from surrogate.ablation import table
from surrogate.ablation.comparison import Row, compared
from surrogate.ablation.fits import Fits
from surrogate.ablation.records import Result
from surrogate.ablation.study import Standing, Study


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

    def keep(result: Result) -> None:
        table.write(scene, study.records)
        tell(result)

    study.run(progress=progress, tell=keep)
    table.write(scene, study.records)
    return compared(study.records)
