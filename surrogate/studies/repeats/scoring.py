"""A model's scores on the images that its report is about, without anything beside them."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from catalogs.catalog import Catalog
from surrogate.evaluation.evaluate import images_of_cells
from surrogate.evaluation.scoring import METRICS, Case, Report, Scorer
from surrogate.evaluation.tables import Cells, cell_means
from surrogate.evaluation.varied import images_of_varied_cells
from surrogate.model import Surrogate
from surrogate.splatting.threads import one_torch_thread

STAGE = "scoring"


@one_torch_thread()
def score_model(surrogate: Surrogate, catalog: Catalog, *, progress: Report = lambda *_: None) -> dict[str, Any]:
    """`cells` and `variations` as `Scores` has them.

    Raises ValueError where its pictures are no numbers: training diverged.
    """
    main = images_of_cells(catalog, str(surrogate.training["appearance"]))
    varied = [images_of_varied_cells(catalog.members, v.variation) for v in surrogate.visualizations]
    total = sum(len(cases) for images in (main, *varied) for row in images.values() for cases in row.values())
    scorer = Scorer(surrogate, catalog, lambda done: progress(STAGE, done, total))
    return {
        "cells": _scored(scorer, main),
        "variations": [
            {"kind": v.variation.kind, "base": v.variation.base, **_scored(scorer, images)}
            for v, images in zip(surrogate.visualizations, varied, strict=True)
        ],
    }


def _scored(scorer: Scorer, images: Mapping[str, Mapping[str, list[Case]]]) -> dict[str, Any]:
    cells: Cells = {row: {column: scorer.score(cases) for column, cases in of.items()} for row, of in images.items()}
    if not all(math.isfinite(s.score.psnr) for of in cells.values() for scored in of.values() for s in scored):
        raise ValueError("training diverged: the model shows pictures that are no numbers")
    counts = {row: {column: len(scored) for column, scored in of.items()} for row, of in cells.items()}
    return {**{metric: cell_means(cells, metric) for metric in METRICS}, "images": counts}
