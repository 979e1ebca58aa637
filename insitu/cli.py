"""The `insitu` command: make data sets, render stored ensembles, probe fields."""

from __future__ import annotations

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import click

from catalogs.progress import ProgressLine

PATH = click.Path(path_type=Path)
NAMED_FILE = click.Path(dir_okay=False, path_type=Path)  # whose absence is told in our own words
FILE = click.Path(exists=True, dir_okay=False, path_type=Path)
NAN = click.option(
    "--nan", type=click.Choice(["refuse", "transparent"]), default="refuse", show_default=True, help="NaN and infinity."
)
WORKERS = click.option("--workers", type=click.IntRange(min=1), help="Processes; by default one per available core.")
SHARD = click.option("--shard", metavar="I/N", help="Take only every N-th member, beginning with the I-th.")


@click.group(context_settings={"help_option_names": ["-h", "--help"]})
def main() -> None:
    """Render simulations while they run, into Cinema databases."""


@main.command()
@click.argument("scene", type=NAMED_FILE)
@click.option("--runs", default="runs", show_default=True, type=PATH, help="Folder of all results.")
@WORKERS
@SHARD
def dataset(scene: Path, runs: Path, workers: int | None, shard: str | None) -> None:
    """Make the data set of SCENE (a TOML file); goes on where it was interrupted."""
    with _command() as line:
        from catalogs.scene import Scene
        from insitu.dataset import make_dataset

        result = make_dataset(Scene.load(scene), runs, **_how_to_run(line, workers, shard))
        _fail_on(result.failures)
    if result.made:
        click.echo(f"{result.catalog}: {result.members} members, {result.made} new, {result.seconds:.0f} s in all")
    else:
        click.echo(f"{result.catalog}: nothing to do")


@main.command()
@click.argument("file", type=FILE)
@click.option("--catalog", required=True, type=PATH, help="The .cdb folder to write.")
@click.option("--scene", type=NAMED_FILE, help="Take appearances and views from this scene.")
@click.option("--appearance", type=FILE, help="TOML file of [[appearance]] tables, as `insitu probe` prints them.")
@click.option(
    "--dataset",
    "datasets",
    multiple=True,
    help="HDF5 data set that holds the fields; several, one by one.  [default: those that appearances name, else field]",
)
@click.option("--size", type=click.IntRange(min=1), help="Width and height of the images in pixels.  [default: 256]")
@click.option("--target-decibels", type=float, help="PSNR that volume rendering must reach.  [default: 50]")
@click.option("--validation", default=0, show_default=True, help="Training members to set aside for validation.")
@click.option("--seed", default=0, show_default=True, help="Draws the validation members.")
@NAN
@WORKERS
@SHARD
def ensemble(
    file: Path,
    catalog: Path,
    scene: Path | None,
    appearance: Path | None,
    datasets: tuple[str, ...],
    size: int | None,
    target_decibels: float | None,
    validation: int,
    seed: int,
    nan: str,
    workers: int | None,
    shard: str | None,
) -> None:
    """Render an ensemble stored in one HDF5 FILE: fields (member, z, y, x), params, attributes names, lower, upper, ...

    A new catalog is shown as --scene or --appearance say, else as `insitu probe` suggests, which is printed.  With a
    catalog that exists, what is left out is the catalog's; members that it holds are skipped.
    """
    with _command() as line:
        from catalogs.catalog import Catalog
        from catalogs.scene import Scene, ViewPlan
        from insitu.ensemble import run_ensemble
        from insitu.planning import PlanOptions, appearances_from_toml, is_catalog

        if scene is not None and (appearance is not None or size is not None or target_decibels is not None):
            raise ValueError("a scene says how to render: leave out --appearance, --size and --target-decibels")
        asked = None if scene is None else Scene.load(scene)
        known = Catalog.open(catalog).plan.appearances if is_catalog(catalog) else ()
        given = appearances_from_toml(appearance) if appearance else asked.appearances if asked else None
        stored = _stored(file, datasets, given or known)
        members = stored.members(validation, seed)
        click.echo(str(stored))
        if asked is not None:
            members, options = asked.assigned(members), PlanOptions.of_scene(asked, stored.space)
        else:
            if not given and not known:
                suggestions = [suggestion for _, suggestion in _suggested(_pilots(stored, members, 5, nan)).values()]
                click.echo("\n".join(suggestion.toml() for suggestion in suggestions))
                given = tuple(suggestion.appearance for suggestion in suggestions)
            size = size or (None if known else 256)
            views = None if size is None else ViewPlan(width=size, height=size)
            options = PlanOptions(stored.space, given, views, target_decibels=target_decibels)
        result = run_ensemble(catalog, members, stored, options, nan=nan, **_how_to_run(line, workers, shard))
        line.close()
        click.echo(str(result))
        _fail_on(dict(result.failures))


