"""Means and standard deviations over seeds: on a page of their own, and on a terminal."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from catalogs.files import durable
from catalogs.vocabulary.variations import KINDS
from research.studies.repeats.seeds import FOLDER, Scores, seeds_section, summarize_repeats
from surrogate.evaluation.scoring import METRICS
from surrogate.evaluation.tables import HEADINGS, document, metric_number, number, spread_number, table_of

PAGE = "seeds.md"


def write_page(run: Path, name: str, source: str, scores: Sequence[Scores]) -> Path | None:
    """Write the table of the scene or run `source` into its folder of results; None for fewer than two seeds."""
    record = summarize_repeats(scores)
    if record is None:
        return None
    command = f"<sub>`python -m research.studies repeat {source} --seeds {len(scores)}`</sub>"
    page = document(f"# {name}", *seeds_section(record), *_seeds(scores), command)
    durable.make_folder(run / FOLDER)
    durable.replace(run / FOLDER / PAGE, page.encode())
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
