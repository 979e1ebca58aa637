"""The contents of `report.json`; null where the data set has no such images."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from datetime import UTC, datetime
from functools import partial
from typing import Any

from catalogs.version import version
from catalogs.vocabulary.variations import VariationSetting
from surrogate.evaluation import evaluate, metrics, perceptual, scoring
from surrogate.evaluation.cases import PARAMETERS, VALIDATION, VIEWS, each_cell
from surrogate.evaluation.evaluate import VERSION, Baseline, Evaluation, VariedEvaluation
from surrogate.evaluation.scoring import METRICS, mean, one_in_ten
from surrogate.evaluation.tables import ALL_METRICS, cell_means, cell_tables, lead, means
from surrogate.evaluation.trivial.settings import TrainedSettings
from surrogate.model import Surrogate
from surrogate.provenance import commit, machine

CONTENTS = 4  # what else stands in a report; the scores, and what is kept of seeds, change with VERSION alone


def fingerprint(surrogate: Surrogate, unavailable: Iterable[str]) -> str:
    """Changes with the model, its catalog, the evaluation's version, and the metrics that can't be computed here."""
    training = surrogate.training
    marks = [f"{VERSION}.{CONTENTS}", training["fingerprint"], str(training["seconds"]), *sorted(unavailable)]
    return ":".join(marks)


def summarize(
    scene: str, surrogate: Surrogate, evaluation: Evaluation, *, dataset_seconds: float | None
) -> dict[str, Any]:
    """An evaluation with what made it."""
    judged = [s for row in evaluation.cells.values() for s in row["unseen_parameters"]]
    scored = [s for row in evaluation.cells.values() for group in row.values() for s in group]
    middle = surrogate.space.middle
    return {
        "scene": scene,
        "commit": commit(),
        "version": version(),
        "machine": machine(),
        "made": datetime.now(UTC).isoformat(timespec="seconds"),
        "fingerprint": fingerprint(surrogate, evaluation.unavailable),
        "seed": surrogate.training["settings"]["seed"],
        "seconds": {
            "dataset": dataset_seconds,
            "train": surrogate.training["seconds"],
            "train_processor": surrogate.training.get("processor_seconds"),
        },
        "model_megabytes": surrogate.megabytes,
        "gaussians": len(surrogate.gaussians),
        "parameters": surrogate.space.to_json(),
        **_scores(evaluation),
        "one_in_ten": _one_in_ten(evaluation),
        "at_center": _at_center(evaluation, middle),
        "unavailable": dict(evaluation.unavailable),
        "empty_images": sum(math.isnan(s.score.psnr_foreground) for s in judged),
        "empty": {"images": sum(s.score.covered == 0.0 for s in scored), "of": len(scored)},
        "trivial_predictors": [_member_baseline(baseline) for baseline in evaluation.baselines],
        "variations": [_variation(v, middle) for v in evaluation.variations],
        "choices": surrogate.training.get("choices", []),
        "settings": surrogate.training["settings"],
        "curve": surrogate.training["curve"],
        "definitions": metrics.DEFINITIONS
        | scoring.DEFINITIONS
        | perceptual.DEFINITIONS
        | (evaluate.DEFINITIONS if evaluation.variations else {}),
    }


def _scores(part: Evaluation | VariedEvaluation, *more: str) -> dict[str, Any]:
    """Quality and speed, by the metrics of every report and `more`."""
    return {
        "milliseconds": {name: timing.median for name, timing in part.milliseconds.items()},
        "milliseconds_spread": {name: [timing.lowest, timing.highest] for name, timing in part.milliseconds.items()},
        **cell_tables(part.cells, (*ALL_METRICS, *more)),
        "perceptual_images": each_cell(part.cells, lambda scored: sum(s.perceptual is not None for s in scored)),
        "validation": {**means(part.validation, (*METRICS, *more)), "images": len(part.validation)},
    }


def _one_in_ten(evaluation: Evaluation) -> dict[str, Any]:
    """The decibels that a tenth of the images are below, by metric, row and column, and of validation images."""
    metrics = ("psnr_foreground", "psnr")
    cells = {m: each_cell(evaluation.cells, partial(one_in_ten, metric=m)) for m in metrics}
    return {**cells, VALIDATION: {m: one_in_ten(evaluation.validation, m) for m in metrics}}


def _at_center(part: Evaluation | VariedEvaluation, middle: Mapping[str, float]) -> dict[str, Any] | None:
    """The means of the surrogate at the centre of its parameters, and where that is; None without parameters."""
    return {"parameters": dict(middle), **cell_tables(part.at_center, METRICS)} if part.at_center else None


def _member_baseline(baseline: Baseline) -> dict[str, Any]:
    return {
        "name": baseline.name,
        "representation": baseline.representation,
        "borrowed_view_degrees": baseline.degrees,
        **{m: {v: {"unseen_parameters": mean(baseline.scores[v], m)} for v in VIEWS} for m in METRICS},
        "validation": means(baseline.scores[VALIDATION]),
    }


def _variation(evaluation: VariedEvaluation, middle: Mapping[str, float]) -> dict[str, Any]:
    variation, psnr = evaluation.variation, cell_means(evaluation.cells, "psnr")
    return {
        "kind": variation.kind,
        "base": variation.base,
        "parameters": variation.space.to_json(),
        "deformation": evaluation.deformation,
        **_scores(evaluation, "covered"),
        "at_center": _at_center(evaluation, middle),
        "behind": {c: lead(psnr["seen_settings"][c], psnr["unseen_settings"][c]) for c in PARAMETERS},
        "settings_trained": len(TrainedSettings.of(variation)),
        "trivial_predictors": [_setting_baseline(baseline, evaluation) for baseline in evaluation.baselines],
        "settings": [_setting(setting, evaluation) for setting in variation.settings],
    }


def _setting_baseline(baseline: Baseline, evaluation: VariedEvaluation) -> dict[str, Any]:
    own = {s.target: s for s in evaluation.scored}
    scores = {column: baseline.scores.get(column, ()) for column in (*PARAMETERS, VALIDATION)}
    same = {column: [own[s.target] for s in scored] for column, scored in scores.items()}
    return {
        "name": baseline.name,
        "representation": baseline.representation,
        "settings_shown": {column: list(span) for column, span in baseline.settings.items()},
        "images": {column: len(scored) for column, scored in scores.items()},
        "lead": {c: lead(mean(same[c], "psnr"), mean(scored, "psnr")) for c, scored in scores.items()},
        **{m: {column: mean(scored, m) for column, scored in scores.items()} for m in METRICS},
    }


def _setting(setting: VariationSetting, evaluation: VariedEvaluation) -> dict[str, Any]:
    scores = [s for s in evaluation.scored if s.target.appearance == setting.appearance]
    by_column = {c: [s for s in scores if s.target.member.split in splits] for c, splits in PARAMETERS.items()}
    return {
        "name": setting.appearance,
        "split": setting.split,
        "values": list(setting.values),
        "psnr": {column: mean(scored, "psnr") for column, scored in by_column.items()},
        "worst": {c: min((s.score.psnr for s in scored), default=None) for c, scored in by_column.items()},
        "covered": mean(scores, "covered"),
        "images": {column: len(scored) for column, scored in by_column.items()},
    }
