"""Means and standard deviations over seeds as tables: in a report, on a page of their own, and on a terminal."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from catalogs import durable
from catalogs.variations import KINDS
from surrogate.evaluation.scoring import METRICS
from surrogate.evaluation.tables import HEADINGS, metric_number, spread_number, table
from surrogate.studies.repeats.records import FOLDER, Scores
from surrogate.studies.repeats.spread import summarize_repeats

PAGE = "seeds.md"


def repeats_section(record: Mapping[str, Any] | None, scene: str) -> list[str]:
    """Lines of Markdown from a `summarize_repeats` record; none without one."""
    if record is None:
        return []
    lines = [
        f"## Mean ± standard deviation over {len(record['seeds'])} seeds",
        "",
        f"{_introduction(record)}",
        "",
        *spread_table(record, ("views", "parameters")),
        "",
    ]
    for varied in record["variations"]:
        names = KINDS[varied["kind"]].plural
        lines += [f"The {names} beside the appearance `{varied['base']}`, at unseen views:", ""]
        lines += [*spread_table(varied, (names, "parameters")), ""]
    return [*lines, f"<sub>{made_by(record, scene)}</sub>", ""]


def spread_table(record: Mapping[str, Any], names: tuple[str, str]) -> list[str]:
    """A row for each cell; `names` head what its rows and columns are."""
    return table(
        (*names, *(HEADINGS[metric] for metric in METRICS), "images"),
        (
            (
                first.split("_")[0],
                second.split("_")[0],
                *(spread_number(metric, record[metric][first][second]) for metric in METRICS),
                str(count),
            )
            for first, columns in record["images"].items()
            for second, count in columns.items()
        ),
    )


def made_by(record: Mapping[str, Any], scene: str) -> str:
    """What made the numbers, where, and from which code."""
    machines = [f"{machine['processor']}, {machine['cores']} cores" for machine in record["machines"]]
    count = len(record["seeds"])
    return f"`surrogate repeat scenes/{scene}.toml --seeds {count}`; {'; '.join(machines)}; commit {', '.join(record['commits'])}"


def write_page(run: Path, scene: str, scores: Sequence[Scores]) -> Path | None:
    """Write the table of a scene into its folder of results; None where there are fewer than two seeds."""
    record = summarize_repeats(scores)
    if record is None:
        return None
    lines = [f"# {scene}", "", *repeats_section(record, scene), *_seed_table(scores), ""]
    durable.make_folder(run / FOLDER)
    durable.replace(run / FOLDER / PAGE, "\n".join(lines).encode())
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
        f"deviations (n - 1).  Training took {_plain(seconds, 0)} s; {_plain(gaussians, 0)} Gaussians, {_plain(megabytes, 2)} MB."
    )


def _plain(spread: Mapping[str, float], digits: int) -> str:
    return f"{spread['mean']:,.{digits}f} ± {spread['deviation']:,.{digits}f}"


def _seed_table(scores: Sequence[Scores]) -> list[str]:
    """Each seed, at unseen views and parameters."""
    at = ("unseen_views", "unseen_parameters")
    return [
        "Each seed, at unseen views and unseen parameters:",
        "",
        *table(
            ("seed", *(HEADINGS[metric] for metric in METRICS), "Gaussians", "MB", "training (s)", "commit"),
            (
                (
                    str(one.seed),
                    *(metric_number(metric, one.cells[metric][at[0]][at[1]]) for metric in METRICS),
                    f"{one.gaussians:,}",
                    f"{one.megabytes:.2f}",
                    f"{one.seconds:.0f}",
                    one.provenance.commit,
                )
                for one in scores
            ),
        ),
    ]
