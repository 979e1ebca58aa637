"""`insitu ensemble`: an ensemble that is stored already."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import click

from insitu.commands import shell
from insitu.commands.reading import Looks, ReadingOptions, pilots, reading_options, suggested
from insitu.commands.shell import command, engine_at, fail_on, how_to_run


@click.command()
@click.argument("sources", nargs=-1, required=True)
@shell.CATALOG
@shell.SCENE
@shell.APPEARANCE
@reading_options
@shell.SIZE
@shell.DECIBELS
@click.option("--validation", default=0, show_default=True, help="Training members to set aside for validation.")
@click.option("--seed", default=0, show_default=True, help="Draws the validation members.")
@shell.EXISTING
@shell.NAN
@shell.WORKERS
@shell.SHARD
@shell.ENGINE
@shell.BACKEND
@shell.NO_COARSE_FIELD
@shell.ADD_COARSE_FIELDS
def ensemble(
    sources: tuple[str, ...],
    catalog: Path,
    scene: Path | None,
    appearance: Path | None,
    size: int | None,
    target_decibels: float | None,
    validation: int,
    seed: int,
    existing: Any,
    workers: int | None,
    shard: str | None,
    engine: str | None,
    backend: str | None,
    no_coarse_field: bool,
    add_coarse_fields: bool,
    **reading: Any,
) -> None:
    """Render a stored ensemble.

    \b
    SOURCES are one of
      TABLE.csv                       path,Re,time: a file and its parameters a row; also split, name
      'run_{Re}/dump_{time}.vti'      files whose paths name the parameters
      ENSEMBLE.h5 (.nc, .zarr)        one file with all members, found by its structure
      plt*, or FOLDER                 dumps of one simulation code, which say their time or redshift

    Files may be of any format that pyvista reads, .npy, .npz, HDF5, netCDF or Zarr, or of a code that --reader lists.  A new
    catalog is shown as --scene or --appearance say, else as `insitu probe` suggests, which is printed.  With a catalog that
    exists, what is left out is the catalog's; members that it holds are skipped.
    """
    with command() as line:
        from catalogs.vocabulary.words import plural
        from insitu.ensembles import coarse
        from insitu.ensembles.ensemble import run_ensemble
        from insitu.members.notes import Once, notes_on_ensemble

        how = how_to_run(line, workers, shard)
        looks = Looks.of(catalog, scene, appearance, size, target_decibels)
        options = ReadingOptions(**reading).as_in(looks.catalog.plan if looks.catalog else None)
        nan = options.nan or "refuse"
        source = options.open(sources, looks.appearances or looks.catalog_appearances)
        members = source.members(validation, seed) if validation else looks.split_as_stored(source.members())
        click.echo(str(source), err=True)
        looks.options(source.space, options)  # its mistakes are found before a field is read
        if looks.catalog is None:
            Once(how["warn"]).say("", [*notes_on_ensemble(members, source.space), *source.notes])
        if looks.scene is not None:
            members = looks.scene.assigned(members)
        elif not looks.appearances and not looks.catalog_appearances:
            suggestions = [suggestion for _, suggestion in suggested(pilots(source, members, 5, nan)).values()]
            click.echo("\n".join(suggestion.toml() for suggestion in suggestions))
            looks = replace(looks, appearances=tuple(suggestion.appearance for suggestion in suggestions))
        plan, how = looks.options(source.space, options), {**how, "nan": nan}
        coarse_field = plan.coarse_field and not no_coarse_field
        plan = replace(plan, coarse_field=coarse_field, backend=backend or plan.backend)
        with engine_at(line, engine, workers, catalog) as where:
            if add_coarse_fields:
                result = coarse.add_coarse_fields(catalog, members, source, plan, **how, **where)
            else:
                result = run_ensemble(catalog, members, source, plan, existing=existing, **how, **where)
        line.close()
        if add_coarse_fields:
            click.echo(f"{catalog}: coarse fields of {plural(len(result.rendered), 'member')} added")
        else:
            click.echo(repr(result))
        if plan.coarse_field and not add_coarse_fields:
            shell.say_lacking(catalog, "the same command with --add-coarse-fields")
        fail_on(result.failures)
