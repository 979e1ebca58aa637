"""The results of an ablation as a page with a table and a plot."""

from __future__ import annotations

from collections.abc import Sequence
from io import BytesIO
from pathlib import Path

from catalogs.files import durable
from research.studies.ablation.comparison import SURE, VariantRow
from research.studies.ablation.records import TIME_TOLERANCE
from research.studies.ablation.variants import DEFAULT, VARIANTS, VISUALIZATION_VARIANTS
from surrogate.evaluation.tables import NOTHING, document, number, table, table_of

ORDER = (*VARIANTS, *VISUALIZATION_VARIANTS)
PAGE, PICTURE = "ablation.md", "ablation.png"
WIDTH_INCHES, ROW_INCHES = 8.0, 0.26
RESOLUTION = 130
SURE_COLOR, OTHER_COLOR, DEFAULT_COLOR = "tab:red", "0.45", "tab:blue"


def write(scene: str, folder: Path, budget: float, rows: Sequence[VariantRow]) -> None:
    """Write the page and its plot into `folder`, if there are any rows."""
    if not rows:
        return
    drawn = plot(rows)
    if drawn is not None:
        durable.replace(folder / PICTURE, drawn)
    durable.replace(folder / PAGE, page(scene, budget, rows, drawn is not None).encode())


def plot(rows: Sequence[VariantRow]) -> bytes | None:
    """PSNR by variant as PNG, the best on top, with a bar at each mean; None without any result."""
    from matplotlib.figure import Figure

    shown = [row for row in rows if row.results]
    if not shown:
        return None
    figure = Figure(figsize=(WIDTH_INCHES, 1.2 + ROW_INCHES * len(shown)), layout="constrained")
    axes = figure.add_subplot()
    for place, row in enumerate(shown):
        color = DEFAULT_COLOR if row.variant.name == DEFAULT else SURE_COLOR if row.is_sure else OTHER_COLOR
        axes.plot([r.psnr for r in row.results], [place] * len(row.results), "o", color=color, markersize=4, alpha=0.8)
        axes.plot([row.mean("psnr")], [place], "|", color=color, markersize=11, markeredgewidth=1.5)
        if row.variant.name == DEFAULT:
            axes.axvline(row.mean("psnr"), color=color, linewidth=0.8, alpha=0.6, zorder=0)
    axes.set_yticks(range(len(shown)), [row.variant.name for row in shown], fontsize=8)
    axes.set_ylim(len(shown) - 0.5, -0.5)
    axes.grid(axis="x", linewidth=0.4, alpha=0.5)
    axes.set_xlabel("PSNR of validation images, dB", fontsize=9)
    axes.set_title("a dot per seed, a bar at their mean; red: differs by more than two standard errors", fontsize=8)
    content = BytesIO()
    figure.savefig(content, format="png", dpi=RESOLUTION, facecolor="white")
    return content.getvalue()


def page(scene: str, budget: float, rows: Sequence[VariantRow], pictured: bool) -> str:
    """The page in Markdown."""
    done = [row for row in rows if row.results]
    return document(
        f"# What each choice of training is worth: {scene}",
        _introduction(budget, done) if done else "",
        table_of(done, *COLUMNS),
        " ".join([verdict(rows), *equal_steps(rows), *unequal_times(rows)]),
        f"![PSNR of every seed]({PICTURE})" if pictured else "",
        _failures(rows),
        "Why each is there:",
        "\n".join(
            f"- {row.variant.name}: {row.variant.why}" for row in sorted(rows, key=lambda row: ORDER.index(row.variant))
        ),
        _made_by(scene, budget, rows),
    )


def verdict(rows: Sequence[VariantRow]) -> str:
    """The significant differences, in a sentence."""
    compared = [row for row in rows if row.reference == DEFAULT and not row.variant.steps_of]
    sure = [f"{row.variant.name} ({row.difference:+.2f} dB)" for row in compared if row.is_sure]
    if all(row.error is None for row in compared):
        return "No difference is distinguishable from chance yet: that takes two seeds of the default and of a variant."
    if not sure:
        return f"No difference from the default exceeds {SURE:g} of its standard errors."
    return f"The difference from the default exceeds {SURE:g} of its standard errors for {', '.join(sure)}."


