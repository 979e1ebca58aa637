"""`insitu dataset`: a scene's catalog."""

from __future__ import annotations

from pathlib import Path

import click

from insitu.commands.shell import (
    ADD_COARSE_FIELDS,
    ENGINE,
    NAMED_FILE,
    PATH,
    SHARD,
    WORKERS,
    command,
    engine_at,
    fail_on,
    how_to_run,
    say_lacking,
)


@click.command()
@click.argument("scene", type=NAMED_FILE)
@click.option("--runs", default="runs", show_default=True, type=PATH, help="Folder of all results.")
@WORKERS
@SHARD
@ENGINE
@ADD_COARSE_FIELDS
def dataset(
    scene: Path, runs: Path, workers: int | None, shard: str | None, engine: str | None, add_coarse_fields: bool
) -> None:
    """Make the data set of SCENE (a TOML file); goes on where it was interrupted."""
    with command() as line:
        from catalogs.vocabulary.scene import Scene
        from catalogs.vocabulary.words import plural
        from insitu.ensembles.dataset import make_dataset

        loaded, how = Scene.load(scene), how_to_run(line, workers, shard)
        with engine_at(line, engine, workers, runs) as where:
            result = make_dataset(loaded, runs, only_coarse_fields=add_coarse_fields, **how, **where)
        fail_on(result.failures)
    if add_coarse_fields:
        click.echo(f"{result.catalog}: coarse fields of {plural(result.made, 'member')} added")
    elif result.made:
        click.echo(
            f"{result.catalog}: {plural(result.members, 'member')}, {result.made} new, {result.seconds:.0f} s in all"
        )
    else:
        click.echo(f"{result.catalog}: nothing to do")
    if loaded.appearances and loaded.render.coarse_field and not add_coarse_fields:
        say_lacking(result.catalog, f"`insitu dataset {scene} --add-coarse-fields`")
