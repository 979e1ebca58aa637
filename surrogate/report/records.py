"""The figures of a report, kept as a record."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from surrogate.evaluation.evaluate import VERSION
from surrogate.model import Surrogate
from surrogate.settings import TrainingSettings
from surrogate.storage.records import Provenance, Record

KIND, FOLDER = "evaluation", "evaluation"  # of a scene's records
NO_FIGURES = ("settings", "curve", "definitions")
EVERY_FIGURE = ("at_center",)  # added since records of this version were first kept, which are still read


def report_path(records: Path, seed: int) -> Path:
    """The file of the figures in the folder of a scene's records."""
    return records / FOLDER / f"{seed}.json"


def save_report(
    records: Path, surrogate: Surrogate, settings: TrainingSettings, report: Mapping[str, Any], processor_seconds: float
) -> None:
    """Keep the figures of `report`, the contents of `report.json` about the surrogate of these settings of a scene."""
    key = {"mark": surrogate.training["fingerprint"], "seed": settings.seed, "settings": settings.to_json()}
    figures = {name: value for name, value in report.items() if name not in NO_FIGURES}
    provenance = replace(Provenance.now(processor_seconds), code=surrogate.training.get("code_version", ""))
    Record(KIND, VERSION, key, figures, provenance).save(report_path(records, settings.seed))


def load_report(records: Path, seed: int) -> Record | None:
    """The record of a seed, whose values are the figures; None without any of this version of the evaluation."""
    return Record.load(report_path(records, seed), KIND, VERSION, {"seed": seed})


def is_kept(records: Path, seed: int, mark: str, trained_by: str) -> bool:
    """True if all figures of a report are stored for a seed's model of this fingerprint, trained by this code."""
    record = load_report(records, seed)
    whole = record is not None and set(EVERY_FIGURE) <= set(record.values)
    return record is not None and whole and record.agrees({"mark": mark}) and record.provenance.code == trained_by
