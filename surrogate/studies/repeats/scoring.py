"""A model's scores on the images that its report is about, without anything beside them."""

from __future__ import annotations

import math
from functools import partial
from typing import Any

from catalogs.catalog import Catalog
from surrogate.evaluation.cases import all_cases, base_cells, variation_cells
from surrogate.evaluation.predictor import SurrogatePredictor
from surrogate.evaluation.scoring import METRICS, Report, by_cell, score_cases
from surrogate.evaluation.tables import cell_tables
from surrogate.model import Surrogate
from surrogate.splatting.threads import one_torch_thread

STAGE = "scoring"


@one_torch_thread()
def score_model(surrogate: Surrogate, catalog: Catalog, *, progress: Report = lambda *_: None) -> dict[str, Any]:
    """`cells` and `variations` as `Scores` has them.

    Raises ValueError where its pictures are no numbers: training diverged.
    """
    main = base_cells(catalog, str(surrogate.training["appearance"]))
    varied = [variation_cells(catalog, v.variation) for v in surrogate.visualizations]
    predictor = SurrogatePredictor(surrogate.at, catalog.plan.background)
    cases = [case for cells in (main, *varied) for case in all_cases(cells)]
    [found] = score_cases(predictor, catalog, cases, progress=partial(progress, STAGE))
    if not all(math.isfinite(scored.score.psnr) for scored in found.values()):
        raise ValueError("training diverged: the model shows pictures that are no numbers")
    return {
        "cells": cell_tables(by_cell(main, found), METRICS),
        "variations": [
            {"kind": v.variation.kind, "base": v.variation.base, **cell_tables(by_cell(cells, found), METRICS)}
            for v, cells in zip(surrogate.visualizations, varied, strict=True)
        ],
    }
