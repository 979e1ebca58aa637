"""The scores of one seed, each in a record of its own."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from surrogate.evaluation.cases import PARAMETERS, SETTINGS, VIEWS
from surrogate.evaluation.evaluate import VERSION as EVALUATION
from surrogate.evaluation.scoring import METRICS
from surrogate.storage.records import Provenance, Record

KIND, VERSION = "seed", 2
FOLDER = "seeds"  # of a scene's records, and of the models of its other seeds
KEY = ("seed", "fingerprint", "base", "settings", "evaluation")


@dataclass(frozen=True)
class Scores:
    """How well the model of one seed does on the test images of a report.

    Attributes
    ----------
    fingerprint : of the training run.
    base : fingerprint of the run with the scene's own seed; two that agree in it differ in nothing but the seed.
    settings : the scene's settings of training, as JSON values.
    cells : means by metric of `surrogate.evaluation.scoring.METRICS`, and "images", by row of views and column of parameters, as in
        `report.json`; None where the data set has no such images.
    variations : the same for each variation that the model follows, with its "kind" and "base", by row of settings.
    gaussians, megabytes : size of the model, 10^6 bytes.
    seconds, processor_seconds : that training took, and those of all cores; None where that is not known.
    evaluation : version of the evaluation that scored it.
    """

    seed: int
    fingerprint: str
    base: str
    settings: Mapping[str, Any]
    cells: Mapping[str, Any]
    variations: Sequence[Mapping[str, Any]]
    gaussians: int
    megabytes: float
    seconds: float
    provenance: Provenance
    evaluation: int = EVALUATION
    processor_seconds: float | None = None


def scores_path(records: Path, seed: int) -> Path:
    """Where the scores of a seed are kept in the folder of a scene's records."""
    return records / FOLDER / f"{seed}.json"


def save(records: Path, scores: Scores) -> None:
    """Keep the scores of a seed, at once and whole; raises ValueError for numbers that are not finite."""
    Record.of(KIND, VERSION, scores, KEY).save(scores_path(records, scores.seed))


def load(records: Path, seed: int) -> Scores | None:
    """What is kept of a seed; None for nothing, for what is damaged, and for what another version wrote or judged."""
    return next(iter(load_scores(records, seed=seed)), None)


def load_scores(records: Path, **key: Any) -> list[Scores]:
    """All scores in the folder of a scene's records that agree with `key`, by seed."""
    kept = Record.load_all(records / FOLDER, KIND, VERSION, {"evaluation": EVALUATION, **key})
    found = [record.to(Scores, _check) for name, record in kept.items() if name == str(record.key.get("seed"))]
    return sorted((scores for scores in found if scores is not None), key=lambda scores: scores.seed)


def _check(scores: Scores) -> None:
    """Raise ValueError, KeyError or TypeError where something is not there, or not a number, that tables are made of."""
    machine = scores.provenance.machine
    named, counted = [machine["processor"]], [scores.seed, machine["cores"], *_counts(scores.cells, VIEWS)]
    for varied in scores.variations:
        named += [varied["kind"], varied["base"]]
        counted += _counts(varied, SETTINGS)
    if not all(type(text) is str for text in named) or not all(type(count) is int for count in counted):
        raise ValueError("words and counts must be such")
    if not all(
        map(math.isfinite, (scores.gaussians, scores.megabytes, scores.seconds, scores.processor_seconds or 0.0))
    ):
        raise ValueError("sizes must be finite")


def _counts(cells: Mapping[str, Any], rows: Iterable[str]) -> list[Any]:
    """The numbers of images by row and column; raises where a mean is absent, or neither finite nor null."""
    at = [(row, column) for row in rows for column in PARAMETERS]
    means = [cells[metric][row][column] for metric in METRICS for row, column in at]
    if not all(math.isfinite(mean) for mean in means if mean is not None):
        raise ValueError("means must be finite")
    return [cells["images"][row][column] for row, column in at]
