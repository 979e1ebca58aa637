"""Types of arguments, progress and errors that all commands share."""

from __future__ import annotations

import signal
import threading
import warnings
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import click

from catalogs.commands import one_line_errors
from catalogs.progress import ProgressLine

PATH = click.Path(path_type=Path)
NAMED_FILE = click.Path(dir_okay=False, path_type=Path)  # whose absence is reported in our own words
FILE = click.Path(exists=True, dir_okay=False, path_type=Path)
NAN = click.option("--nan", type=click.Choice(["refuse", "transparent"]), help="NaN and infinity.  [default: refuse]")
WORKERS = click.option("--workers", type=click.IntRange(min=1), help="Processes; by default one per available core.")
SHARD = click.option("--shard", metavar="I/N", help="Take only every N-th member, beginning with the I-th.")
ENGINE = click.option("--engine", metavar="dask://HOST:PORT", help="Render on the workers of a Dask cluster.")
CATALOG = click.option("--catalog", required=True, type=PATH, help="The .cdb folder to write.")
SCENE = click.option("--scene", type=NAMED_FILE, help="Take appearances and views from this scene.")
APPEARANCE = click.option(
    "--appearance",
    "--appearances",
    "appearance",
    type=FILE,
    help="TOML file of [[appearance]] tables, as `insitu probe` prints them.",
)
SIZE = click.option(
    "--size", type=click.IntRange(min=1), help="Width and height of the images in pixels.  [default: 256]"
)
EXISTING = click.option(
    "--existing",
    type=click.Choice(["error", "skip", "replace"]),
    default="error",
    show_default=True,
    help="Stored members whose file has changed: name them and stop, keep them, or render them anew.",
)
NO_COARSE_FIELD = click.option(
    "--no-coarse-field", is_flag=True, help="Store images alone, without fields of 64³ samples."
)
ADD_COARSE_FIELDS = click.option(
    "--add-coarse-fields",
    is_flag=True,
    help="Give stored members that lack them fields of 64³ samples; render nothing.",
)
BACKEND = click.option(
    "--backend",
    type=click.Choice(["auto", "vtk", "cpu"]),
    help="What draws: VTK, or our own ray caster, which needs no OpenGL.  [default: cpu for volumes, vtk for isosurfaces]",
)
DECIBELS = click.option("--target-decibels", type=float, help="PSNR that volume rendering must reach.  [default: 50]")


def how_to_run(line: ProgressLine, workers: int | None, shard: str | None) -> dict[str, Any]:
    """Arguments of `run_ensemble`; `line` tells progress and warnings."""
    index, sign, count = ("1/1" if shard is None else shard).partition("/")
    if not sign or not index.isdigit() or not count.isdigit():
        raise ValueError(f"--shard takes I/N, such as 1/4, got {shard!r}")
    part = int(index), int(count)
    return {"workers": workers, "shard": part, "progress": line, "warn": lambda note: line.say(f"Warning: {note}")}


@contextmanager
def engine_at(line: ProgressLine, address: str | None, workers: int | None, folder: Path) -> Iterator[dict[str, Any]]:
    """Arguments of `run_ensemble`: the engine at `address`, whose workers see the `folder` that is written to, or none."""
    if address is not None and workers is not None:
        raise ValueError(
            "--workers are of this machine, those of --engine are as many as were started: give one of them"
        )
    from catalogs.engines.address import opened

    with opened(address, [folder], line.say) as engine:
        yield {} if engine is None else {"engine": engine}


def say_lacking(catalog: Path, command_line: str) -> None:
    """Say how members of a catalog get the coarse fields that they lack, if any do."""
    from catalogs.store.catalog import Catalog
    from insitu.ensembles.coarse import note_on_lacking

    if note := note_on_lacking(Catalog.open(catalog), command_line):
        click.echo(note)


def fail_on(failures: Mapping[str, str]) -> None:
    """End the command with an error that tells why members failed, if any did."""
    if failures:
        from catalogs.vocabulary.words import plural
        from insitu.ensembles.ensemble import failure_lines

        lines = "\n".join(failure_lines(failures))
        them = "it" if len(failures) == 1 else "them"
        raise click.ClickException(
            f"{plural(len(failures), 'member')} failed; the same command tries {them} again:\n{lines}"
        )


@contextmanager
def command() -> Iterator[ProgressLine]:
    """Run a command with a progress line; a mistake that a user can mend ends it with one plain line.

    SIGTERM, as batch systems send it, ends the work like Ctrl-C.
    """
    in_main = threading.current_thread() is threading.main_thread()  # signals are its alone
    previous = signal.signal(signal.SIGTERM, signal.default_int_handler) if in_main else None
    try:
        with (
            one_line_errors(RuntimeError, interrupted="the same command goes on from here"),
            warnings.catch_warnings(),
            ProgressLine() as line,
        ):
            warnings.showwarning = lambda message, *where, **more: line.say(f"Warning: {message}")
            yield line
    finally:
        if in_main:
            signal.signal(signal.SIGTERM, previous)
