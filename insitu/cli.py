"""The `insitu` command: make data sets, render stored ensembles, probe fields."""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import click

WORKERS = click.option("--workers", type=click.IntRange(min=1), help="Processes; by default one per available core.")
SHARD = click.option("--shard", metavar="I/N", help="Take only every N-th member, beginning with the I-th.")


@click.group(context_settings={"help_option_names": ["-h", "--help"]})
def main() -> None:
    """Render simulations while they run, into Cinema databases."""


@main.command()
@click.argument("scene", type=click.Path(dir_okay=False, path_type=Path))
@click.option(
    "--runs", default="runs", show_default=True, type=click.Path(path_type=Path), help="Folder of all results."
)
@WORKERS
@SHARD
def dataset(scene: Path, runs: Path, workers: int | None, shard: str | None) -> None:
    """Make the data set of SCENE (a TOML file); goes on where it was interrupted."""
    with _plain_errors():
        from catalogs.scene import Scene
        from insitu.dataset import make_dataset

        with _line() as line:
            result = make_dataset(Scene.load(scene), runs, workers=workers, shard=_shard(shard), progress=line)
        _fail_on(result.failures)
    if result.made:
        click.echo(f"{result.catalog}: {result.members} members, {result.made} new, {result.seconds:.0f} s in all")
    else:
        click.echo(f"{result.catalog}: nothing to do")


@main.command()
@click.argument("file", type=click.Path(exists=True, dir_okay=False, path_type=Path))
@click.option("--catalog", required=True, type=click.Path(path_type=Path), help="The .cdb folder to write.")
@click.option(
    "--scene", type=click.Path(dir_okay=False, path_type=Path), help="Take appearances and views from this scene."
)
@click.option("--dataset", "name", default="field", show_default=True, help="HDF5 data set that holds the fields.")
@click.option("--size", default=256, show_default=True, help="Width and height of the images without --scene.")
@click.option("--target-decibels", default=50.0, show_default=True, help="PSNR against a converged rendering.")
@click.option("--validation", default=0, show_default=True, help="Training members to set aside for validation.")
@click.option("--seed", default=0, show_default=True, help="Draws the validation members.")
@WORKERS
@SHARD
def ensemble(
    file: Path,
    catalog: Path,
    scene: Path | None,
    name: str,
    size: int,
    target_decibels: float,
    validation: int,
    seed: int,
    workers: int | None,
    shard: str | None,
) -> None:
    """Render an ensemble stored in one HDF5 FILE: fields (member, z, y, x), params, attributes names, lower, upper, ...

    Without --scene the transfer function is the one that `insitu probe` suggests, and is printed.
    """
    with _plain_errors():
        from catalogs.scene import Scene, ViewPlan
        from insitu.ensemble import run_ensemble
        from insitu.planning import Wishes
        from insitu.readers.hdf5 import Hdf5Ensemble, Hdf5Source

        stored = Hdf5Ensemble.open(file, name)
        members = stored.members(validation, seed)
        click.echo(repr(stored))
        if scene is not None:
            loaded = Scene.load(scene)
            appearances, views, target = loaded.appearances, loaded.views, loaded.render.target_decibels
        elif catalog.is_dir():
            appearances, views, target = None, ViewPlan(width=size, height=size), target_decibels
        else:
            suggestion = _suggested(stored.space, members, Hdf5Source(stored))[1]
            click.echo(suggestion.toml())
            appearances = (suggestion.appearance,)
            views, target = ViewPlan(width=size, height=size), target_decibels
        wishes = Wishes(space=stored.space, appearances=appearances, views=views, target_decibels=target)
        with _line() as line:
            result = run_ensemble(
                catalog, members, Hdf5Source(stored), wishes, workers=workers, shard=_shard(shard), progress=line
            )
        click.echo(repr(result))
        _fail_on(dict(result.failures))


