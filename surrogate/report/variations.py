"""The part of a report about visualization parameters: how unseen isovalues or transfer functions fare beside seen ones.

Of other fields there are no unseen ones: they are all seen.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from catalogs.variations import KINDS, Setting
from surrogate.evaluation.cases import PARAMETERS, VALIDATION
from surrogate.evaluation.evaluate import Baseline, VariedEvaluation
from surrogate.evaluation.scoring import Scored, mean
from surrogate.evaluation.tables import (
    METRICS,
    cell_means,
    cell_table,
    cell_tables,
    metric_number,
    number,
    perceptual_remarks,
    table,
    timing_row,
    timings,
)
from surrogate.evaluation.trivial.settings import Trained

COLUMNS = (*PARAMETERS, VALIDATION)


def summarize_variation(evaluation: VariedEvaluation) -> dict[str, Any]:
    """What `report.json` holds of a variation; null where the data set has no such images."""
    variation, cells = evaluation.variation, evaluation.cells
    psnr = cell_means(cells, "psnr")
    return {
        "kind": variation.kind,
        "base": variation.base,
        "parameters": variation.space.to_json(),
        "deformation": evaluation.deformation,
        **cell_tables(cells),
        "covered": cell_means(cells, "covered"),
        "behind": {c: _minus(psnr["seen_settings"][c], psnr["unseen_settings"][c]) for c in PARAMETERS},
        "validation": _means(evaluation.validation, (*METRICS, "covered")) | {"images": len(evaluation.validation)},
        "settings_trained": len(Trained.of(variation)),
        "trivial_predictors": [_summarize_baseline(b, evaluation) for b in evaluation.baselines],
        "settings": [_summarize_setting(s, evaluation) for s in variation.settings],
        **timings(evaluation.milliseconds),
    }


def variation_section(record: Mapping[str, Any], unavailable: Iterable[str]) -> list[str]:
    """Lines of Markdown from a `summarize_variation` record."""
    kind = KINDS[record["kind"]]
    names = kind.plural
    if not kind.continuous:
        return _field_section(record, names, unavailable)
    return [
        f"## Unseen {names}",
        "",
        f"{_capital(names)} beside the appearance `{record['base']}`, at unseen views; F_vis is of kind "
        f"{record['deformation']}.  {_behind(record, names)}",
        "",
        *cell_table(record, (names, "parameters"), also=("covered",)),
        *perceptual_remarks(record, dict.fromkeys(unavailable, "the reason stands above")),
        "",
        _validation(record, f"validation members and {names}"),
        "",
        f"Beside trivial predictors of unseen {names}:",
        "",
        *_baseline_table(record, names),
        "",
        *_setting_table(record),
        "",
        *_timing_table(record),
        "",
    ]


def _field_section(record: Mapping[str, Any], names: str, unavailable: Iterable[str]) -> list[str]:
    """All of them were learnt, so there is nothing to compare with."""
    seen = {**record, "images": {"seen_settings": record["images"]["seen_settings"]}}
    shown = ", ".join(f"`{setting['name']}`" for setting in record["settings"])
    return [
        f"## {_capital(names)}",
        "",
        f"Shown instead of the appearance `{record['base']}`: {shown}.  At unseen views; F_vis is of kind {record['deformation']}.",
        "",
        *cell_table(seen, (names, "parameters"), also=("covered",)),
        *perceptual_remarks(record, dict.fromkeys(unavailable, "the reason stands above")),
        "",
        _validation(record, "validation members"),
        "",
        *_setting_table(record),
        "",
        *_timing_table(record),
        "",
    ]


def _validation(record: Mapping[str, Any], what: str) -> str:
    found = record["validation"]
    return (
        f"Validation ({found['images']} images of {what}): {number(found['psnr'])} dB, SSIM {number(found['ssim'], 4)}."
    )


def _timing_table(record: Mapping[str, Any]) -> list[str]:
    change = f"a change of the {KINDS[record['kind']].name}"
    return table(
        ("", ""),
        [
            timing_row(record, "visualization_change", change),
            timing_row(record, "view_change", "a view change after it"),
        ],
    )


def variation_line(record: Mapping[str, Any]) -> str:
    """The variation in one line, for a terminal."""
    kind = KINDS[record["kind"]]
    if not kind.continuous:
        return _field_line(record, kind.plural)
    unseen = {m: record[m]["unseen_settings"]["unseen_parameters"] for m in ("psnr", "ssim")}
    if unseen["psnr"] is None:
        return f"{kind.plural}: no unseen ones at unseen parameters"
    label = f"unseen {kind.plural}, unseen parameters"
    behind = record["behind"]["unseen_parameters"]
    beside = "" if behind is None else f"   ({_signed(behind)} seen ones)"
    return f"{label:<38} {unseen['psnr']:6.2f} dB   SSIM {unseen['ssim']:.4f}{beside}"


def _field_line(record: Mapping[str, Any], names: str) -> str:
    seen = {m: record[m]["seen_settings"]["unseen_parameters"] for m in ("psnr", "ssim")}
    if seen["psnr"] is None:
        return f"{names}: none at unseen parameters"
    return f"{names + ', unseen parameters':<38} {seen['psnr']:6.2f} dB   SSIM {seen['ssim']:.4f}"


def _summarize_baseline(baseline: Baseline, evaluation: VariedEvaluation) -> dict[str, Any]:
    own = {s.target: s for s in (*evaluation.scored, *evaluation.validation)}
    scores = {column: baseline.scores.get(column, ()) for column in COLUMNS}
    same = {column: [own[s.target] for s in scored] for column, scored in scores.items()}
    return {
        "name": baseline.name,
        "settings_shown": {column: list(span) for column, span in baseline.shown.items()},
        "images": {column: len(scored) for column, scored in scores.items()},
        "lead": {c: _minus(mean(same[c], "psnr"), mean(scores[c], "psnr")) for c in COLUMNS},
        **{m: {column: mean(scored, m) for column, scored in scores.items()} for m in METRICS},
    }


def _summarize_setting(setting: Setting, evaluation: VariedEvaluation) -> dict[str, Any]:
    shown = [s for s in (*evaluation.scored, *evaluation.validation) if s.target.appearance == setting.appearance]
    by_column = {c: [s for s in shown if s.target.member.split in splits] for c, splits in PARAMETERS.items()}
    return {
        "name": setting.appearance,
        "split": setting.split,
        "values": list(setting.values),
        "psnr": {column: mean(scored, "psnr") for column, scored in by_column.items()},
        "worst": {c: min((s.score.psnr for s in scored), default=None) for c, scored in by_column.items()},
        "covered": mean(shown, "covered"),
        "images": {column: len(scored) for column, scored in by_column.items()},
    }


def _means(scored: Sequence[Scored], metrics: Sequence[str]) -> dict[str, float | None]:
    return {metric: mean(scored, metric) for metric in metrics}


def _minus(first: float | None, second: float | None) -> float | None:
    return None if first is None or second is None else first - second


def _behind(record: Mapping[str, Any], names: str) -> str:
    at = {column.split("_")[0]: value for column, value in record["behind"].items() if value is not None}
    if not at:
        return f"The data set shows no unseen {names} beside seen ones."
    parts = [f"{_signed(value)} seen ones at {column} parameters" for column, value in at.items()]
    return f"Unseen {names} are {', and '.join(parts)}."


def _signed(behind: float) -> str:
    return f"{abs(behind):.2f} dB {'behind' if behind >= 0.0 else 'ahead of'}"


def _baseline_table(record: Mapping[str, Any], names: str) -> list[str]:
    if not any(any(entry["images"].values()) for entry in record["trivial_predictors"]):
        return [f"The data set has no unseen {names} that they could predict."]
    means = {m: {**record[m]["unseen_settings"], VALIDATION: record["validation"].get(m)} for m in METRICS}
    own = {"name": "**surrogate**", "settings_shown": {}, "lead": {}, **means}
    lines = table(
        (
            "",
            "PSNR, seen parameters",
            "PSNR, unseen parameters",
            "of the mean error",
            "of the foreground",
            "SSIM",
            "lead (dB)",
            "PSNR, validation",
        ),
        (_baseline_row(entry, record["settings_trained"]) for entry in (own, *record["trivial_predictors"])),
    )
    return [
        *lines,
        "",
        "Those from stored pictures must have the same member, rendered at the same view with trained settings: they predict no "
        "simulation.  The lead is the surrogate's on the same images (negative: behind); it, and the columns between, are at "
        "unseen parameters.",
    ]


def _baseline_row(entry: Mapping[str, Any], trained: int) -> tuple[str, ...]:
    lead = entry["lead"].get("unseen_parameters")
    return (
        entry["name"] + _remark(entry["settings_shown"], trained),
        number(entry["psnr"]["seen_parameters"]),
        *(metric_number(m, entry[m]["unseen_parameters"]) for m in METRICS),
        "" if lead is None else f"{lead:+.2f}",
        number(entry["psnr"][VALIDATION]),
    )


def _remark(shown: Mapping[str, Sequence[int]], trained: int) -> str:
    """Where members show only a part of the trained settings."""
    parts = []
    for column, (fewest, most) in shown.items():
        if fewest < trained:
            span = f"{fewest}" if fewest == most else f"{fewest} to {most}"
            parts.append(f"{column.replace('_', ' ')}: from {span} of {trained}")
    return f" ({'; '.join(parts)})" if parts else ""


def _setting_table(record: Mapping[str, Any]) -> list[str]:
    """Every isovalue, in order, and every field; of transfer functions, which are many, the unseen ones."""
    kind = KINDS[record["kind"]]
    settings = [s for s in record["settings"] if not kind.edits_base or s["split"] == "test"]
    names = [parameter["name"] for parameter in record["parameters"]]
    if not kind.continuous:  # the setting's name says it
        settings, names = [{**setting, "values": []} for setting in settings], []
    settings = sorted(settings, key=lambda s: s["values"]) if len(names) == 1 else settings
    headings = [f"{what}, {c.split('_')[0]} parameters" for c in PARAMETERS for what in ("PSNR", "worst")]
    return table(("", "split", *names, *headings, "covered pixels"), map(_setting_row, settings))


def _setting_row(setting: Mapping[str, Any]) -> tuple[str, ...]:
    return (
        setting["name"],
        setting["split"],
        *(f"{value:.4g}" for value in setting["values"]),
        *(number(setting[key][c]) for c in PARAMETERS for key in ("psnr", "worst")),
        metric_number("covered", setting["covered"]),
    )


def _capital(words: str) -> str:
    return words[:1].upper() + words[1:]
