"""`insitu library`: the hook for C, C++ and Fortran."""

from __future__ import annotations

from pathlib import Path

import click

from catalogs.commands import one_line_errors
from insitu.commands import shell


@click.command()
@click.argument("folder", type=shell.PATH)
def library(folder: Path) -> None:
    """Build the hook for simulations in C, C++ and Fortran into FOLDER: libinsitu.so, insitu.h and insitu.f90."""
    from insitu.bindings.build import BuildError, build

    with one_line_errors(BuildError):
        paths = build(folder)
    for path in paths:
        click.echo(path)
