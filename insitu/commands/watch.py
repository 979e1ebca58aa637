"""`insitu watch`: a folder that a simulation writes into."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from insitu.commands import shell
from insitu.commands.reading import ReadingOptions, appearances_of, code_options, listed
from insitu.commands.shell import command, fail_on, how_to_run

if TYPE_CHECKING:
    from catalogs.progress import ProgressLine
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
@click.option("--array", "--field", "arrays", multiple=True, help="Array that holds the field; several, one by one.")
@click.option(
    "--bounds",
    type=(str, float, float),
    multiple=True,
    metavar="NAME LOW HIGH",
    help="Range of each parameter; a new catalog needs all.",
)
@click.option("--units", metavar="U,V", help="Units of the parameters, in the order of --bounds.")
@click.option(
    "--spacing", type=(float, float, float), metavar="X Y Z", help="Distance between values, if files do not say."
)
@click.option(
    "--origin", type=(float, float, float), metavar="X Y Z", help="Place of the first value, if files do not say."
)
@click.option("--dims", metavar="z,y,x", help="What the axes of arrays are, in the arrays' own order.")
@code_options
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
    nan: str,
    workers: int | None,
    **reading: Any,
) -> None:
    """Render the dumps in FOLDER as a simulation writes them.

    A dump is taken when it is whole: unchanged for --settle seconds, renamed into place, or marked.  Ctrl-C and SIGTERM end the
    watch; the same command goes on, and members that are stored are skipped.

    With --reader adios2 and no pattern, FOLDER is a BP folder that is being written, or an SST stream, NAME.sst: its steps are
    rendered as they arrive, until the writer closes it.
    """
    with command() as line:
        from catalogs.vocabulary.appearance import shown_fields
        from catalogs.vocabulary.scene import Scene, ViewPlan
        from insitu.ensembles.watch import space_for
        from insitu.members.planning import PlanOptions

        if scene is not None and (appearance is not None or size is not None or target_decibels is not None):
            raise ValueError("a scene says how to render: leave out --appearance, --size and --target-decibels")
        asked = None if scene is None else Scene.load(scene)
        given, known = appearances_of(catalog, appearance, asked)
        if not given and not known:
            raise ValueError(
                f"a new catalog needs --appearance FILE: `insitu probe` on a dump suggests one; {catalog} is none yet"
            )
        options = ReadingOptions(**reading)
        if pattern is None and options.reader != "adios2":
            raise ValueError(
                "please give --pattern, paths that name the parameters; only --reader adios2 follows one stream"
            )
        if pattern is not None and not folder.is_dir():
            raise ValueError(f"there is no folder {folder}")
        space = space_for(catalog, pattern or "", options.ranges, listed(options.units), told=bool(options.reader))
        arrays = options.arrays or tuple(filter(None, shown_fields(given or known)))
        if asked is not None:
            plan = PlanOptions.of_scene(asked, space)
        else:
            size = size or (None if known else 256)
            views = None if size is None else ViewPlan(width=size, height=size)
            plan = PlanOptions(space, given, views, target_decibels=target_decibels)
        if pattern is None:
            _follow(line, folder, catalog, plan, options, arrays, until_idle, existing, nan)
            return
        place = Place(folder, pattern, settle, marker, patience, 0.0 if once else until_idle)
        _watch(line, place, catalog, plan, options, arrays, existing, nan, workers)


@dataclass(frozen=True)
class Place:
    """What is watched, as the command is told: the first arguments of `insitu.ensembles.watch.WatchOptions`."""

    folder: Path
    pattern: str
    settle: float
    marker: str
    patience: float
    until_idle: float | None


def _watch(
    line: ProgressLine,
    place: Place,
    catalog: Path,
    plan: PlanOptions,
    options: ReadingOptions,
    arrays: tuple[str, ...],
    existing: Any,
    nan: str,
    workers: int | None,
) -> None:
    """Watch a folder for files."""
    from insitu.ensembles.files import FileEnsemble
    from insitu.ensembles.watch import Arrivals, WatchOptions, watch_folder
    from insitu.readers.states import files_beside, states_of

    space = plan.space
    assert space is not None
    reader, sampling = options.reader, options.sampling
    ensemble = FileEnsemble({}, space, arrays, **options.place, reader=reader, sampling=sampling)
    watching = WatchOptions(
        **vars(place),
        parameters=space.names,
        members=lambda row: states_of(row, reader, sampling, space.names),
        beside=lambda path: files_beside(path, reader, sampling),
    )
    how = how_to_run(line, workers, None)
    how = {"workers": workers, "progress": how["progress"], "warn": how["warn"], "nan": nan, "existing": existing}
    arrivals = Arrivals(watching)
    try:
        watch_folder(catalog, watching, ensemble, plan, arrivals=arrivals, say=line.say, **how)
    except KeyboardInterrupt:
        line.say("ended; the same command goes on from here")
    _told(line, catalog, arrivals.failures)


def _follow(
    line: ProgressLine,
    path: Path,
    catalog: Path,
    plan: PlanOptions,
    options: ReadingOptions,
    arrays: tuple[str, ...],
    until_idle: float | None,
    existing: Any,
    nan: str,
) -> None:
    """Follow one file that is being written, or a stream."""
    from insitu.ensembles.stream import StreamResult, render_stream
    from insitu.readers.adios import follow

    arrived = StreamResult()
    existing = "skip" if existing == "error" else existing
    how: dict[str, Any] = {"arrays": arrays, "place": options.place, "nan": nan, "existing": existing}
    try:
        steps = follow(path, arrays, until_idle)
        warn = how_to_run(line, None, None)["warn"]
        render_stream(catalog, steps, plan, **how, arrived=arrived, say=line.say, warn=warn)
    except KeyboardInterrupt:
        line.say("ended; the same command goes on from here, with what the writer still holds")
    _told(line, catalog, arrived.failures)


def _told(line: ProgressLine, catalog: Path, failures: Mapping[str, str]) -> None:
    """Say how many members there are; what was stored just before the end is no failure, though it has been."""
    from catalogs.store.catalog import Catalog
    from insitu.members.planning import is_catalog

    line.close()
    held = {path.name for path in Catalog.open(catalog).member_paths()} if is_catalog(catalog) else set()
    click.echo(f"{catalog}: {len(held)} members")
    fail_on({name: why for name, why in failures.items() if name not in held})
