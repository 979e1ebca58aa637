"""The `catalogs` command: check, show, merge, import, export and browse Cinema databases."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import click

from catalogs.commands import Commands, one_line_errors
from catalogs.version import version_option

if TYPE_CHECKING:
    from catalogs.progress import ProgressLine

CATALOG = click.argument("path", type=click.Path(file_okay=False, path_type=Path))


@click.group(cls=Commands, context_settings={"help_option_names": ["-h", "--help"]})
@version_option
def main() -> None:
    """Cinema databases of simulation ensembles."""


@main.command()
@CATALOG
@click.option(
    "--repair",
    is_flag=True,
    help="Move members that must be rendered again into PATH/damaged, and rebuild all rows from the members' records.",
)
@click.option(
    "--accept",
    is_flag=True,
    help="Take all files as they are, such as an edited catalog.json: write their digests and all rows anew.",
)
def check(path: Path, repair: bool, accept: bool) -> None:
    """Validate PATH against Cinema specification D, and every file against its digest; the exit status is 1 if there are findings.

    Without --repair or --accept nothing is written.  With --repair, members with missing or damaged images, records or summaries
    are moved into PATH/damaged, so that rendering the scene again replaces them; remaining findings are printed.
    """
    from catalogs.store.catalog import Catalog
    from catalogs.tools import repair as tools
    from catalogs.tools.check import check as run

    if repair and accept:
        raise click.UsageError("--repair and --accept exclude each other: repair what is damaged, then accept the rest")
    notes: list[str] = []
    with _progress() as line:
        progress = partial(line.count, "checking")
        if repair:
            done = tools.repair(path, progress=progress)
        elif accept:
            done = tools.Repaired((), tools.accept(path, progress=partial(line.count, "accepting", unit="members")))
        else:
            done = tools.Repaired((), tuple(run(path, progress=progress, note=notes.append)))
    for text in map(str, (*done.mended, *done.set_aside, *done.findings, *notes)):
        click.echo(text)
    if done.set_aside:
        click.echo(tools.how_to_render_again(Catalog.open(path), done.set_aside))
    if count := len(done.findings):
        raise click.ClickException(f"{path}: {count} finding{'s' * (count > 1)}")
    click.echo(f"{path}: nothing wrong{' now' if repair else ''}")


@main.command()
@CATALOG
def show(path: Path) -> None:
    """Print the contents of PATH as a table."""
    from catalogs.tools.show import described

    with one_line_errors():
        for line in described(path):
            click.echo(line)


@main.command()
@click.argument("into", type=click.Path(file_okay=False, path_type=Path))
@click.argument("sources", metavar="FROM...", nargs=-1, required=True, type=click.Path(path_type=Path))
def merge(into: Path, sources: tuple[Path, ...]) -> None:
    """Add the members of the catalogs FROM to the catalog INTO, which is created if necessary.

    All must be of one scene: equal parameters, views, appearances, variations and encoding.  A member of several catalogs is
    added once; if its images differ, nothing is written.  The catalogs FROM don't change; images become hard links where
    possible, else copies.  Run it again to resume after an interruption.
    """
    from catalogs.tools.merge import merge as run

    with _progress() as line:
        result = run(into, sources, progress=partial(line.count, unit="members"))
    copied = f"; {result.copied} images were copied, not linked" if result.copied else ""
    click.echo(f"{into}: {result.added} members added, {result.same} found in several catalogs{copied}")


@main.command()
@CATALOG
@click.argument("destination", type=click.Path(file_okay=False, path_type=Path))
def pack(path: Path, destination: Path) -> None:
    """Write PATH into the new catalog DESTINATION with one HDF5 file of images per member.

    All other commands, training, evaluation and pycinema read it like PATH; simulations can't add members.  Run it again to
    resume after an interruption, or to add new members of PATH.
    """
    from catalogs.tools.packing import pack as run

    with _progress() as line:
        done = run(path, destination, progress=partial(line.count, "packing", unit="members"))
    click.echo(f"{destination}: {done.made} members packed, {done.there} were there")


@main.command()
@CATALOG
@click.argument("destination", type=click.Path(file_okay=False, path_type=Path))
def unpack(path: Path, destination: Path) -> None:
    """Write the packed catalog PATH into the new catalog DESTINATION with a file per image, as before `catalogs pack`."""
    from catalogs.tools.packing import unpack as run

    with _progress() as line:
        done = run(path, destination, progress=partial(line.count, "unpacking", unit="members"))
    encoded = f"; {done.other_bytes} images have the same pixels, encoded in other bytes" if done.other_bytes else ""
    click.echo(f"{destination}: {done.made} members unpacked, {done.there} were there{encoded}")


@main.command()
@CATALOG
@click.argument("destination", type=click.Path(file_okay=False, path_type=Path))
@click.option("--rows", default=100_000, show_default=True, help="Maximum of a shard's table.")
def split(path: Path, destination: Path, rows: int) -> None:
    """Write PATH as shards for Cinema viewers with limited tables, under the index DESTINATION/data.csv.

    Each shard is a complete catalog in DESTINATION/shards; images are hard links where possible.  Training and browsing don't
    need shards.
    """
    from catalogs.tools.split import split as run

    with _progress() as line:
        shards = run(path, destination, rows=rows, progress=partial(line.count, "splitting", unit="members"))
    count, most = sum(len(shard.members) for shard in shards), max(shard.rows for shard in shards)
    click.echo(f"{destination}: {count} members in {len(shards)} shards of at most {most:,} rows")


@main.group(name="import")
def import_group() -> None:
    """Import images rendered by other programs."""


@import_group.command()
@click.argument("directory", type=click.Path(exists=True, file_okay=False, path_type=Path))
@click.option("--catalog", required=True, type=click.Path(path_type=Path), help="The .cdb folder to write.")
@click.option("--bounds", required=True, metavar="X0,Y0,Z0,X1,Y1,Z1", help="World box of the volume.")
@click.option(
    "--background",
    default="1,1,1",
    show_default=True,
    metavar="R,G,B",
    help="Color behind opaque images; none keeps the alpha of RGBA images.",
)
@click.option("--names", metavar="A,B,...", help="Names of the parameters; p0, p1, ... by default.")
@click.option("--validation-members", default=2, show_default=True, help="Number of validation members.")
@click.option("--seed", default=0, show_default=True, help="Draws the validation members.")
def nerf(
    directory: Path, catalog: Path, bounds: str, background: str, names: str | None, validation_members: int, seed: int
) -> None:
    """Import the D-NeRF / Blender data set in DIRECTORY (transforms_*.json with `params` per frame)."""
    from catalogs.exchange import import_nerf

    with _progress() as line:
        box = _numbers("--bounds", bounds, 6)
        result = import_nerf(
            directory,
            catalog,
            bounds=(box[:3], box[3:]),
            background=None if background == "none" else _numbers("--background", background, 3),
            names=names.split(",") if names else None,
            validation_members=validation_members,
            seed=seed,
            progress=partial(line.count, "importing"),
        )
    click.echo(repr(result))


@main.command()
@CATALOG
@click.argument("directory", type=click.Path(path_type=Path))
@click.option("--format", "kind", required=True, type=click.Choice(["colmap", "nerf"]), help="Layout.")
@click.option("--appearance", help="Name of the appearance; required if there are several.")
@click.option("--members", metavar="A,B,...", help="Names of members; all by default.")
@click.option(
    "--background", metavar="R,G,B", help="Color behind the images; by default colmap gets black, nerf alpha."
)
def export(
    path: Path, directory: Path, kind: str, appearance: str | None, members: str | None, background: str | None
) -> None:
    """Write images and cameras of PATH into the new folder DIRECTORY, in COLMAP's or NeRF's layout."""
    from catalogs.exchange import export as run
    from catalogs.store.catalog import Catalog

    with _progress() as line:
        folder = run(
            Catalog.open(path),
            directory,
            kind,  # type: ignore[arg-type]
            appearance=appearance,
            members=members.split(",") if members else (),
            background=None if background is None else _numbers("--background", background, 3),
            progress=partial(line.count, "exporting"),
        )
    click.echo(f"{folder}: written")


@main.command()
@CATALOG
@click.option(
    "--host", default="127.0.0.1", show_default=True, help="Any but this machine's own needs a token, which is printed."
)
@click.option("--port", default=0, show_default=True, help="0 takes a free one.")
@click.option("--open/--no-open", "show_page", default=False, help="Open the page in the default browser.")
@click.option(
    "--explorer",
    default="",
    metavar="ADDRESS",
    help="Link pictures to an explorer of this ensemble, by the address that `surrogate explore` prints.",
)
def browse(path: Path, host: str, port: int, show_page: bool, explorer: str) -> None:
    """Write a static page into PATH and serve it until Ctrl-C, to this machine only unless --host says otherwise."""
    from catalogs.browse import serve

    with one_line_errors():
        serve(path, host=host, port=port, open_page=show_page, explorer=explorer, announce=click.echo)


@contextmanager
def _progress() -> Iterator[ProgressLine]:
    """A progress line for a command, with plain errors."""
    from catalogs.progress import ProgressLine

    with one_line_errors(), ProgressLine() as line:
        yield line


def _numbers(option: str, text: str, count: int) -> list[float]:
    try:
        values = [float(part) for part in text.split(",")]
    except ValueError:
        values = []
    if len(values) != count:
        raise ValueError(f"{option} takes {count} numbers with commas between, got {text!r}")
    return values
