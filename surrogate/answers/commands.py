"""`surrogate ask`: questions to a surrogate, each a command."""

from __future__ import annotations

import click

from surrogate.answers.sure_command import sure


@click.group()
def ask() -> None:
    """Ask the surrogate of a run: how sure it is."""


ask.add_command(sure)
