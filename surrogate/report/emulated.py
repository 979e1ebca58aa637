"""The sections of a report on what emulated fields add: numbers with their errors, and which representation draws."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict
from typing import Any

from catalogs.store.catalog import Catalog
from catalogs.vocabulary.quantity import label
from catalogs.vocabulary.variations import KINDS
from surrogate.emulation.measures import SHARE
from surrogate.evaluation.cases import PARAMETERS, VALIDATION
from surrogate.evaluation.evaluate import Baseline, Evaluation, measured_row
from surrogate.evaluation.numbers import PLACES, VALUES
from surrogate.evaluation.scoring import Scored, mean
from surrogate.evaluation.tables import NOTHING, number, table
from surrogate.model import Surrogate
from surrogate.model.representation import DRAWN, FUNCTION, VIEW
from surrogate.training.other_functions import scores_under_other_functions

TEST, LEFT_OUT = "test", "left_out"
TITLES = {VALUES: f"values at {PLACES:,} places", SHARE: "share above a level"}


def representations_record(surrogate: Surrogate, catalog: Catalog, evaluation: Evaluation) -> dict[str, Any] | None:
    """Scores, sizes and speeds of a surrogate's representations, and which draws; None where it is drawn by Gaussians alone.

    Scores under transfer functions that no image shows are those beside the members' coarse fields.
    """
    if surrogate.field is None:
        return None
    scores = surrogate.scores
    tested = {VIEW: _tested(surrogate, VIEW, evaluation.cells["unseen_views"], evaluation.baselines, "unseen_views")}
    for varied in evaluation.variations:
        kind, row = varied.variation.kind, measured_row(varied.variation)
        tested[kind] = _tested(surrogate, kind, varied.cells[row], varied.baselines, "unseen_parameters")
    beside_fields = FUNCTION not in tested and FUNCTION in scores.psnr
    if beside_fields:
        tested[FUNCTION] = scores_under_other_functions(surrogate, catalog, PARAMETERS["unseen_parameters"])
    return {
        "drawn_by": {kind: surrogate.representation(kind) for kind in tested},
        "named": surrogate.only,
        LEFT_OUT: scores.left_out,
        "beside_fields": [FUNCTION] if beside_fields else [],
        "psnr": {
            kind: {
                name: {VALIDATION: scores.psnr.get(kind, {}).get(name), TEST: of_kind.get(name)}
                for name in surrogate.representations
            }
            for kind, of_kind in tested.items()
        },
        "megabytes": surrogate.sizes,
        "milliseconds": dict(scores.milliseconds),
    }


def _tested(
    surrogate: Surrogate,
    kind: str,
    cells: Mapping[str, Sequence[Scored]],
    baselines: Sequence[Baseline],
    group: str,
) -> dict[str, float]:
    """Mean PSNR on test images at unseen parameters, by representation."""
    scored = {b.representation: b.scores.get(group, ()) for b in baselines if b.representation}
    scored[surrogate.representation(kind)] = cells["unseen_parameters"]
    means = {name: mean(images, "psnr") for name, images in scored.items()}
    return {name: psnr for name, psnr in means.items() if psnr is not None}


def drawn_words(surrogate: Surrogate, kind: str) -> str:
    """The representation that draws a kind of question, and its size; "" where there are Gaussians alone."""
    name = surrogate.representation(kind)
    return "" if surrogate.field is None else f"drawn {DRAWN[name]}, {surrogate.sizes[name]:.2g} MB"


def own_name(record: Mapping[str, Any]) -> str:
    """The surrogate's name in tables of predictors."""
    return f"**surrogate**{', ' * bool(record.get('drawn'))}{record.get('drawn', '')}"


def numbers_record(evaluation: Evaluation) -> list[dict[str, Any]]:
    """Errors of emulated numbers, by field."""
    return [asdict(field) for field in evaluation.numbers]


