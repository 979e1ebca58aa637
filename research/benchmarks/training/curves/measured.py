"""Accuracy of a surrogate after some minutes of training by `surrogate train CATALOG --minutes`."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from research.studies.repeats.run import score_model
from surrogate.evaluation.evaluate import VERSION as EVALUATION
from surrogate.storage.records import Provenance, Record
from surrogate.training.begin import TrainingOptions, begin
from surrogate.training.budget import Budget
from surrogate.training.run import train

KIND, VERSION, FOLDER = "curve", 1, "curve"  # of a scene's records, and of its models
KEY = ("minutes", "seed", "evaluation")


@dataclass(frozen=True)
class Point:
    """A surrogate that was trained for some minutes.

    Attributes
    ----------
    minutes : requested training time.
    seed : of the training.
    gaussians, steps : numbers of Gaussians in the model and of steps in all stages.
    megabytes : size of the model, 10^6 bytes.
    seconds, processor_seconds : training time on the wall, and of all cores together.
    cells, variations : means by metric over the test images, as `research.studies.repeats.seeds.Scores` has them.
    evaluation : version of the evaluation that scored it.
    """

    minutes: float
    seed: int
    gaussians: int
    steps: int
    megabytes: float
    seconds: float
    processor_seconds: float
    cells: Mapping[str, Any]
    variations: Sequence[Mapping[str, Any]]
    provenance: Provenance
    evaluation: int = EVALUATION

    @property
    def unseen(self) -> dict[str, float]:
        """PSNR in dB at unseen views of unseen members, of the base appearance and by kind of variation."""
        decibels = {"base": self.cells["psnr"]["unseen_views"]["unseen_parameters"]}
        decibels |= {v["kind"]: v["psnr"]["unseen_settings"]["unseen_parameters"] for v in self.variations}
        return {what: psnr for what, psnr in decibels.items() if psnr is not None}


def measure(catalog: Path, run: Path, minutes: float) -> Point:
    """Train a catalog for some minutes in the folder `run`, and score it on the test images.

    A finished training is scored as it is. Raises ValueError where the catalog can't be learnt from, or the folder
    holds another run.
    """
    started, begun = time.perf_counter(), time.process_time()
    opened = begin(
        catalog, run, TrainingOptions(Budget(minutes=minutes)), elapsed=lambda: time.perf_counter() - started
    )
    surrogate = train(opened.settings, opened.catalog, opened.model)
    return Point(
        minutes,
        opened.settings.seed,
        len(surrogate.gaussians),
        surrogate.training["steps"],
        surrogate.megabytes,
        surrogate.training["seconds"],
        surrogate.training["processor_seconds"],
        **score_model(surrogate, opened.catalog),
        provenance=Provenance.now(time.process_time() - begun),
    )


def save(records: Path, point: Point) -> Path:
    """Store a point in the folder of a scene's records; returns its path."""
    path = records / FOLDER / f"{point.minutes:g}.json"
    Record.of(KIND, VERSION, point, KEY).save(path)
    return path


def load(records: Path) -> list[Point]:
    """The stored points of a scene, by minutes."""
    stored = Record.load_all(records / FOLDER, KIND, VERSION, {"evaluation": EVALUATION}).values()
    points = [record.to(Point, lambda point: point.unseen) for record in stored]
    return sorted((point for point in points if point is not None), key=lambda point: point.minutes)
