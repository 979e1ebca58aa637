"""Scores of several seeds, each in a record of its own: means, standard deviations, and their tables."""

from __future__ import annotations

import math
import statistics
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from catalogs.vocabulary.variations import KINDS
from surrogate.evaluation.cases import PARAMETERS, SETTINGS, VIEWS
from surrogate.evaluation.evaluate import VERSION as EVALUATION
from surrogate.evaluation.scoring import METRICS
from surrogate.evaluation.tables import cell_table, plain_spread, spread_number
from surrogate.provenance import in_words
from surrogate.storage.records import Provenance, Record

KIND, VERSION = "seed", 2
FOLDER = "seeds"  # of a scene's records, and of the models of its other seeds
KEY = ("seed", "fingerprint", "base", "settings", "evaluation")
SIZES = ("gaussians", "megabytes", "seconds", "processor_seconds")


@dataclass(frozen=True)
class Scores:
    """Scores of the model of one seed on the test images of a report.

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
    """The file of a seed's scores in the folder of a scene's records."""
    return records / FOLDER / f"{seed}.json"


def save(records: Path, scores: Scores) -> None:
    """Keep the scores of a seed, at once and whole; raises ValueError for numbers that are not finite."""
    Record.of(KIND, VERSION, scores, KEY).save(scores_path(records, scores.seed))


def load(records: Path, seed: int) -> Scores | None:
    """The scores of a seed; None if there are none, if they are damaged, or if another version wrote or judged them."""
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


def spread(values: Sequence[Any]) -> dict[str, Any] | None:
    """Mean and sample standard deviation (n - 1 in the denominator) of the numbers that are not None; None without any.

    The deviation of a single number is None.  Of mappings, nested or not, it is the spread under every name.
    """
    if isinstance(values[0], Mapping):
        return {name: spread([value[name] for value in values]) for name in values[0]}
    known = [value for value in values if value is not None]
    deviation = statistics.stdev(known) if len(known) > 1 else None
    return {"mean": statistics.fmean(known), "deviation": deviation} if known else None


def summarize_repeats(scores: Sequence[Scores]) -> dict[str, Any] | None:
    """The entry of `report.json` about seeds; None for fewer than two.

    Where a report has a number, this has its "mean" and "deviation"; None where the data set has no such images.
    """
    if len(scores) < 2:
        return None
    return {
        "seeds": [one.seed for one in scores],
        "machines": _distinct([dict(one.provenance.machine) for one in scores]),
        "commits": _distinct([one.provenance.commit for one in scores]),
        **{name: spread([getattr(one, name) for one in scores]) for name in SIZES},
        **_cells([one.cells for one in scores]),
        "variations": [
            {"kind": same[0]["kind"], "base": same[0]["base"], **_cells(same)}
            for same in zip(*(one.variations for one in scores), strict=True)
        ],
    }


def _cells(found: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """The spread of every metric in every cell, and the number of images, which is the same for all seeds."""
    return {metric: spread([one[metric] for one in found]) for metric in METRICS} | {"images": found[0]["images"]}


def _distinct(values: Sequence[Any]) -> list[Any]:
    return [value for i, value in enumerate(values) if value not in values[:i]]


def seeds_section(record: Mapping[str, Any] | None) -> list[str]:
    """Blocks of Markdown from a `summarize_repeats` record of a scene or a run; none without one."""
    if record is None:
        return []
    gaussians, megabytes, seconds = (record[name] for name in ("gaussians", "megabytes", "seconds"))
    blocks = [
        f"## Mean ± standard deviation over {len(record['seeds'])} seeds",
        f"The same training with the seeds {', '.join(map(str, record['seeds']))}, on the same test images; sample standard "
        f"deviations (n - 1).  Training took {plain_spread(seconds, 0)} s; {plain_spread(gaussians, 0)} Gaussians, "
        f"{plain_spread(megabytes, 2)} MB.",
        cell_table(record, ("views", "parameters"), METRICS, spread_number),
    ]
    for varied in record["variations"]:
        names = KINDS[varied["kind"]].plural
        blocks += [
            f"The {names} beside the appearance `{varied['base']}`, at unseen views:",
            cell_table(varied, (names, "parameters"), METRICS, spread_number),
        ]
    machines = "; ".join(map(in_words, record["machines"]))
    return [*blocks, f"<sub>{machines}; commit {', '.join(record['commits'])}</sub>"]
