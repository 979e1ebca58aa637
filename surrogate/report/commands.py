"""`surrogate evaluate`."""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping
from importlib import import_module
from pathlib import Path
from typing import Any

import click

from catalogs.commands import one_line_errors
from catalogs.files import durable
from catalogs.progress import ProgressLine
from surrogate.command_line import RUNS, SCENE, OpenRun, load_surrogate


@click.command()
@SCENE
@RUNS
@click.option(
    "--records",
    type=click.Path(path_type=Path),
    help="Folder where the figures of all scenes are stored.  [default: the run's folder]",
)
def evaluate(scene: Path, runs: Path, records: Path | None) -> None:
    """Write the report of the surrogate of a SCENE or a RUN: tables, pictures, report.json."""
    opened = OpenRun.open(scene, runs)
    from surrogate.model import Surrogate
    from surrogate.provenance import code
    from surrogate.report.records import is_kept, report_path, save_report
    from surrogate.report.report import is_current, write_report
    from surrogate.storage.checkpoints import fingerprint
    from surrogate.training.messages import tests_line

    if text := tests_line(opened.catalog):
        click.echo(f"  {text}")
    page = opened.folder / "report" / "report.md"
    place = opened.folder if records is None else records / opened.name, opened.settings.seed
    if not Surrogate.exists(opened.model) and is_kept(*place, fingerprint(opened.settings, opened.catalog), code()):
        click.echo(f"{report_path(*place)}: nothing to do")
        return
    surrogate = load_surrogate(opened.model)
    marks = surrogate.training["fingerprint"], surrogate.training.get("code_version", "")
    if is_current(page.parent, surrogate) and is_kept(*place, *marks):
        click.echo(f"{page}: nothing to do")
        return
    from surrogate.evaluation.evaluate import evaluate as run

    started, begun = time.perf_counter(), time.process_time()
    import_module("matplotlib")  # which draws the figures at the end
    with one_line_errors(interrupted="no report was written; run the same command to start again"):
        for folder in {opened.folder, place[0]}:
            durable.require_writable(folder)
        with ProgressLine() as line:
            evaluation = run(surrogate, opened.catalog, progress=line.count)
        seconds, judged = _dataset_seconds(opened.folder), (surrogate, opened.catalog, evaluation)
        report = write_report(
            page.parent,
            opened.name,
            *judged,
            dataset_seconds=seconds,
        )
        save_report(place[0], surrogate, opened.settings, report, time.process_time() - begun)
    for text in _summary(report):
        click.echo(f"  {text}")
    click.echo(f"{page} ({time.perf_counter() - started:.0f} s)")


def _dataset_seconds(folder: Path) -> float | None:
    from surrogate.storage.records import read_json

    seconds = (read_json(folder / "dataset.json") or {}).get("seconds")
    return float(seconds) if isinstance(seconds, int | float) else None


def _summary(report: Mapping[str, Any]) -> Iterator[str]:
    from surrogate.evaluation.tables import terminal_line
    from surrogate.report.emulated import numbers_lines
    from surrogate.report.page import empty_line
    from surrogate.report.variations import SHOWN, variation_line
    from surrogate.training.messages import UNKNOWN

    yield from report["verdict"].replace("**", "").split("\n\n")[0].split("  ")
    for views, columns in report["images"].items():
        for parameters in columns:
            foreground, psnr, ssim = (report[metric][views][parameters] for metric in SHOWN)
            if psnr is not None:
                yield terminal_line(f"{views}, {parameters}".replace("_", " "), foreground, psnr, ssim)
    if text := empty_line(report):
        yield text
    if not any(columns["unseen_parameters"] for columns in report["images"].values()):
        yield UNKNOWN
    for entry in report["trivial_predictors"]:
        foreground, psnr, ssim = (entry[metric]["unseen_views"]["unseen_parameters"] for metric in SHOWN)
        if psnr is not None:
            yield f"{terminal_line(entry['name'][:38], foreground, psnr, ssim)}   (unseen views, unseen parameters)"
    yield from map(variation_line, report["variations"])
    yield from numbers_lines(report)
