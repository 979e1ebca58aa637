"""`surrogate ask`: questions to a surrogate, each a command."""

from __future__ import annotations

import click

from surrogate.answers.matters_command import matters
from surrogate.answers.next_command import suggest
from surrogate.answers.sure_command import sure
from surrogate.answers.which_command import which


@click.group()
def ask() -> None:
    """Ask the surrogate of a run: how sure it is, which parameters draw a picture, what matters, and where next."""


for command in (sure, which, matters, suggest):
    ask.add_command(command)
