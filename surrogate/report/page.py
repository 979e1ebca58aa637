"""`report.md`: what `report.json` holds, for people."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from surrogate.evaluation.cases import VALIDATION
from surrogate.evaluation.tables import (
    NOTHING,
    cell_table,
    center_table,
    document,
    lead,
    metric_column,
    number,
    perceptual_remarks,
    signed_number,
    table,
    table_of,
    timing_row,
    validation_line,
)
from surrogate.model.representation import FIELD
from surrogate.provenance import in_words
from surrogate.report.emulated import numbers_section, own_name, representations_section
from surrogate.report.variations import variation_section


def page(record: Mapping[str, Any], pictures: Mapping[str, str]) -> str:
    """The page of a report; `pictures` are file names by title."""
    return document(
        f"# {record['scene']}",
        f"Commit `{record['commit']}`, {in_words(record['machine'])}, seed {record['seed']}, {record['made']}.",
        _ensemble(record.get("ensemble")),
        "## How good",
        cell_table(record, ("views", "parameters")),
        empty_line(record),
        perceptual_remarks(record, record["unavailable"]),
        validation_line(record, ""),
        *center_table(record, ("views", "parameters")),
        "## Beside trivial predictors",
        *_baselines(record),
        *representations_section(record),
        *numbers_section(record),
        "## How fast, how large",
        _costs(record),
        *(block for varied in record["variations"] for block in variation_section(varied, record["unavailable"])),
        *_needs(record),
        *(block for title, name in pictures.items() for block in (f"## {title}", f"![{title}]({name})")),
        "## Definitions",
        "\n".join(f"- **{name}**: {text}." for name, text in record["definitions"].items()),
    )


def empty_line(record: Mapping[str, Any]) -> str:
    """A sentence on test images that show nothing, which nearly any picture without Gaussians predicts; "" without any."""
    counts = record.get("empty", {"images": 0, "of": 0})
    if not counts["images"]:
        return ""
    which = "All" if counts["images"] == counts["of"] else f"{counts['images']:,} of"
    said = "nothing was learnt or tested" if which == "All" else "they are predicted easily, and raise the means"
    return f"{which} {counts['of']:,} test images are empty: {said} (an empty image that is predicted empty counts as 60 dB)."


def _ensemble(record: Mapping[str, Any] | None) -> str:
    """The learnt appearance, the members it was learnt from, and whether those that test it share their runs."""
    if record is None:
        return ""
    tests = record.get("tests", "")
    return f"The surrogate {record['learnt']}.  {record['members']}." + (
        f"  {tests[0].upper()}{tests[1:]}." if tests else ""
    )


def _baselines(record: Mapping[str, Any]) -> list[str]:
    entries = record["trivial_predictors"]
    if not entries:
        return [_without_baselines(record)]

    def ahead(entry: Mapping[str, Any]) -> str:
        psnr, other = (one["psnr"]["unseen_views"]["unseen_parameters"] for one in (record, entry))
        return "" if entry is own else signed_number(lead(psnr, other))

    own, unseen = {**record, "name": own_name(record)}, ("unseen_views", "unseen_parameters")
    borrowed = max(entry["borrowed_view_degrees"] for entry in entries)
    return [
        "At unseen parameters.  The predictors may use every view of the training members, also those unseen here; "
        "the lead is the surrogate's at unseen views (negative: behind).",
        table_of(
            [own, *entries],
            ("", lambda entry: entry["name"]),
            metric_column("PSNR, seen views", "psnr", "seen_views", "unseen_parameters"),
            metric_column("PSNR, unseen views", "psnr", *unseen),
            metric_column("of the mean error", "psnr_of_mean_error", *unseen),
            metric_column("foreground, unseen views", "psnr_foreground", *unseen),
            metric_column("SSIM, unseen views", "ssim", *unseen),
            ("lead (dB)", ahead),
            metric_column("PSNR, validation", VALIDATION, "psnr"),
        ),
        f"The training members lack some of these views; the nearest one, up to {borrowed:.1f}° away, stands in."
        if borrowed
        else "",
    ]


def _without_baselines(record: Mapping[str, Any]) -> str:
    """Why there are none, and what the report therefore can't say."""
    if any(columns["unseen_parameters"] for columns in record["images"].values()):
        return "There are no training members from whose pictures they could predict."
    return (
        "No member was kept aside to test unseen parameters: this report says how well the members are shown that the surrogate "
        "learnt from, at views that it did not see, and nothing of the parameters between them.  "
        "`surrogate train CATALOG --hold-out 0.2` keeps some aside."
    )


def _costs(record: Mapping[str, Any]) -> str:
    seconds, settings = record["seconds"], record["settings"]
    stages = ["canonical", "deformation", *("visualization" for _ in record["variations"])]
    cost = seconds.get("train_processor")
    processor = "" if cost is None else f" ({number(cost, 0)} s of all cores together)"
    steps = " + ".join(str(settings[f"{stage}_steps"]) for stage in stages)
    return table(
        ("", ""),
        [
            ("making the data set", f"{number(seconds['dataset'], 0)} s"),
            ("training", f"{number(seconds['train'], 0)} s{processor}, {steps} steps"),
            ("model", f"{record['gaussians']:,} Gaussians, {record['model_megabytes']:.2f} MB{_emulator_size(record)}"),
            timing_row(record, "parameter_change", "a parameter change"),
            timing_row(record, "view_change", "a view change"),
        ],
    )


def _emulator_size(record: Mapping[str, Any]) -> str:
    scores = record.get("representations")
    return "" if scores is None else f"; emulated fields, {scores['megabytes'][FIELD]:.2f} MB"


def _needs(record: Mapping[str, Any]) -> list[str]:
    if not record["choices"]:
        return []

    def change(text: Callable[[Any, Any], str]) -> Callable[[Any], str]:
        """The `text` of the model before and after a choice, where both are known."""
        return lambda choice: (
            text(choice["before"], choice["after"]) if choice["before"] and choice["after"] else NOTHING
        )

    def tried(choice: Mapping[str, Any]) -> str:
        return " · ".join(f"{option['name']}: {option['psnr']:.2f}" for option in choice["options"]) or NOTHING

    return [
        "## What this ensemble needed",
        "Chosen on validation images; each choice after the first was allowed to cost "
        f"{record['settings']['need_tolerance']:g} dB.  The columns at the right "
        "say how the model changed with it: negative decibels were lost, megabytes are those of the tensors, milliseconds those "
        "of deforming and drawing one picture.",
        table_of(
            record["choices"],
            ("", lambda choice: choice["name"]),
            ("kept", lambda choice: choice["kept"]),
            ("tried (validation PSNR, dB)", tried),
            ("dB", change(lambda before, after: f"{after['psnr'] - before['psnr']:+.3f}")),
            ("MB", change(lambda before, after: f"{before['megabytes']:.2f} → {after['megabytes']:.2f}")),
            ("ms", change(lambda before, after: f"{before['milliseconds']:.2f} → {after['milliseconds']:.2f}")),
        ),
    ]
