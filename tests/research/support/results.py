"""Reports and studies made by hand, whose numbers are known, of scenes whose pictures are blobs."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

from catalogs.store.catalog import Catalog
from research.studies import upper_bound_records
from research.studies.ablation.experiments import BaseExperiment
from research.studies.ablation.records import DECIDING, Records
from research.studies.ablation.variants import VARIANTS
from research.studies.repeats.seeds import save
from surrogate.evaluation.cases import PARAMETERS, SETTINGS, VIEWS
from surrogate.evaluation.evaluate import VERSION
from surrogate.evaluation.scoring import METRICS, PERCEPTUAL_METRICS
from surrogate.provenance import code
from surrogate.report.records import report_path
from surrogate.storage.checkpoints import fingerprint
from surrogate.storage.records import Provenance, Record
from tests.research.support.scores import cells_of, scores_of
from tests.support.results import (
    MACHINE,
    SETTINGS_OF_SCENE,
    make_catalog,
    make_scene,
)


def report_of(name: str, mark: str, value: float, *, isovalues: float | None = None) -> dict[str, Any]:
    """A report in which everything is `value`, under isovalues `isovalues`, and a predictor is 1 dB better."""
    better = dict.fromkeys(PARAMETERS, value + 1.0)
    predictor = {
        "name": "nearest member (of 2)",
        **{m: {v: {"unseen_parameters": value + 1.0} for v in VIEWS} for m in METRICS},
    }
    worse = {**predictor, "name": "mean image", "psnr": {v: {"unseen_parameters": value - 1.0} for v in VIEWS}}
    varied = {
        "kind": "isovalue",
        "base": "drawn",
        "parameters": [{"name": "isovalue", "low": 1.0, "high": 2.0, "unit": ""}],
        **cells_of(isovalues, SETTINGS),
        **{m: {row: dict.fromkeys(PARAMETERS) for row in SETTINGS} for m in PERCEPTUAL_METRICS},
        "trivial_predictors": [{"name": "nearest trained setting", "psnr": better, "lead": {}}],
        "milliseconds": {"visualization_change": 1.25, "view_change": 2.0},
    }
    return {
        "scene": name,
        "commit": "c0ffee",
        "machine": MACHINE,
        "fingerprint": f"{VERSION}:{mark}:12.5",
        "seed": 0,
        "seconds": {"dataset": 45.0, "train": 12.5},
        "model_megabytes": 0.75,
        "gaussians": 1234,
        "milliseconds": {"parameter_change": 0.25, "view_change": 1.5},
        **cells_of(value),
        **{m: {v: dict.fromkeys(PARAMETERS) for v in VIEWS} for m in PERCEPTUAL_METRICS},
        "flip": {v: dict.fromkeys(PARAMETERS, 0.0125) for v in VIEWS},
        "trivial_predictors": [predictor, worse],
        "variations": [] if isovalues is None else [varied],
    }


def make_results(root: Path, name: str, value: float, *, seeds: tuple[float, ...] = ()) -> Catalog:
    """A scene with its data set, report, upper bound and, with these values, seeds: of the present code, pictures in runs/."""
    make_scene(root, name)
    catalog = make_catalog(root, name)
    records, mark = root / "records" / name, fingerprint(SETTINGS_OF_SCENE, catalog)
    report = report_of(name, mark, value)
    key = {"mark": mark, "seed": 0, "settings": SETTINGS_OF_SCENE.to_json()}
    Record("evaluation", VERSION, key, report, Provenance("c0ffee", code(), MACHINE)).save(report_path(records, 0))
    (root / "runs" / name / "report").mkdir()
    (root / "runs" / name / "report" / "report.json").write_text(json.dumps(report))
    (root / "runs" / name / "report" / "comparison.png").write_bytes(b"a picture")
    save_upper_bound(records, upper_bound_entry(mark, value + 2.0))
    for seed, reached in enumerate(seeds):
        scores = scores_of(seed, reached, base=mark)
        provenance = replace(scores.provenance, code=code())
        save(records, replace(scores, settings=SETTINGS_OF_SCENE.to_json(), provenance=provenance))
    return catalog


def make_study(
    root: Path, name: str, catalog: Catalog, psnr: dict[str, tuple[float, ...]], budget: float = 60.0
) -> None:
    """Results of variants by name, one for each seed."""
    experiment = BaseExperiment(SETTINGS_OF_SCENE, catalog)
    records = Records(root / "records" / name / "ablation", experiment, budget)
    for variant in VARIANTS:
        for seed, reached in enumerate(psnr.get(variant.name, ())):
            result = records.result(
                variant, seed, psnr=reached, ssim=0.9, seconds=budget, images=8, deformation_steps=100
            )
            records.save(replace(result, gaussians=20, provenance=Provenance("bead", code(DECIDING), MACHINE)))


def upper_bound_entry(mark: str, psnr: float, appearance: str = "drawn", **parameters: float) -> dict[str, Any]:
    """An upper bound, beside a surrogate half a dB behind."""
    return {
        "member": "test-0",
        "split": "test",
        "appearance": appearance,
        "parameters": {"p": 0.7, **parameters},
        "seed": 0,
        "psnr": psnr,
        "ssim": 0.9,
        "commit": "c0ffee",
        "machine": MACHINE,
        "surrogate": {"fingerprint": mark, "psnr": psnr - 0.5, "ssim": 0.8},
    }


def save_upper_bound(records: Path, entry: dict[str, Any]) -> None:
    """Store an upper bound in the folder of a scene's records."""
    values = {name: value for name, value in entry.items() if name not in ("commit", "machine")}
    key = {name: values.pop(name) for name in ("member", "split", "appearance", "parameters", "seed")}
    record = Record(
        upper_bound_records.KIND,
        upper_bound_records.VERSION,
        key,
        values,
        Provenance(entry["commit"], "", entry["machine"]),
    )
    record.save(records / upper_bound_records.FOLDER / f"{entry['appearance']}.json")
