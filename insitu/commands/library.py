"""`insitu library`: the hook for C, C++ and Fortran."""

from __future__ import annotations

from pathlib import Path

import click

from insitu.commands import shell


@click.command()
@click.argument("folder", type=shell.PATH)
def library(folder: Path) -> None:
    """Build the hook for simulations in C, C++ and Fortran into FOLDER: libinsitu.so, insitu.h and insitu.f90."""
    from insitu.bindings.build import BuildError, build

    try:
        made = build(folder)
    except (BuildError, OSError) as error:
        raise click.ClickException(str(error)) from None
    for path in made:
        click.echo(path)
