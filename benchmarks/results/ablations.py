"""The tables of what each choice of training is worth, in groups of variants that answer one question."""

from __future__ import annotations

from collections.abc import Sequence

from benchmarks.results.studies import StudyResults
from surrogate.evaluation.tables import number, table_of
from surrogate.studies.ablation.comparison import Row
from surrogate.studies.ablation.table import decibels_cell, difference_cell, equal_steps, unequal_times, verdict
from surrogate.studies.ablation.variants import DEFAULT, Variant

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
DESIGNS = {"deformation", "visualization_deformation"}
SIZES = {"gaussians", "latent_size", "visualization_latent_size", "value_bins"}
GROUPS = ("reference", "deformation field", "start", "training strategy", "size")


def group_of(variant: Variant) -> str:
    """Which question a variant answers, of `GROUPS`."""
    changed = {*variant.changes, *variant.factors}
    if variant.name == DEFAULT:
        return "reference"
    if changed & DESIGNS or variant.steps_of:
        return "deformation field"
    if "initialization" in changed:
        return "start"
    return "size" if changed <= SIZES else "training strategy"


def study_section(study: StudyResults) -> list[str]:
    """A study in Markdown: a table by groups, the best of a group first, and what it says in sentences."""
    if study.published:
        return ["\n".join(study.published["lines"])]
    rows = [row for row in study.rows if row.results]
    groups = {name: [row for row in rows if group_of(row.variant) == name] for name in GROUPS}
    places = {id(row): name for name, members in groups.items() for row in members[:1]}

    def group(row: Row) -> str:
        return f"**{places[id(row)]}**" if id(row) in places else ""

    grouped = [row for members in groups.values() for row in members]
    return [_introduction(study), table_of(grouped, ("", group), *COLUMNS), " ".join(_sentences(study.rows))]


def _introduction(study: StudyResults) -> str:
    images = sorted({result.images for result in study.results})
    return (
        f"{study.budget:g} s of processor time for each fit, as many steps as fit into that unless it takes another's; "
        f"{' or '.join(map(str, images))} validation images; nothing is fitted to need.  PSNR ± standard deviation over seeds; "
        "difference from the default, or as said, ± its standard error."
    )


def _sentences(rows: Sequence[Row]) -> list[str]:
    failed = [f"{row.variant.name} ({row.failures[0].error})" for row in rows if not row.results and row.failures]
    lost = [f"Without a result: {'; '.join(failed)}."] if failed else []
    return [verdict(rows), *equal_steps(rows), *unequal_times(rows), *lost]
