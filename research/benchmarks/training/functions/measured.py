"""Accuracy of a surrogate under untrained transfer functions, compared with showing the trained one instead."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from catalogs.store.catalog import Catalog
from catalogs.vocabulary.appearance import TransferFunction
from research.benchmarks.training.functions.departures import PEAK, TRAINED, appearance_name
from surrogate.evaluation.cases import Case
from surrogate.evaluation.novelty import SeenValues
from surrogate.evaluation.predictor import SurrogatePredictor
from surrogate.evaluation.scoring import Scored, mean, score_cases
from surrogate.evaluation.tables import number, table
from surrogate.model import Surrogate
from surrogate.splatting.threads import one_torch_thread
from surrogate.storage.records import Provenance, Record

KIND, VERSION, FOLDER = "functions", 1, "functions"  # of a scene's records


@dataclass(frozen=True)
class FunctionScores:
    """Scores of one function over all images of a catalog: dB but for `ssim`, `novelty` and `images`.

    Attributes
    ----------
    psnr, worst : mean and worst PSNR over all images.
    psnr_foreground : None where no image has a foreground.
    instead : PSNR of the image under the trained function.
    novelty : the share of the visible amount that training did not show; None if unknown.
    """

    function: str
    psnr: float
    worst: float
    psnr_foreground: float | None
    ssim: float
    instead: float
    novelty: float | None
    images: int


@one_torch_thread()
def shown(
    surrogate: Surrogate,
    truth: Catalog,
    members: Sequence[str],
    functions: Mapping[str, TransferFunction],
    seen: SeenValues | None,
) -> list[FunctionScores]:
    """Scores of each function on all images of `truth` of these members; raises ValueError where the surrogate can't
    show any function."""
    chosen, views, scores = [truth.member(name) for name in members], range(len(truth.plan.cameras)), []
    for name, function in functions.items():
        cases = [Case(member, view, appearance_name(name)) for member in chosen for view in views]
        # The trained function, included for comparison, is the surrogate's default.
        under = surrogate.at if name == TRAINED else partial(surrogate.under, function)
        scored, instead = (
            list(score_cases(SurrogatePredictor(at, None), truth, cases)[0].values()) for at in (under, surrogate.at)
        )
        scores.append(_shown(name, scored, instead, None if seen is None else seen.novelty(function)))
    return scores


def _shown(name: str, scored: Sequence[Scored], instead: Sequence[Scored], novelty: float | None) -> FunctionScores:
    return FunctionScores(
        name,
        psnr=float(np.mean([s.score.psnr for s in scored])),
        worst=min(s.score.psnr for s in scored),
        psnr_foreground=mean(scored, "psnr_foreground"),
        ssim=float(np.mean([s.score.ssim for s in scored])),
        instead=float(np.mean([s.score.psnr for s in instead])),
        novelty=novelty,
        images=len(scored),
    )


def unseen(rows: Sequence[FunctionScores]) -> list[FunctionScores]:
    """The rows of untrained functions, without the peak."""
    return [row for row in rows if row.function not in (TRAINED, PEAK)]


def mean_and_worst(rows: Sequence[FunctionScores]) -> tuple[float, float]:
    """Mean and worst of the untrained functions' means, dB."""
    means = [row.psnr for row in unseen(rows)]
    return float(np.mean(means)), min(means)


def save(
    records: Path, surrogate: Surrogate, rows: Sequence[FunctionScores], about: Mapping[str, Any], seconds: float
) -> Path:
    """Store the rows of one seed in the folder of a scene's records; returns the path."""
    settings = dict(surrogate.training["settings"])
    key = {"seed": settings["seed"], "fingerprint": surrogate.training["fingerprint"], "settings": settings}
    values = {**about, "functions": [vars(row) for row in rows]}
    path = records / FOLDER / f"{settings['seed']}.json"
    Record(KIND, VERSION, key, values, Provenance.now(seconds)).save(path)
    return path


def load(records: Path, settings: Mapping[str, Any]) -> list[tuple[Record, list[FunctionScores]]]:
    """The stored records and rows of all seeds with these settings, by seed."""
    stored = Record.load_all(records / FOLDER, KIND, VERSION).values()
    same = [record for record in stored if _but_seed(record.key["settings"]) == _but_seed(settings)]
    return [
        (r, [FunctionScores(**row) for row in r.values["functions"]]) for r in sorted(same, key=lambda r: r.key["seed"])
    ]


def _but_seed(settings: Mapping[str, Any]) -> dict[str, Any]:
    return {name: value for name, value in settings.items() if name != "seed"}


def rows_table(seeds: Sequence[Sequence[FunctionScores]]) -> str:
    """A row for each function, means ± standard deviations over seeds, and one for the mean of untrained ones."""

    def spread(values: Sequence[float | None]) -> str:
        numbers = [value for value in values if value is not None]
        deviation = f" ± {np.std(numbers, ddof=1):.2f}" if len(numbers) > 1 else ""
        return number(float(np.mean(numbers)) if numbers else None) + deviation

    def of(rows: Sequence[FunctionScores]) -> list[str]:
        first = rows[0]
        return [
            first.function,
            spread([row.psnr for row in rows]),
            spread([row.worst for row in rows]),
            spread([row.psnr_foreground for row in rows]),
            number(float(np.mean([row.ssim for row in rows])), 4),
            spread([row.instead for row in rows]),
            number(None) if first.novelty is None else f"{100.0 * first.novelty:.0f} %",
            str(first.images),
        ]

    means = [mean_and_worst(rows) for rows in seeds]
    total = ["**mean of the functions never seen**", f"**{spread([m for m, _ in means])}**", *[""] * 6]
    worst = ["**the worst of them**", f"**{spread([w for _, w in means])}**", *[""] * 6]
    header = [
        "function",
        "PSNR (dB)",
        "worst image",
        "foreground",
        "SSIM",
        "the trained function instead",
        "new",
        "images",
    ]
    return table(header, [*(of(rows) for rows in zip(*seeds, strict=True)), total, worst])
