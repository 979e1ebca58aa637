"""The report of a run: `report.json` for programs, `report.md` and pictures for people."""

from __future__ import annotations

import json
import shutil
from collections.abc import Iterable, Mapping, Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from catalogs import durable
from catalogs.catalog import Catalog
from surrogate.evaluation import evaluate, metrics, perceptual, scoring
from surrogate.evaluation.cases import VIEWS
from surrogate.evaluation.evaluate import VERSION, Evaluation
from surrogate.evaluation.perceptual import PerceptualMetrics
from surrogate.evaluation.scoring import METRICS, Scored, mean
from surrogate.evaluation.tables import (
    cell_table,
    cell_tables,
    number,
    perceptual_remarks,
    row,
    table,
    timing_row,
    timings,
)
from surrogate.model import Surrogate
from surrogate.provenance import commit, machine
from surrogate.report import figures
from surrogate.report.variations import summarize_variation, variation_section
from surrogate.studies.ceiling import load_ceilings
from surrogate.studies.repeats.records import Scores, load_scores
from surrogate.studies.repeats.spread import summarize_repeats
from surrogate.studies.repeats.table import repeats_section

RECORD = "report.json"


def fingerprint(
    surrogate: Surrogate,
    unavailable: Iterable[str],
    ceilings: Sequence[Mapping[str, Any]] = (),
    repeats: Sequence[Scores] = (),
) -> str:
    """Changes when the model, its catalog, the evaluation's code version, metrics that can't be had, or what stands beside do."""
    training, limits = surrogate.training, [f"{entry['appearance']}={entry['psnr']}" for entry in ceilings]
    seeds = [f"{scores.seed}={scores.fingerprint}" for scores in repeats if len(repeats) > 1]
    marks = [str(VERSION), training["fingerprint"], str(training["seconds"]), *sorted(unavailable), *limits, *seeds]
    return ":".join(marks)


