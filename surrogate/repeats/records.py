"""The scores of one seed, and the folder that keeps them: a small file each, there whole or not at all."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from catalogs import durable
from surrogate.evaluate import VERSION as EVALUATION

VERSION = 1
SEEDS, FILE = "seeds", "scores.json"


@dataclass(frozen=True)
class Scores:
    """How well the model of one seed does on the test images of a report.

    Attributes
    ----------
    fingerprint : of the training run.
    base : fingerprint of the run with the scene's own seed; two that agree in it differ in nothing but the seed.
    cells : means by metric of `surrogate.scoring.METRICS`, and "images", by row of views and column of parameters, as in
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
    durable.replace(path, content)


def load(run: Path, seed: int) -> Scores | None:
    """What is kept of a seed; None for nothing, or for what another version wrote or judged."""
    try:
        record = json.loads(scores_path(run, seed).read_text(encoding="utf-8"))
        if (record.pop("version"), record.pop("evaluation")) != (VERSION, EVALUATION):
            return None
        scores = Scores(**record)
    except (OSError, ValueError, KeyError, TypeError, AttributeError):
        return None
    return scores if scores.seed == seed else None


def scores_beside(run: Path, base: str) -> list[Scores]:
    """All scores in a scene's folder of results that differ from the run of fingerprint `base` in the seed alone, by seed."""
    seeds = sorted(int(path.name) for path in (run / SEEDS).glob("*") if path.name.isdecimal())
    found = [load(run, seed) for seed in seeds]
    return [scores for scores in found if scores is not None and scores.base == base]