@main.command()
@click.argument("source", type=click.Path(exists=True, dir_okay=False, path_type=Path))
@click.option("--members", "count", default=3, show_default=True, help="Pilot members to look at.")
@click.option("--alpha", default=0.5, show_default=True, help="Mean alpha that the foreground should have.")
@click.option("--preview", type=click.Path(path_type=Path), help="Write a picture of the suggestion (PNG).")
def probe(source: Path, count: int, alpha: float, preview: Path | None) -> None:
    """Look at pilot members of SOURCE (a scene's TOML or an HDF5 ensemble) and suggest a transfer function."""
    with _plain_errors():
        from catalogs.scene import Scene
        from insitu.readers.hdf5 import Hdf5Ensemble, Hdf5Source
        from insitu.sources import ensemble_of

        if source.suffix == ".toml":
            asked = ensemble_of(Scene.load(source))
            space, members, fields = asked.space, asked.members, asked.source
        else:
            stored = Hdf5Ensemble.open(source)
            space, members, fields = stored.space, stored.members(), Hdf5Source(stored)
        found, suggestion, grids = _suggested(space, members, fields, count, alpha)
        click.echo(str(found))
        click.echo(f"mean foreground alpha by member: {', '.join(f'{a:.2f}' for a in suggestion.alphas)}\n")
        click.echo(suggestion.toml())
        if preview is not None:
            _preview(preview, grids, suggestion)
            click.echo(f"{preview}: one member per row")


def _suggested(space: Any, members: Any, source: Any, count: int = 3, alpha: float = 0.5) -> tuple[Any, Any, Any]:
    """Probe, suggestion and grids of `count` pilot members that lie far apart."""
    import numpy as np

    from insitu.adapters import as_grid
    from insitu.boxes import box_of, checked_box
    from insitu.ensemble import pilot_members
    from insitu.probe import probe_fields
    from insitu.suggestion import suggest

    grids = {}
    for member in pilot_members(members, space, count):
        click.echo(f"reading {member.name} {dict(member.parameters)}", err=True)
        grids[member.name] = as_grid(source.field(member, lambda fraction: None))
    found = probe_fields(grids)
    boxes = np.array([box_of(grid) for grid in grids.values()])  # [K, 2, 3]
    bounds = checked_box((boxes[:, 0].min(axis=0), boxes[:, 1].max(axis=0)))
    return found, suggest(found, list(grids.values()), bounds, alpha=alpha), list(grids.values())


def _preview(path: Path, grids: Any, suggestion: Any) -> None:
    import numpy as np

    from catalogs.images import write_image
    from catalogs.scene import ViewPlan
    from insitu.boxes import box_of, cameras_around
    from render import render_views

    rows = []
    for grid in grids:
        cameras = cameras_around(box_of(grid), ViewPlan(width=192, height=192))[20:230:52]
        rows.append(np.concatenate(list(render_views(grid, suggestion.appearance, cameras)), axis=1))
    write_image(path, np.concatenate(rows, axis=0))


def _shard(text: str | None) -> tuple[int, int] | None:
    if text is None:
        return None
    index, sign, count = text.partition("/")
    if not sign or not index.isdigit() or not count.isdigit():
        raise ValueError(f"--shard takes I/N, such as 1/4, got {text!r}")
    return int(index), int(count)


def _fail_on(failures: dict[str, str]) -> None:
    if failures:
        lines = "\n".join(f"  {name}: {why}" for name, why in failures.items())
        raise click.ClickException(f"{len(failures)} members failed; the same command tries them again:\n{lines}")


@contextmanager
def _line() -> Iterator[Any]:
    from insitu.progress import ProgressLine

    line = ProgressLine()
    try:
        yield line
    finally:
        line.close()


@contextmanager
def _plain_errors() -> Iterator[None]:
    """Turn what a user can mend into one line, and warnings into plain sentences."""

    def show(message: Any, *_: Any, **__: Any) -> None:
        click.echo(f"Warning: {message}", err=True)

    try:
        with warnings.catch_warnings():
            warnings.showwarning = show
            yield
    except (ValueError, OSError, RuntimeError) as error:
        raise click.ClickException(str(error)) from error
    except KeyboardInterrupt:
        raise click.ClickException("interrupted; the same command goes on from here") from None