def is_current(directory: Path, surrogate: Surrogate, records: Path | None = None) -> bool:
    """Whether `directory` holds a report of exactly this surrogate and of what stands beside it in `records`."""
    try:
        record = json.loads((directory / RECORD).read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return False
    beside = _beside(surrogate, directory.parent if records is None else records)
    return bool(record.get("fingerprint") == fingerprint(surrogate, PerceptualMetrics.load().unavailable, *beside))


def _beside(surrogate: Surrogate, records: Path) -> tuple[list[dict[str, Any]], list[Scores]]:
    """The ceilings and seeds of the surrogate's settings and data; maybe none."""
    mark = surrogate.training["fingerprint"]
    ceilings = [entry for entry in load_ceilings(records) if (entry["surrogate"] or {}).get("fingerprint") == mark]
    return ceilings, load_scores(records, base=mark)


def write_report(
    directory: Path,
    scene: str,
    surrogate: Surrogate,
    catalog: Catalog,
    evaluation: Evaluation,
    *,
    dataset_seconds: float | None = None,
    records: Path | None = None,
) -> dict[str, Any]:
    """Write the report into `directory`, which appears whole, replacing an earlier one; returns `report.json`'s contents.

    Ceilings and seeds of the same settings and data are taken from `records`, by default the folder around `directory`.
    """
    ceilings, repeats = _beside(surrogate, directory.parent if records is None else records)
    record = summarize(
        scene,
        surrogate,
        evaluation,
        dataset_seconds=dataset_seconds,
        ceilings=ceilings,
        repeats=repeats,
    )
    directory.parent.mkdir(parents=True, exist_ok=True)
    durable.remove_abandoned(directory.parent)
    partial = durable.partial_name(directory)
    partial.mkdir()
    try:
        pictures = figures.draw(partial, surrogate, catalog, evaluation)
        (partial / "report.md").write_text(_page(record, pictures), encoding="utf-8")
        (partial / RECORD).write_text(json.dumps(record, indent=1, allow_nan=False), encoding="utf-8")
        if directory.exists():
            retired = durable.partial_name(directory)
            durable.rename(directory, retired)
            durable.commit_folder(partial, directory)
            shutil.rmtree(retired, ignore_errors=True)
        else:
            durable.commit_folder(partial, directory)
    finally:
        shutil.rmtree(partial, ignore_errors=True)
    return record


def summarize(
    scene: str,
    surrogate: Surrogate,
    evaluation: Evaluation,
    *,
    dataset_seconds: float | None,
    ceilings: Sequence[Mapping[str, Any]] = (),
    repeats: Sequence[Scores] = (),
) -> dict[str, Any]:
    """The contents of `report.json`; null where the data set has no such images."""
    unseen = {v: {"unseen_parameters": evaluation.cells[v]["unseen_parameters"]} for v in VIEWS}
    return {
        "scene": scene,
        "commit": commit(),
        "machine": machine(),
        "made": datetime.now(UTC).isoformat(timespec="seconds"),
        "fingerprint": fingerprint(surrogate, evaluation.unavailable, ceilings, repeats),
        "seed": surrogate.training["settings"]["seed"],
        "seconds": {"dataset": dataset_seconds, "train": surrogate.training["seconds"]},
        "model_megabytes": surrogate.megabytes,
        "gaussians": len(surrogate.gaussians),
        **timings(evaluation.milliseconds),
        **cell_tables(evaluation.cells),
        "unavailable": dict(evaluation.unavailable),
        "empty_images": sum(_empty(s) for v in unseen.values() for group in v.values() for s in group),
        "validation": {m: mean(evaluation.validation, m) for m in METRICS} | {"images": len(evaluation.validation)},
        "trivial_predictors": [
            {
                "name": result.name,
                "borrowed_view_degrees": result.degrees,
                **{m: {v: {"unseen_parameters": mean(result.scores[v], m)} for v in VIEWS} for m in METRICS},
                "validation": {m: mean(result.scores["validation"], m) for m in METRICS},
            }
            for result in evaluation.baselines
        ],
        "ceilings": [dict(entry) for entry in ceilings],
        "repeats": summarize_repeats(repeats),
        "variations": [summarize_variation(v) for v in evaluation.variations],
        "choices": surrogate.training.get("choices", []),
        "settings": surrogate.training["settings"],
        "curve": surrogate.training["curve"],
        "definitions": metrics.DEFINITIONS
        | scoring.DEFINITIONS
        | perceptual.DEFINITIONS
        | (evaluate.DEFINITIONS if evaluation.variations else {}),
    }


def _empty(scored: Scored) -> bool:
    return scored.score.psnr_foreground != scored.score.psnr_foreground


def _page(record: Mapping[str, Any], pictures: Mapping[str, str]) -> str:
    machine_line = f"{record['machine']['processor']}, {record['machine']['cores']} cores"
    lines = [
        f"# {record['scene']}",
        "",
        f"Commit `{record['commit']}`, {machine_line}, seed {record['seed']}, {record['made']}.",
        "",
        "## How good",
        "",
        *cell_table(record, ("views", "parameters")),
        *perceptual_remarks(record, record["unavailable"]),
        "",
        f"Validation ({record['validation']['images']} images; all choices were made on these): "
        f"{number(record['validation']['psnr'])} dB, SSIM {number(record['validation']['ssim'], 4)}.",
        "",
        "## Beside trivial predictors",
        "",
        *_baseline_table(record),
        "",
        *_ceiling_section(record),
        *repeats_section(record["repeats"], record["scene"]),
        "## How fast, how large",
        "",
        *_cost_table(record),
        "",
        *(line for varied in record["variations"] for line in variation_section(varied, record["unavailable"])),
        *_needs_section(record),
    ]
    for title, name in pictures.items():
        lines += [f"## {title}", "", f"![{title}]({name})", ""]
    lines += ["## Definitions", "", *(f"- **{name}**: {text}." for name, text in record["definitions"].items()), ""]
    return "\n".join(lines)


def _ceiling_section(record: Mapping[str, Any]) -> list[str]:
    """What limits the figures: the same Gaussians, fitted to one unseen member alone."""
    if not record["ceilings"]:
        return []
    return [
        "## Beside the ceiling",
        "",
        "As many Gaussians, fitted for as many steps to one member alone, on the same test views of that member: an unseen one, "
        "or a training member where the data set has no unseen one with views to learn from.",
        "",
        *table(
            ("appearance", "member", "fitted alone (dB)", "surrogate (dB)", "SSIM alone", "SSIM"),
            [
                (
                    entry["appearance"],
                    f"{entry['member']} ({'unseen' if entry['split'] == 'test' else 'seen'})",
                    number(entry["psnr"]),
                    number(entry["surrogate"]["psnr"]),
                    number(entry["ssim"], 4),
                    number(entry["surrogate"]["ssim"], 4),
                )
                for entry in record["ceilings"]
            ],
        ),
        "",
    ]


def _cost_table(record: Mapping[str, Any]) -> list[str]:
    seconds, settings = record["seconds"], record["settings"]
    steps = [settings["canonical_steps"], settings["deformation_steps"]]
    steps += [settings["visualization_steps"] for _ in record["variations"]]
    return table(
        ("", ""),
        [
            ("making the data set", f"{number(seconds['dataset'], 0)} s"),
            ("training", f"{number(seconds['train'], 0)} s, {' + '.join(map(str, steps))} steps"),
            ("model", f"{record['gaussians']:,} Gaussians, {record['model_megabytes']:.2f} MB"),
            timing_row(record, "parameter_change", "a parameter change"),
            timing_row(record, "view_change", "a view change"),
        ],
    )


def _needs_section(record: Mapping[str, Any]) -> list[str]:
    choices = record["choices"]
    if not choices:
        return []
    tolerance = record["settings"]["need_tolerance"]
    lines = [
        "## What this scene needed",
        "",
        f"Chosen on validation images; each choice after the first was allowed to cost {tolerance:g} dB.  The columns at the right "
        "say how the model changed with it: negative decibels were lost, megabytes are those of the tensors, milliseconds those "
        "of deforming and drawing one picture.",
        "",
        row("", "kept", "tried (validation PSNR, dB)", "dB", "MB", "ms"),
        row(*["---"] * 6),
    ]
    for choice in choices:
        tried = " · ".join(f"{option['name']}: {option['psnr']:.2f}" for option in choice["options"])
        lines.append(row(choice["name"], choice["kept"], tried or "–", *_change(choice["before"], choice["after"])))
    return [*lines, ""]


def _change(before: Mapping[str, float] | None, after: Mapping[str, float] | None) -> list[str]:
    if before is None or after is None:
        return ["–"] * 3
    size, speed = (f"{before[name]:.2f} → {after[name]:.2f}" for name in ("megabytes", "milliseconds"))
    return [f"{after['psnr'] - before['psnr']:+.3f}", size, speed]


def _baseline_table(record: Mapping[str, Any]) -> list[str]:
    if not record["trivial_predictors"]:
        return ["The data set has no unseen parameters, or no training members to predict them from."]
    lines = [
        "At unseen parameters.  The predictors may use every view of the training members, also those unseen here; "
        "the lead is the surrogate's at unseen views (negative: behind).",
        "",
        row(
            "",
            "PSNR, seen views",
            "PSNR, unseen views",
            "foreground, unseen views",
            "SSIM, unseen views",
            "lead (dB)",
            "PSNR, validation",
        ),
        row(*["---"] * 7),
    ]
    own = record["psnr"]["unseen_views"]["unseen_parameters"]
    for entry in [{"name": "**surrogate**", **record}, *record["trivial_predictors"]]:
        at = {m: {v: entry[m][v]["unseen_parameters"] for v in VIEWS} for m in METRICS}
        other = at["psnr"]["unseen_views"]
        lead = "" if own is None or other is None or entry["name"] == "**surrogate**" else f"{own - other:+.2f}"
        lines.append(
            row(
                entry["name"],
                number(at["psnr"]["seen_views"]),
                number(other),
                number(at["psnr_foreground"]["unseen_views"]),
                number(at["ssim"]["unseen_views"], 4),
                lead,
                number(entry["validation"]["psnr"]),
            )
        )
    borrowed = max(entry["borrowed_view_degrees"] for entry in record["trivial_predictors"])
    if borrowed:
        lines += [
            "",
            f"The training members lack some of these views; the nearest one, up to {borrowed:.1f}° away, stands in.",
        ]
    return lines
