"""The section of a report on visualization parameters: unseen isovalues or transfer functions beside seen ones.

Of other fields none is unseen: all are trained.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from catalogs.vocabulary.variations import KINDS
from surrogate.evaluation.cases import PARAMETERS, VALIDATION
from surrogate.evaluation.scoring import METRICS
from surrogate.evaluation.tables import (
    HEADINGS,
    cell_table,
    metric_column,
    number,
    signed_number,
    table,
    table_of,
    terminal_line,
    timing_row,
    validation_line,
)
from surrogate.report.emulated import own_name

SHOWN = ("psnr_foreground", "psnr", "ssim")  # the foreground first: background flatters whole pictures


def variation_section(record: Mapping[str, Any]) -> list[str]:
    """The blocks of Markdown about one of a report's variations."""
    kind = KINDS[record["kind"]]
    names, images, deformation = (
        kind.plural,
        record["images"],
        f"The visualization deformation is of kind {record['deformation']}.",
    )
    if kind.continuous:
        title, judged = f"Unseen {names}", f" of validation members and {names}"
        text = f"{_capital(names)} beside the appearance `{record['base']}`, at unseen views; {deformation}  {_behind(record)}"
        baselines = [f"Beside trivial predictors of unseen {names}:", *_baselines(record)]
    else:
        title, judged, baselines = _capital(names), " of validation members", []
        listed = ", ".join(f"`{setting['name']}`" for setting in record["settings"])
        text = f"Shown instead of the appearance `{record['base']}`: {listed}.  At unseen views; {deformation}"
        images = {"seen_settings": images["seen_settings"]}
    return [
        f"## {title}",
        text,
        cell_table({**record, "images": images}, (names, "parameters"), (*SHOWN, "covered")),
        validation_line(record, judged),
        *baselines,
        _settings(record),
        table(
            ("", ""),
            [
                timing_row(record, "visualization_change", f"a change of the {kind.name}"),
                timing_row(record, "view_change", "a view change after it"),
            ],
        ),
    ]


def variation_line(record: Mapping[str, Any]) -> str:
    """A variation in one line, for a terminal."""
    kind = KINDS[record["kind"]]
    row, names = ("unseen_settings", f"unseen {kind.plural}") if kind.continuous else ("seen_settings", kind.plural)
    foreground, psnr, ssim = (record[metric][row]["unseen_parameters"] for metric in SHOWN)
    if psnr is None:
        return f"{kind.plural}: {'no unseen ones' if kind.continuous else 'none'} at unseen parameters"
    behind = record["behind"]["unseen_parameters"]
    beside = "" if behind is None else f"   ({_signed(behind)} seen ones)"
    return terminal_line(f"{names}, unseen parameters", foreground, psnr, ssim) + beside


def _behind(record: Mapping[str, Any]) -> str:
    names = KINDS[record["kind"]].plural
    at = {column.split("_")[0]: value for column, value in record["behind"].items() if value is not None}
    if not at:
        return f"The data set shows no unseen {names} beside seen ones."
    parts = [f"{_signed(value)} seen ones at {column} parameters" for column, value in at.items()]
    return f"Unseen {names} are {', and '.join(parts)}."


def _signed(behind: float) -> str:
    return f"{abs(behind):.2f} dB {'behind' if behind >= 0.0 else 'ahead of'}"


def _baselines(record: Mapping[str, Any]) -> list[str]:
    if not any(any(entry["images"].values()) for entry in record["trivial_predictors"]):
        return [f"The data set has no unseen {KINDS[record['kind']].plural} that they could predict."]

    means = {m: {**record[m]["unseen_settings"], VALIDATION: record[VALIDATION].get(m)} for m in METRICS}
    own = {"name": own_name(record), "settings_shown": {}, "lead": {}, **means}
    center = [
        {"settings_shown": {}, "lead": {}, **row, **{m: row[m]["unseen_settings"] for m in SHOWN}}
        for row in center_row(record)
    ]
    return [
        table_of(
            (own, *record["trivial_predictors"], *center),
            ("", lambda entry: entry["name"] + _remark(entry["settings_shown"], record["settings_trained"])),
            *(metric_column(HEADINGS[metric], metric, "unseen_parameters") for metric in SHOWN),
            ("lead (dB)", lambda entry: signed_number(entry["lead"].get("unseen_parameters"))),
        ),
        "Those from stored pictures must have the same member, rendered at the same view with trained settings: they predict no "
        "simulation; those from training members alone need nothing of it.  The lead is the surrogate's over whole pictures, on "
        "the same images (negative: behind).  All are at unseen parameters.",
    ]


def center_row(record: Mapping[str, Any]) -> list[dict[str, Any]]:
    """The surrogate at the centre of its parameters as an entry of a table of predictors; empty if unknown."""
    center = record.get("at_center")
    if center is None:
        return []
    at = ", ".join(f"{name} = {value:.4g}" for name, value in center["parameters"].items())
    return [{**center, "name": f"the surrogate frozen at the centre of parameter space ({at})"}]


def _remark(counts: Mapping[str, Sequence[int]], trained: int) -> str:
    """A sentence about members that show only a part of the trained settings."""
    parts = [
        f"{column.replace('_', ' ')}: from {fewest if fewest == most else f'{fewest} to {most}'} of {trained}"
        for column, (fewest, most) in counts.items()
        if fewest < trained
    ]
    return f" ({'; '.join(parts)})" if parts else ""


def _settings(record: Mapping[str, Any]) -> str:
    """Every isovalue, in order, and every field; of transfer functions, which are many, the unseen ones."""
    kind = KINDS[record["kind"]]
    settings = [s for s in record["settings"] if not kind.edits_base or s["split"] == "test"]
    names = [parameter["name"] for parameter in record["parameters"]] if kind.continuous else []  # a field has its name

    def value(place: int) -> Any:
        return lambda setting: f"{setting['values'][place]:.4g}"

    def at(key: str, column: str) -> Any:
        return lambda setting: number(setting[key][column])

    return table_of(
        sorted(settings, key=lambda setting: setting["values"]) if len(names) == 1 else settings,
        ("", lambda setting: setting["name"]),
        ("split", lambda setting: setting["split"]),
        *((name, value(place)) for place, name in enumerate(names)),
        *(
            (f"{heading}, {column.split('_')[0]} parameters", at(key, column))
            for column in PARAMETERS
            for key, heading in (("psnr", "PSNR"), ("worst", "worst"))
        ),
        metric_column("covered pixels", "covered"),
    )


def _capital(words: str) -> str:
    return words[:1].upper() + words[1:]
