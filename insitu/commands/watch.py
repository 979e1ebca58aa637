"""`insitu watch`: a folder that a simulation writes into."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from insitu.commands import shell
from insitu.commands.reading import Looks, ReadingOptions, listed, reading_options
from insitu.commands.shell import command, fail_on, how_to_run

if TYPE_CHECKING:
    from catalogs.progress import ProgressLine
    from insitu.ensembles.watch import WatchOptions
    from insitu.members.planning import PlanOptions

SECONDS = click.FloatRange(min=0)


@click.command()
@click.argument("folder", type=shell.PATH)
@click.option(
    "--pattern",
    help="Paths below FOLDER that name the parameters: 'run_{Re}/dump_{time}.vti'; with --reader files may say others.",
)
@shell.CATALOG
@shell.SCENE
@shell.APPEARANCE
@reading_options
@shell.SIZE
@shell.DECIBELS
@click.option(
    "--settle", type=SECONDS, default=2.0, show_default=True, help="Seconds after which an unchanged file is whole."
)
@click.option(
    "--marker", default="", metavar=".done", help="A file is whole when one with this ending more lies beside it."
)
@click.option(
    "--patience", type=SECONDS, default=60.0, show_default=True, help="Seconds to try a file that can't be read."
)
@click.option("--once", is_flag=True, help="Render what is there, and end.")
@click.option(
    "--until-idle", type=SECONDS, metavar="SECONDS", help="End when nothing has come for so long.  [default: never]"
)
@shell.EXISTING
@shell.NAN
@shell.WORKERS
@shell.BACKEND
@shell.NO_COARSE_FIELD
def watch(
    folder: Path,
    pattern: str | None,
    catalog: Path,
    scene: Path | None,
    appearance: Path | None,
    size: int | None,
    target_decibels: float | None,
    settle: float,
    marker: str,
    patience: float,
    once: bool,
    until_idle: float | None,
    existing: Any,
    workers: int | None,
    backend: str | None,
    no_coarse_field: bool,
    **reading: Any,
) -> None:
    """Render the dumps in FOLDER as a simulation writes them.

    A dump is taken when it is whole: unchanged for --settle seconds, renamed into place, or marked.  Ctrl-C and SIGTERM end the
    watch; the same command goes on, and members that are stored are skipped.  A new catalog needs --bounds of every parameter.

    With --reader adios2 and no pattern, FOLDER is a BP folder that is being written, or an SST stream, NAME.sst.  Its steps are
    rendered as they arrive, until the writer closes it.
    """
    with command() as line:
        from catalogs.vocabulary.appearance import shown_fields
        from insitu.ensembles.watch import WatchOptions, space_for

        looks = Looks.of(catalog, scene, appearance, size, target_decibels)
        appearances = looks.appearances or looks.catalog_appearances
        if not appearances:
            raise ValueError(
                f"a new catalog needs --appearance FILE (`insitu probe` on a dump suggests one); {catalog} does not exist"
            )
        options = ReadingOptions(**reading)
        if ignored := [name for name in ("parameters", "names", "split") if getattr(options, name)]:
            raise ValueError(f"a watch takes parameters from paths and files: leave --{ignored[0]} out")
        if pattern is None and options.reader != "adios2":
            raise ValueError(
                "please give --pattern, paths that name the parameters; only --reader adios2 follows one stream"
            )
        if pattern is not None and not folder.is_dir():
            raise ValueError(f"there is no folder {folder}")
        space = space_for(
            catalog, pattern or "", options.ranges, listed(options.units), more_in_files=bool(options.reader)
        )
        options = options.as_in(looks.catalog.plan if looks.catalog else None)
        options = replace(options, arrays=options.arrays or tuple(filter(None, shown_fields(appearances))))
        plan, nan = looks.options(space, options), options.nan or "refuse"
        coarse_field = plan.coarse_field and not no_coarse_field
        plan = replace(plan, coarse_field=coarse_field, backend=backend or plan.backend)
        if pattern is None:
            _follow(line, folder, catalog, plan, options, until_idle, existing, nan)
            return
        watching = WatchOptions(folder, pattern, settle, marker, patience, 0.0 if once else until_idle, space.names)
        how = {**how_to_run(line, workers, None), "nan": nan, "existing": existing}
        _watch(line, watching, catalog, plan, options, how)


def _watch(
    line: ProgressLine,
    watching: WatchOptions,
    catalog: Path,
    plan: PlanOptions,
    options: ReadingOptions,
    how: dict[str, Any],
) -> None:
    """Watch a folder for files; `how` is handed to `watch_folder`."""
    from insitu.ensembles.files import FileEnsemble
    from insitu.ensembles.watch import Arrivals, watch_folder
    from insitu.readers.states import files_beside, states_of

    assert plan.space is not None
    reader, sampling = options.reader, options.sampling
    ensemble = FileEnsemble({}, plan.space, options.arrays, options.location, reader, sampling)
    watching = replace(
        watching,
        members=lambda row: states_of(row, reader, sampling, watching.parameters, options.arrays),
        beside=lambda path: files_beside(path, reader, sampling),
    )
    how.pop("shard")
    arrivals = Arrivals(watching)
    try:
        watch_folder(catalog, watching, ensemble, plan, arrivals=arrivals, say=line.say, **how)
    except KeyboardInterrupt:
        line.say("ended; the same command goes on from here")
    _report(line, catalog, arrivals.failures)


def _follow(
    line: ProgressLine,
    path: Path,
    catalog: Path,
    plan: PlanOptions,
    options: ReadingOptions,
    until_idle: float | None,
    existing: Any,
    nan: str,
) -> None:
    """Follow one file that is being written, or a stream."""
    from insitu.ensembles.stream import StreamResult, render_stream
    from insitu.readers.adios import follow

    result = StreamResult()
    existing = "skip" if existing == "error" else existing
    how: dict[str, Any] = {"arrays": options.arrays, "location": options.location, "nan": nan, "existing": existing}
    try:
        steps = follow(path, options.arrays, until_idle)
        warn = how_to_run(line, None, None)["warn"]
        render_stream(catalog, steps, plan, **how, arrived=result, say=line.say, warn=warn)
    except KeyboardInterrupt:
        line.say("ended; the same command goes on from here, with what the writer still holds")
    _report(line, catalog, result.failures)


def _report(line: ProgressLine, catalog: Path, failures: Mapping[str, str]) -> None:
    """Print the number of members; one stored just before the end does not count as a failure, although it was one earlier."""
    from catalogs.store.catalog import Catalog
    from catalogs.vocabulary.words import plural
    from insitu.members.planning import is_catalog

    line.close()
    names = {path.name for path in Catalog.open(catalog).member_paths()} if is_catalog(catalog) else set()
    click.echo(f"{catalog}: {plural(len(names), 'member')}")
    fail_on({name: why for name, why in failures.items() if name not in names})
