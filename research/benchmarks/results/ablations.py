"""Tables of the ablations, in groups of variants that answer one question."""

from __future__ import annotations

from collections.abc import Collection, Sequence

from research.benchmarks.results.studies import StudyResults
from research.studies.ablation.comparison import VariantRow
from research.studies.ablation.table import decibels_cell, difference_cell, equal_steps, unequal_times, verdict
from research.studies.ablation.variants import DEFAULT, Variant
from surrogate.evaluation.tables import number, table_of

COLUMNS = (
    ("variant", lambda row: row.variant.name),
    ("changed", lambda row: row.variant.what),
    ("PSNR (dB)", decibels_cell),
    ("difference (dB)", difference_cell),
    ("SSIM", lambda row: number(row.mean("ssim"), 4)),
    ("steps", lambda row: f"{row.mean('steps'):,.0f}"),
    ("seconds", lambda row: f"{row.mean('seconds'):,.0f}"),
    ("seeds", lambda row: str(len(row.results))),
)
SIZES = {"gaussians", "latent_size"}
EQUAL_TIME = (
    "In equal time the paper's field takes far fewer steps on a processor (see the column).  Those rows measure what a step of it "
    "costs, not what it can learn; only equally many steps compare the fields."
)
GROUPS = ("reference", "equal steps", "start", "training strategy", "size")


def group_of(variant: Variant) -> str:
    """The question that a variant answers, of `GROUPS`."""
    changed = {*variant.changes, *variant.factors}
    if variant.name == DEFAULT:
        return "reference"
    if variant.steps_of:
        return "equal steps"
    if "initialization" in changed:
        return "start"
    return "size" if changed <= SIZES else "training strategy"


def study_section(study: StudyResults) -> list[str]:
    """A study in Markdown: a table by groups, the best of a group first, and its conclusions."""
    if study.published:
        lines = "\n".join(study.published["lines"])
        of_paper = [EQUAL_TIME] if "| paper" in lines else []
        return [lines, " ".join([*_limits(study.kind.variants, _named_on(lines, study.kind.variants)), *of_paper])]
    rows = [row for row in study.rows if row.results]
    groups = {name: [row for row in rows if group_of(row.variant) == name] for name in GROUPS}
    places = {id(row): name for name, members in groups.items() for row in members[:1]}

    def group(row: VariantRow) -> str:
        return f"**{places[id(row)]}**" if id(row) in places else ""

    grouped = [row for members in groups.values() for row in members]
    limits = _limits(study.kind.variants, {row.variant.name for row in study.rows})
    said = " ".join([*_sentences(study.rows), *limits])
    return [_introduction(study), table_of(grouped, ("", group), *COLUMNS), said]


def _introduction(study: StudyResults) -> str:
    images = sorted({result.images for result in study.results})
    return (
        f"{study.budget:g} s of processor time for each fit, as many steps as fit into that unless it takes another's; "
        f"{' or '.join(map(str, images))} validation images; nothing is fitted to need.  PSNR ± standard deviation over seeds; "
        "difference from the default, or as said, ± its standard error."
    )


def _limits(variants: Sequence[Variant], tested: Collection[str]) -> list[str]:
    """Limits of a study of these variants, of which some are `known`."""
    missing = [variant.name for variant in variants if variant.name not in tested]
    return [f"{len(missing)} of {len(variants)} variants were not run: {', '.join(missing)}."] if missing else []


def _named_on(lines: str, variants: Sequence[Variant]) -> set[str]:
    """Names of the variants with a row on an earlier page, or listed there without a result."""
    _, _, failed = lines.partition("Without a result:")
    return {v.name for v in variants if f"| {v.name} |" in lines or f" {v.name} (" in failed}


def _sentences(rows: Sequence[VariantRow]) -> list[str]:
    failed = [f"{row.variant.name} ({row.failures[0].error})" for row in rows if not row.results and row.failures]
    lost = [f"Without a result: {each}." for each in failed]
    return [verdict(rows), *equal_steps(rows), *unequal_times(rows), *lost]
