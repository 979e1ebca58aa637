"""The `insitu` command: make data sets, render stored ensembles, watch folders, probe fields."""

from __future__ import annotations

import click

from catalogs.commands import Commands
from catalogs.docs import docs
from catalogs.doctor import doctor
from catalogs.version import version_option
from insitu.commands.dataset import dataset
from insitu.commands.ensemble import ensemble
from insitu.commands.estimate import estimate
from insitu.commands.library import library
from insitu.commands.probe import probe
from insitu.commands.watch import watch


@click.group(cls=Commands, extra="insitu", context_settings={"help_option_names": ["-h", "--help"]})
@version_option
def main() -> None:
    """Render simulations while they run, into Cinema databases."""


for command in (dataset, estimate, ensemble, watch, probe, library, doctor, docs):
    main.add_command(command)
