"""The report of a run: `report.json` for programs, `report.md` and pictures for people."""

from __future__ import annotations

import json
import shutil
from pathlib import Path
from typing import Any

from catalogs.files import durable
from catalogs.store.catalog import Catalog
from surrogate.evaluation.evaluate import Evaluation
from surrogate.evaluation.perceptual import PerceptualMetrics
from surrogate.model import Surrogate
from surrogate.model.representation import VIEW
from surrogate.report import figures
from surrogate.report.decided import decided_on
from surrogate.report.emulated import drawn_words, numbers_record, representations_record
from surrogate.report.members import members_record
from surrogate.report.outlook import outlook_record
from surrogate.report.page import page
from surrogate.report.summary import fingerprint, summarize
from surrogate.report.verdict import verdict
from surrogate.storage.records import read_json
from surrogate.training.messages import learnt_line, members_line, tests_line

RECORD = "report.json"


def is_current(directory: Path, surrogate: Surrogate) -> bool:
    """True if `directory` holds a report of exactly this surrogate with all metrics that can be computed here."""
    mark = (read_json(directory / RECORD) or {}).get("fingerprint")
    return bool(mark == fingerprint(surrogate, PerceptualMetrics.load().unavailable))


def write_report(
    directory: Path,
    scene: str,
    surrogate: Surrogate,
    catalog: Catalog,
    evaluation: Evaluation,
    *,
    dataset_seconds: float | None = None,
) -> dict[str, Any]:
    """Write the report into `directory`, which appears whole, replacing an earlier one; returns `report.json`'s contents."""
    record = summarize(scene, surrogate, evaluation, dataset_seconds=dataset_seconds)
    variations = surrogate.variations
    learnt = learnt_line(catalog.plan, str(surrogate.training["appearance"]), variations)
    record["representations"] = representations_record(surrogate, catalog, evaluation)
    record["numbers"] = numbers_record(evaluation)
    record["ensemble"] = {"learnt": learnt, "members": members_line(catalog), "tests": tests_line(catalog)}
    for part, varied in zip((record, *record["variations"]), (None, *variations), strict=True):
        part["decided_on"] = decided_on(surrogate, catalog, varied)
        part["drawn"] = drawn_words(surrogate, VIEW if varied is None else varied.kind)
    record["members"] = members_record(surrogate, catalog, evaluation)
    record["outlook"] = outlook_record(surrogate, catalog)
    record["verdict"] = verdict(record)
    durable.make_folder(directory.parent)
    durable.remove_abandoned(directory.parent)
    partial, retired = durable.partial_name(directory), durable.partial_name(directory)
    partial.mkdir()
    try:
        pictures = figures.draw(partial, surrogate, catalog, evaluation, record)
        (partial / "report.md").write_text(page(record, pictures), encoding="utf-8")
        (partial / RECORD).write_text(json.dumps(record, indent=1, allow_nan=False), encoding="utf-8")
        if directory.exists():
            durable.rename(directory, retired)
        durable.commit_folder(partial, directory)
    finally:
        for left in (partial, retired):
            shutil.rmtree(left, ignore_errors=True)
    return record
