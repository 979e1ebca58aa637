"""The `surrogate` command: train, evaluate, look at what came out.  Its parts are written in the rooms that they belong to."""

from __future__ import annotations

import click

from catalogs.commands import Commands
from catalogs.docs import docs
from catalogs.doctor import doctor
from catalogs.version import version_option
from surrogate.answers.commands import ask
from surrogate.explore.commands import explore
from surrogate.explore.exporting.commands import export, sweep
from surrogate.report.commands import evaluate
from surrogate.training.commands import show, train

EXTRAS = dict.fromkeys(("explore", "export", "sweep"), "explore")


@click.group(cls=Commands, extra="surrogate", extras=EXTRAS, context_settings={"help_option_names": ["-h", "--help"]})
@version_option
def main() -> None:
    """Fit Gaussians to a Cinema catalog and see the ensemble at any view and parameter."""


for command in (export, sweep, train, evaluate, show, explore, ask, doctor, docs):
    main.add_command(command)
