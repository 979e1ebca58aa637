"""The scores of each member, and how much of what distinguishes it is predicted: structures, colours and fine detail."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from catalogs.store.catalog import Catalog
from surrogate.evaluation.cases import PARAMETERS, VIEWS, Case
from surrogate.evaluation.evaluate import MEAN_IMAGE, Baseline, Evaluation
from surrogate.evaluation.metrics import TrueImage
from surrogate.evaluation.scoring import METRICS, Scored, mean, spread
from surrogate.model import Surrogate

ASPECTS = ("structures", "colours", "details")
BLOCKS = 32  # to a side: structures and colours are those of averages over such blocks, details what these leave
JUDGED_MEMBERS, JUDGED_VIEWS = 40, 6
UNSEEN_ERROR = 0.5 / 255.0  # of a channel: below, rounding to 8 bits is most of it


def row_of(cells: Mapping[str, Mapping[str, Any]], column: str) -> str:
    """The row of `VIEWS` that judges a column: unseen views where there are any."""
    return next((row for row in reversed(VIEWS) if cells[row][column]), "seen_views")


def members_record(surrogate: Surrogate, catalog: Catalog, evaluation: Evaluation) -> list[dict[str, Any]]:
    """Means over each scored member's pictures; test members also have the shares of `ASPECTS` that are predicted."""
    cells = evaluation.cells
    groups = {column: cells[row_of(cells, column)][column] for column in PARAMETERS}
    by_member: dict[str, list[Scored]] = {}
    for scored in (*groups["unseen_parameters"], *evaluation.validation, *groups["seen_parameters"]):
        by_member.setdefault(scored.target.member.name, []).append(scored)
    tested = list(dict.fromkeys(s.target.member.name for s in groups["unseen_parameters"]))
    judged = {tested[i] for i in spread(len(tested), JUDGED_MEMBERS)}
    cases = [
        scored[i].target
        for name, scored in by_member.items()
        if name in judged
        for i in spread(len(scored), JUDGED_VIEWS)
    ]
    mean_image = next((b for b in evaluation.baselines if b.name == MEAN_IMAGE), None)
    predicted = {} if mean_image is None else aspects(surrogate, catalog, mean_image, cases)
    return [
        {
            "name": name,
            "split": scored[0].target.member.split,
            "parameters": dict(scored[0].target.member.parameters),
            "images": len(scored),
            **{metric: mean(scored, metric) for metric in METRICS},
            "predicted": predicted.get(name),
        }
        for name, scored in by_member.items()
    ]


def aspects(
    surrogate: Surrogate, catalog: Catalog, mean_image: Baseline, cases: Sequence[Case]
) -> dict[str, dict[str, float | None]]:
    """Shares of `ASPECTS` predicted in pictures of members, by member; see `shares`."""
    sums: dict[str, NDArray[np.float64]] = {}
    for case, other in mean_image.pictures(cases):
        picture = surrogate.at(case.parameters, outside="allow").render(case.camera, background=catalog.plan.background)
        truth = true_image(catalog, case)
        off = [squares(truth.composite(image) - truth.displayed) for image in (picture, other)]
        sums[case.member.name] = sums.get(case.member.name, 0.0) + np.array(
            [*off, [truth.covered.sum()] * len(ASPECTS)]
        )
    return {name: dict(zip(ASPECTS, shares(of[0], of[1], int(of[2, 0])), strict=True)) for name, of in sums.items()}


def shares(ours: NDArray[np.float64], rival: NDArray[np.float64], area: int) -> list[float | None]:
    """1 minus the squared error over that of the mean image, of each of `ASPECTS`: 1 is perfect, 0 no better than the mean
    image (Murphy 1988).  1 where the error over `area` pixels is that of rounding; None where nothing is shown.
    """
    if not area:
        return [None] * len(ASPECTS)
    return [
        1.0 if np.sqrt(own / (3 * area)) < UNSEEN_ERROR else float(1.0 - own / max(other, np.finfo(float).tiny))
        for own, other in zip(ours.tolist(), rival.tolist(), strict=True)
    ]


def squares(difference: NDArray[np.float32]) -> NDArray[np.float64]:
    """Squares (3,) of a difference of pictures (H, W, 3), by `ASPECTS`, which add up to all of it."""
    height, width, _ = difference.shape
    side = max(1, min(height, width) // BLOCKS)
    rows, columns = height // side, width // side
    whole = difference[: rows * side, : columns * side].astype(np.float64).reshape(rows, side, columns, side, 3)
    coarse = whole.mean((1, 3))  # [R, C, 3]
    grey = coarse.mean(-1, keepdims=True)
    area = side * side
    parts = 3 * area * (grey**2).sum(), area * ((coarse - grey) ** 2).sum()
    return np.array([*parts, (whole**2).sum() - area * (coarse**2).sum()])


def true_image(catalog: Catalog, case: Case) -> TrueImage:
    """The stored picture of a case."""
    return TrueImage(catalog.image(case.member, case.appearance, case.view), catalog.plan.background)