def equal_steps(rows: Sequence[VariantRow]) -> list[str]:
    """A sentence for each variant that took the steps of another."""
    return [
        f"After equally many steps ({row.mean('steps'):,.0f}), {row.variant.name} differs from {row.reference} by "
        f"{row.difference:+.2f}{_plus_minus(row.error)} dB."
        for row in rows
        if row.variant.steps_of and row.difference is not None
    ]


def unequal_times(rows: Sequence[VariantRow]) -> list[str]:
    """A sentence naming the fits whose time was too far from the budget for a fair comparison."""
    timed = [result for row in rows for result in row.results if not row.variant.steps_of]
    off = [f"{r.variant} seed {r.seed} ({r.seconds:,.1f} s)" for r in timed if not r.is_timely]
    if not off:
        return []
    return [
        f"More than {100 * TIME_TOLERANCE:.0f} % from the budget, and to be compared with care (`--again` fits them again): "
        f"{', '.join(off)}."
    ]


def _introduction(budget: float, done: Sequence[VariantRow]) -> str:
    chosen = "Nothing was fitted to need" + (
        "; F_sim is that of the finished surrogate" if _is_of_visualization(done) else ""
    )
    images = sorted({result.images for row in done for result in row.results})
    return (
        f"Each variant was trained for {budget:g} s of processor time per seed, from its first image to its last step, with as "
        "many steps as fit into that by its own speed, and then shown "
        f"{' or '.join(map(str, images))} validation images that none learns from (test images are not touched). "
        f"{chosen}. PSNR: mean ± standard deviation over seeds. Difference: from the default "
        "(or as said), ± its standard error; with few seeds that is itself uncertain, and of many variants that differ by "
        "nothing some exceed two of them."
    )


def _is_of_visualization(rows: Sequence[VariantRow]) -> bool:
    return any(row.variant in VISUALIZATION_VARIANTS for row in rows)


def decibels_cell(row: VariantRow) -> str:
    """PSNR and its standard deviation over seeds."""
    return number(row.psnr) + _plus_minus(row.spread)


def difference_cell(row: VariantRow) -> str:
    """The difference in dB from the row's reference with its standard error, naming any reference other than the default."""
    if row.difference is None:
        return NOTHING
    otherwise = f" from {row.reference}" if row.variant.steps_of else ""
    return f"{row.difference:+.2f}{_plus_minus(row.error)}{otherwise}"


def _plus_minus(value: float | None) -> str:
    return "" if value is None else f" ± {value:.2f}"


def _failures(rows: Sequence[VariantRow]) -> str:
    lines = []
    for row in rows:
        for error in dict.fromkeys(result.error for result in row.failures):
            seeds = ", ".join(str(result.seed) for result in row.failures if result.error == error)
            lines.append((row.variant.name, seeds, error.replace("|", "/")))
    return table(("no result", "seeds", "because"), lines) if lines else ""


def _made_by(scene: str, budget: float, rows: Sequence[VariantRow]) -> str:
    results = [result for row in rows for result in row.results]
    machines = dict.fromkeys(", ".join(map(str, result.provenance.machine.values())) for result in results)
    commits = dict.fromkeys(result.provenance.commit for result in results)
    of = " --visualization" if _is_of_visualization(rows) else ""
    return (
        f"<sub>`python -m research.studies ablate scenes/{scene}.toml{of} --seconds {budget:g}`; {'; '.join(machines)}; commit "
        f"{', '.join(commits)}</sub>"
    )


COLUMNS = (
    ("variant", lambda row: f"**{row.variant.name}**" if row.variant.name == DEFAULT else row.variant.name),
    ("changed", lambda row: row.variant.what),
    ("PSNR, dB", decibels_cell),
    ("difference, dB", difference_cell),
    ("SSIM", lambda row: number(row.mean("ssim"), 4)),
    ("steps", lambda row: f"{row.mean('steps'):,.0f}"),
    ("seconds", lambda row: f"{row.mean('seconds'):,.1f}"),
    ("Gaussians", lambda row: f"{row.mean('gaussians'):,.0f}"),
    ("seeds", lambda row: str(len(row.results))),
)