def representations_section(record: Mapping[str, Any]) -> list[str]:
    """The blocks of Markdown on which representation draws, and why; empty where there is only one kind."""
    scores = record.get("representations")
    if scores is None:
        return []
    of = "left-out members" if scores.get(LEFT_OUT) else "validation"
    header = ("", "drawn", f"PSNR, {of}", "PSNR, unseen parameters", "MB", "ms a picture")
    return ["## How it is drawn", table(header, _rows(scores)), "  \n".join(_reasons(scores))]


def _rows(scores: Mapping[str, Any]) -> Iterator[list[str]]:
    for kind, by_name in scores["psnr"].items():
        best = {
            column: max((of[column] for of in by_name.values() if of[column] is not None), default=None)
            for column in (VALIDATION, TEST)
        }
        for name, of in by_name.items():
            cells = [_bold(number(of[column]), of[column] == best[column] is not None) for column in best]
            milliseconds = scores["milliseconds"].get(name)
            speed = NOTHING if milliseconds is None else f"{milliseconds:.3g}"
            yield [_title(kind, scores), DRAWN[name], *cells, f"{scores['megabytes'][name]:.2g}", speed]


def _reasons(scores: Mapping[str, Any]) -> Iterator[str]:
    """A sentence for each kind of question: which representation draws, and what decided that."""
    for kind, chosen in scores["drawn_by"].items():
        validation = {n: of[VALIDATION] for n, of in scores["psnr"][kind].items() if of[VALIDATION] is not None}
        others = {n: psnr for n, psnr in validation.items() if n != chosen}
        text = f"{_title(kind, scores).capitalize()} are drawn {DRAWN[chosen]}"
        if scores["named"]:
            yield f"{text}, as was asked for."
        elif len(scores["psnr"][kind]) == 1:
            yield f"{text}: nothing else was trained."
        elif chosen in validation and not others:
            yield f"{text}: it shows members that it was fitted without better than the Gaussians that learnt from them."
        elif chosen not in validation:
            yield f"{text}: no validation image tells which is better."
        else:
            next_best = max(others, key=lambda name: others[name])
            ahead = validation[chosen] - others[next_best]
            yield f"{text}: on validation images that is {ahead:.2f} dB better than {DRAWN[next_best]}."


def _title(kind: str, scores: Mapping[str, Any]) -> str:
    if kind in scores["beside_fields"]:
        return "transfer functions that no image shows"
    return "views" if kind == VIEW else KINDS[kind].plural


def _bold(text: str, is_best: bool) -> str:
    return f"**{text}**" if is_best else text


def numbers_section(record: Mapping[str, Any]) -> list[str]:
    """The blocks of Markdown on errors of emulated numbers; empty without any."""
    fields = record.get("numbers") or []
    if not fields:
        return []
    rows = [
        [
            label(field["name"], field["unit"]) or "the field",
            f"share above {field['level']:.4g}" if name == SHARE else TITLES.get(name, name),
            f"{error['error']:.3g}",
            NOTHING if error["relative"] is None else f"{error['relative']:.3g}",
            f"{100.0 * error['inside']:.0f} %",
            str(error["members"]),
        ]
        for field in fields
        for name, error in field["errors"].items()
    ]
    return [
        "## Numbers",
        "Of the emulated fields, beside the coarse fields of test members: at random places, and of the whole box.  The error is "
        "the mean over members, of values their root mean square, in the field's unit; the relative one is over the standard "
        "deviation of all values that were learnt.",
        table(("field", "number", "error", "relative error", "in 90 % intervals", "members"), rows),
    ]


def numbers_lines(record: Mapping[str, Any]) -> Iterator[str]:
    """A line on the values of each field, for a terminal."""
    for field in record.get("numbers") or []:
        values = field["errors"].get(VALUES)
        if values and values["relative"] is not None:
            name = label(field["name"], field["unit"]) or "the field"
            inside = f"{100.0 * values['inside']:.0f} % lie in 90 % intervals"
            yield f"values of {name}, unseen parameters: relative error {values['relative']:.3g}, {inside}"
