"""`insitu watch`: a folder that a simulation writes into."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from insitu.commands import shell
from insitu.commands.reading import Reading, appearances_of, code_options, listed
from insitu.commands.shell import command, fail_on, how_to_run

SECONDS = click.FloatRange(min=0)


@click.command()
@click.argument("folder", type=click.Path(exists=True, file_okay=False, path_type=Path))
@click.option(
    "--pattern",
    required=True,
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
    pattern: str,
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
    """
    with command() as line:
        from catalogs.appearance import shown_fields
        from catalogs.catalog import Catalog
        from catalogs.scene import Scene, ViewPlan
        from insitu.file_ensemble import FileEnsemble
        from insitu.planning import PlanOptions, is_catalog
        from insitu.readers.states import files_beside, states_of
        from insitu.watch import Arrivals, Watching, space_for, watch_folder

        if scene is not None and (appearance is not None or size is not None or target_decibels is not None):
            raise ValueError("a scene says how to render: leave out --appearance, --size and --target-decibels")
        asked = None if scene is None else Scene.load(scene)
        given, known = appearances_of(catalog, appearance, asked)
        if not given and not known:
            raise ValueError(
                f"a new catalog needs --appearance FILE: `insitu probe` on a dump suggests one; {catalog} is none yet"
            )
        options = Reading(**reading)
        space = space_for(catalog, pattern, options.ranges, listed(options.units), told=bool(options.reader))
        arrays = options.arrays or tuple(filter(None, shown_fields(given or known)))
        ensemble = FileEnsemble({}, space, arrays, **options.place, reader=options.reader, sampling=options.sampling)
        if asked is not None:
            plan = PlanOptions.of_scene(asked, space)
        else:
            size = size or (None if known else 256)
            views = None if size is None else ViewPlan(width=size, height=size)
            plan = PlanOptions(space, given, views, target_decibels=target_decibels)
        watching = Watching(
            folder,
            pattern,
            settle,
            marker,
            patience,
            0.0 if once else until_idle,
            space.names,
            lambda row: states_of(row, options.reader, options.sampling, space.names),
            lambda path: files_beside(path, options.reader, options.sampling),
        )
        how = how_to_run(line, workers, None)
        arrivals = Arrivals(watching)
        try:
            watch_folder(
                catalog,
                watching,
                ensemble,
                plan,
                arrivals=arrivals,
                workers=workers,
                nan=nan,
                existing=existing,
                say=line.say,
                progress=how["progress"],
                warn=how["warn"],
            )
        except KeyboardInterrupt:
            line.say("ended; the same command goes on from here")
        line.close()
        held = {path.name for path in Catalog.open(catalog).member_paths()} if is_catalog(catalog) else set()
        click.echo(f"{catalog}: {len(held)} members")
        # One that was stored just before the end is no failure, though it has been.
        fail_on({name: why for name, why in arrivals.failures.items() if name not in held})
