"""Means and standard deviations over seeds as tables: in a report, on a page of their own, and on a terminal."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from catalogs.files import durable
from catalogs.vocabulary.variations import KINDS
from research.studies.repeats.records import FOLDER, Scores
from research.studies.repeats.spread import summarize_repeats
from surrogate.evaluation.scoring import METRICS
from surrogate.evaluation.tables import (
    HEADINGS,
    cell_table,
    document,
    metric_number,
    number,
    plain_spread,
    spread_number,
    table_of,
)
from surrogate.provenance import in_words

PAGE = "seeds.md"


def repeats_section(record: Mapping[str, Any] | None, source: str) -> list[str]:
    """Blocks of Markdown from a `summarize_repeats` record of a scene or a run; none without one."""
    if record is None:
        return []
    blocks = [
        f"## Mean ± standard deviation over {len(record['seeds'])} seeds",
        _introduction(record),
        cell_table(record, ("views", "parameters"), METRICS, spread_number),
    ]
    for varied in record["variations"]:
        names = KINDS[varied["kind"]].plural
        blocks += [
            f"The {names} beside the appearance `{varied['base']}`, at unseen views:",
            cell_table(varied, (names, "parameters"), METRICS, spread_number),
        ]
    return [*blocks, f"<sub>{made_by(record, source)}</sub>"]


def made_by(record: Mapping[str, Any], source: str) -> str:
    """What made the numbers, where, and from which code."""
    machines = [in_words(machine) for machine in record["machines"]]
    count = len(record["seeds"])
    return f"`surrogate repeat {source} --seeds {count}`; {'; '.join(machines)}; commit {', '.join(record['commits'])}"


def write_page(run: Path, name: str, source: str, scores: Sequence[Scores]) -> Path | None:
    """Write the table of the scene or run that is the `source` into its folder of results; None for fewer than two seeds."""
    record = summarize_repeats(scores)
    if record is None:
        return None
    durable.make_folder(run / FOLDER)
    durable.replace(
        run / FOLDER / PAGE, document(f"# {name}", *repeats_section(record, source), *_seeds(scores)).encode()
    )
    return run / FOLDER / PAGE


def terminal_lines(record: Mapping[str, Any]) -> list[str]:
    """The spread of PSNR and SSIM in every cell that has images, for a terminal."""
    lines = list(_terminal_rows(record, ""))
    for varied in record["variations"]:
        lines += _terminal_rows(varied, f"{KINDS[varied['kind']].plural}: ")
    return lines


def _terminal_rows(record: Mapping[str, Any], prefix: str) -> Iterable[str]:
    for first, columns in record["images"].items():
        for second, count in columns.items():
            if count:
                label = f"{prefix}{first}, {second}".replace("_", " ")
                psnr, ssim = (spread_number(metric, record[metric][first][second]) for metric in ("psnr", "ssim"))
                yield f"{label:<58} {psnr:>15} dB   SSIM {ssim}"


def _introduction(record: Mapping[str, Any]) -> str:
    gaussians, megabytes, seconds = (record[name] for name in ("gaussians", "megabytes", "seconds"))
    return (
        f"The same training with the seeds {', '.join(map(str, record['seeds']))}, on the same test images; sample standard "
        f"deviations (n - 1).  "
        f"Training took {plain_spread(seconds, 0)} s; {plain_spread(gaussians, 0)} Gaussians, {plain_spread(megabytes, 2)} MB."
    )


def _seeds(scores: Sequence[Scores]) -> list[str]:
    """Each seed, at unseen views and parameters."""

    def at(metric: str) -> Any:
        return lambda one: metric_number(metric, one.cells[metric]["unseen_views"]["unseen_parameters"])

    return [
        "Each seed, at unseen views and unseen parameters:",
        table_of(
            scores,
            ("seed", lambda one: str(one.seed)),
            *((HEADINGS[metric], at(metric)) for metric in METRICS),
            ("Gaussians", lambda one: f"{one.gaussians:,}"),
            ("MB", lambda one: f"{one.megabytes:.2f}"),
            ("training (s)", lambda one: f"{one.seconds:.0f}"),
            ("of all cores (s)", lambda one: number(one.processor_seconds, 0)),
            ("commit", lambda one: one.provenance.commit),
        ),
    ]
