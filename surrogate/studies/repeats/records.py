"""The scores of one seed, and the folder that keeps them: a small file each, there whole or not at all."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from catalogs import durable
from surrogate.evaluation.evaluate import VERSION as EVALUATION
from surrogate.evaluation.scoring import METRICS, PARAMETERS, VIEWS
from surrogate.evaluation.varied import SETTINGS

VERSION = 1
SEEDS, FILE = "seeds", "scores.json"
SEED = re.compile("0|[1-9][0-9]*")  # a folder of the same number, such as 04, is none of ours


@dataclass(frozen=True)
class Scores:
    """How well the model of one seed does on the test images of a report.

    Attributes
    ----------
    fingerprint : of the training run.
    base : fingerprint of the run with the scene's own seed; two that agree in it differ in nothing but the seed.
    cells : means by metric of `surrogate.evaluation.scoring.METRICS`, and "images", by row of views and column of parameters, as in
        `report.json`; None where the data set has no such images.
    variations : the same for each variation that the model follows, with its "kind" and "base", by row of settings.
    gaussians, megabytes : size of the model, 10^6 bytes.
    seconds : that training took.
    machine, commit, made : where these were computed, by what, and when (ISO 8601).
    """

    seed: int
    fingerprint: str
    base: str
    cells: Mapping[str, Any]
    variations: Sequence[Mapping[str, Any]]
    gaussians: int
    megabytes: float
    seconds: float
    machine: Mapping[str, str | int]
    commit: str
    made: str


def scores_path(run: Path, seed: int) -> Path:
    """Where the scores of a seed are kept in a scene's folder of results."""
    return run / SEEDS / str(seed) / FILE


def save(run: Path, scores: Scores) -> None:
    """Keep the scores of a seed, at once and whole; raises ValueError for numbers that are not finite."""
    record = {"version": VERSION, "evaluation": EVALUATION, **asdict(scores)}
    path = scores_path(run, scores.seed)
    content = json.dumps(record, indent=1, allow_nan=False).encode()
    durable.make_folder(path.parent)
    durable.remove_abandoned(path.parent)
    durable.replace(path, content)


def load(run: Path, seed: int) -> Scores | None:
    """What is kept of a seed; None for nothing, for what is damaged, and for what another version wrote or judged."""
    try:
        record = json.loads(scores_path(run, seed).read_text(encoding="utf-8"))
        if (record.pop("version"), record.pop("evaluation")) != (VERSION, EVALUATION):
            return None
        scores = Scores(**record)
        _check(scores)
    except (OSError, ValueError, KeyError, TypeError, AttributeError, RecursionError):
        return None
    return scores if scores.seed == seed else None


def scores_beside(run: Path, base: str) -> list[Scores]:
    """All scores in a scene's folder of results that differ from the run of fingerprint `base` in the seed alone, by seed."""
    seeds = sorted(int(path.name) for path in (run / SEEDS).glob("*") if SEED.fullmatch(path.name))
    found = [load(run, seed) for seed in seeds]
    return [scores for scores in found if scores is not None and scores.base == base]


def _check(scores: Scores) -> None:
    """Raise ValueError, KeyError or TypeError where something is not there, or not a number, that tables are made of."""
    sizes, named = (scores.gaussians, scores.megabytes, scores.seconds), [scores.commit, scores.machine["processor"]]
    counted = [scores.seed, scores.machine["cores"], *_check_cells(scores.cells, VIEWS)]
    for varied in scores.variations:
        named += [varied["kind"], varied["base"]]
        counted += _check_cells(varied, SETTINGS)
    if not all(type(text) is str for text in named) or not all(type(count) is int for count in counted):
        raise ValueError("words and counts must be such")
    if not all(map(math.isfinite, sizes)):
        raise ValueError("sizes must be finite")


def _check_cells(cells: Mapping[str, Any], rows: Iterable[str]) -> list[Any]:
    """The numbers of images by row and column; raises where a mean is absent, or neither finite nor null."""
    at = [(row, column) for row in rows for column in PARAMETERS]
    means = [cells[metric][row][column] for metric in METRICS for row, column in at]
    if not all(math.isfinite(mean) for mean in means if mean is not None):
        raise ValueError("means must be finite")
    return [cells["images"][row][column] for row, column in at]