@main.command()
@click.argument("sources", nargs=-1, required=True, type=FILE)
@click.option("--members", "count", default=5, show_default=True, help="Pilot members of an ensemble to look at.")
@click.option("--alpha", default=0.5, show_default=True, help="Mean alpha that the foreground should have.")
@click.option(
    "--array",
    "arrays",
    multiple=True,
    help="Which of several fields: an array of VTK files, a data set of HDF5, a field of a scene; several, one by one.",
)
@click.option("--spacing", type=float, nargs=3, help="Distance between values, x y z, of .npy files.")
@NAN
@click.option("--preview", type=PATH, help="Write a picture of the suggestion (PNG).")
def probe(
    sources: tuple[Path, ...],
    count: int,
    alpha: float,
    arrays: tuple[str, ...],
    spacing: tuple[float, float, float] | None,
    nan: str,
    preview: Path | None,
) -> None:
    """Look at pilot members and suggest a transfer function.

    SOURCES: a scene's TOML file (its simulation is run, or its file read), an ensemble in HDF5, or one file per member
    (.npy, or whatever pyvista reads).
    """
    with _command():
        first = sources[0]
        if len(sources) == 1 and first.suffix == ".toml":
            from catalogs.scene import Scene
            from insitu.sources import ensemble_of

            asked = ensemble_of(Scene.load(first))
            fields = _chosen(_pilots(asked.source, asked.members, count, nan, asked.space), arrays)
        elif len(sources) == 1 and first.suffix in (".h5", ".hdf5"):
            stored = _stored(first, arrays, ())
            fields = _pilots(stored, stored.members(), count, nan)
        else:
            from insitu.readers.files import read_field

            fields = {
                array or "": {p.name: read_field(p, array=array, spacing=spacing or None, nan=nan) for p in sources}
                for array in arrays or (None,)
            }
        for name, (found, suggestion) in _suggested(fields, alpha).items():
            if len(fields) > 1:
                click.echo(f"field {name}")
            click.echo(str(found))
            click.echo(f"mean foreground alpha by member: {', '.join(f'{a:.2f}' for a in suggestion.alphas)}\n")
            click.echo(suggestion.toml())
            if preview is not None:
                _preview(preview, fields[name], suggestion.appearance, name if len(fields) > 1 else "")


def _preview(path: Path, grids: dict[str, Any], appearance: Any, field: str) -> None:
    """A picture of the suggestion; of one of several fields beside `path`, with the appearance in its name."""
    from catalogs.images import write_image
    from insitu.suggestion import contact_sheet

    path = path.with_stem(f"{path.stem}-{appearance.name}") if field else path
    write_image(path, contact_sheet(list(grids.values()), appearance))
    click.echo(f"# {path}: one member per row")


def _stored(path: Path, datasets: tuple[str, ...], shown: Any) -> Any:
    """A stored ensemble: of the data sets asked for, else those that the `shown` appearances name, else "field"."""
    from catalogs.appearance import shown_fields
    from insitu.fields import check_names
    from insitu.readers.hdf5 import Hdf5Ensemble

    named = tuple(filter(None, shown_fields(shown)))
    stored = Hdf5Ensemble.open(path, datasets or named or ("field",))
    if shown:
        check_names(stored.datasets, shown, shown)
    return stored


def _pilots(source: Any, members: Any, count: int, nan: str, space: Any = None) -> dict[str, dict[str, Any]]:
    """Grids by field and member of `count` members that lie far apart."""
    from insitu.ensemble import pilot_members
    from render.datasets import to_grid

    fields: dict[str, dict[str, Any]] = {}
    for member in pilot_members(members, space or source.space, count):
        click.echo(f"reading {member.name} {dict(member.parameters)}", err=True)
        for name, field in source.field(member, lambda fraction: None).items():
            try:
                fields.setdefault(name, {})[member.name] = to_grid(field, nan=nan, warn=False)
            except (TypeError, ValueError) as error:
                raise ValueError(f"field {name!r} of {member.name}: {error}") from error
    return fields


def _chosen(fields: dict[str, dict[str, Any]], names: tuple[str, ...]) -> dict[str, dict[str, Any]]:
    """The fields asked for by name, all by default."""
    unknown = [name for name in names if name not in fields]
    if unknown:
        raise ValueError(f"--array: the scene's fields are {list(fields)}, got {unknown}: name more in source.fields")
    return {name: fields[name] for name in names} or fields


def _suggested(fields: dict[str, dict[str, Any]], alpha: float = 0.5) -> dict[str, tuple[Any, Any]]:
    """What is in each field, and how it may be shown; one of several fields is named by its appearance."""
    from insitu.probe import probe_fields
    from insitu.suggestion import appearance_names, suggest

    suggested, names = {}, appearance_names(list(fields))
    for name, grids in fields.items():
        found = probe_fields(grids)
        of = {"name": names[name], "field": name} if len(fields) > 1 else {}
        suggested[name] = found, suggest(found, list(grids.values()), alpha=alpha, **of)
    return suggested


def _how_to_run(line: ProgressLine, workers: int | None, shard: str | None) -> dict[str, Any]:
    """Arguments of `run_ensemble`; `line` tells progress and warnings."""
    index, sign, count = ("1/1" if shard is None else shard).partition("/")
    if not sign or not index.isdigit() or not count.isdigit():
        raise ValueError(f"--shard takes I/N, such as 1/4, got {shard!r}")
    part = int(index), int(count)
    return {"workers": workers, "shard": part, "progress": line, "warn": lambda note: line.say(f"Warning: {note}")}


def _fail_on(failures: dict[str, str]) -> None:
    if failures:
        lines = "\n".join(f"  {name}: {why}" for name, why in failures.items())
        raise click.ClickException(f"{len(failures)} members failed; the same command tries them again:\n{lines}")


@contextmanager
def _command() -> Iterator[ProgressLine]:
    """Run a command with a progress line; mistakes that a user can mend are told in one plain line.

    SIGTERM, as batch systems send it, ends the work like Ctrl-C.
    """
    in_main = threading.current_thread() is threading.main_thread()  # signals are its alone
    previous = signal.signal(signal.SIGTERM, signal.default_int_handler) if in_main else None
    try:
        with ProgressLine() as line:
            yield line
    except (ValueError, OSError, RuntimeError) as error:
        raise click.ClickException(str(error)) from error
    except KeyboardInterrupt:
        raise click.ClickException("interrupted; the same command goes on from here") from None
    finally:
        if in_main:
            signal.signal(signal.SIGTERM, previous)
