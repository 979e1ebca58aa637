"""`report.md`: what `report.json` holds, for people."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from catalogs.version import UNKNOWN
from surrogate.evaluation.tables import (
    HEADINGS,
    cell_table,
    document,
    lead,
    metric_column,
    number,
    signed_number,
    table,
    table_of,
    timing_row,
    validation_line,
)
from surrogate.model.representation import FIELD
from surrogate.provenance import in_words
from surrogate.report.emulated import numbers_section, own_name, representations_section
from surrogate.report.figures import MORE, STRIP, WHERE
from surrogate.report.members import BLOCKS
from surrogate.report.outlook import lengths_line
from surrogate.report.variations import SHOWN, center_row, variation_section
from surrogate.report.verdict import BELIEVED, FOREGROUND

CAPTIONS = {
    WHERE: "What matters: how much the colours of pictures would change over a parameter's range at the rate measured at some "
    "members, white to black being 100 %.  `surrogate ask matters RUN` shows where in a picture, and over all parameters.",
    MORE: "`surrogate ask next RUN -n 8` suggests further runs.",
}


def page(record: Mapping[str, Any], pictures: Mapping[str, str]) -> str:
    """The page of a report; `pictures` are file names by title."""
    before, varied = ((STRIP, WHERE, MORE), [title for title in pictures if title not in (STRIP, WHERE, MORE)])
    return document(
        f"# {record['scene']}",
        record["verdict"],
        _ensemble(record.get("ensemble")),
        *(block for title in before for block in _picture(title, pictures)),
        lengths_line(record["outlook"]),
        "## How close",
        cell_table(
            {**record, "one_in_ten": record["one_in_ten"][FOREGROUND]},
            ("views", "parameters"),
            (FOREGROUND, "one_in_ten", "psnr", "ssim"),
        ),
        empty_line(record),
        f"{validation_line(record, '')}  `report.json` has MS-SSIM, LPIPS and FLIP, where they could be computed.",
        "## Beside simple predictions",
        *_baselines(record),
        *representations_section(record),
        *numbers_section(record),
        *(block for one in record["variations"] for block in variation_section(one)),
        *(block for title in varied for block in _picture(title, pictures)),
        "## How fast, how large",
        _costs(record),
        "## Definitions",
        "\n".join(f"- **{name}**: {text}." for name, text in _definitions(record)),
        f"<sub>{_code(record)}, {in_words(record['machine'])}, seed {record['seed']}, {record['made']}.</sub>",
    )


def _code(record: Mapping[str, Any]) -> str:
    """The commit or, of installed packages, their version."""
    if record["commit"] == UNKNOWN and "version" in record:
        return f"Version {record['version']}"
    return f"Commit `{record['commit']}`"


def _picture(title: str, pictures: Mapping[str, str]) -> list[str]:
    """A picture under its heading, with what it takes to read it; empty where there is none."""
    if title not in pictures:
        return []
    return [f"## {title}", CAPTIONS.get(title, ""), f"![{title}]({pictures[title]})"]


def _definitions(record: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    """The meaning of the columns, and of words in the first paragraph."""
    for metric in ("psnr", FOREGROUND, "ssim", "covered"):
        if metric in record["definitions"]:
            yield HEADINGS[metric].removesuffix(" (dB)"), record["definitions"][metric]
    yield (
        "structures, colours, fine detail",
        f"averages over blocks of 1/{BLOCKS} of a picture's side as grey and as colours, and what they leave; believed where the "
        f"squared error is at most {_percent('structures')}, {_percent('colours')} and {_percent('details')} of that of the mean "
        "image (Murphy 1988)",
    )
    yield (
        "a range of parameters",
        "named where it holds all members meant, and chance would put them there in less than 5 % of cases",
    )


def _percent(aspect: str) -> str:
    return f"{100.0 * (1.0 - BELIEVED[aspect]):.0f} %"


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

    unseen = ("unseen_views", "unseen_parameters")

    def ahead(entry: Mapping[str, Any]) -> str:
        psnr, other = (one[FOREGROUND]["unseen_views"]["unseen_parameters"] for one in (record, entry))
        return "" if entry is own else signed_number(lead(psnr, other))

    own = {**record, "name": own_name(record)}
    borrowed = max(entry["borrowed_view_degrees"] for entry in entries)
    return [
        "At unseen views and parameters.  Simple predictions mix the training members' pictures of the same view.  The lead is the "
        "surrogate's, of the foreground (negative: behind).",
        table_of(
            [own, *entries, *center_row(record)],
            ("", lambda entry: entry["name"]),
            *(metric_column(HEADINGS[metric], metric, *unseen) for metric in SHOWN),
            ("lead (dB)", ahead),
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
    rendering = seconds["dataset"]
    return table(
        ("", ""),
        [
            *([] if rendering is None else [("making the data set", f"{number(rendering, 0)} s")]),
            ("training", f"{number(seconds['train'], 0)} s{processor}, {steps} steps"),
            ("model", f"{record['gaussians']:,} Gaussians, {record['model_megabytes']:.2f} MB{_emulator_size(record)}"),
            timing_row(record, "parameter_change", "a parameter change"),
            timing_row(record, "view_change", "a view change"),
        ],
    )


def _emulator_size(record: Mapping[str, Any]) -> str:
    scores = record.get("representations")
    return "" if scores is None else f"; emulated fields, {scores['megabytes'][FIELD]:.2f} MB"
