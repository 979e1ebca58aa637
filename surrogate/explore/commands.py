"""`surrogate explore`."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from catalogs.commands import one_line_errors
from surrogate.command_line import RUN


@click.command()
@RUN
@click.option(
    "--host", default="127.0.0.1", show_default=True, help="Address to listen on; others need the printed token."
)
@click.option(
    "--port", type=int, help="Port to listen on.  [default: one of the run's own, the same each time, if it is free]"
)
@click.option(
    "--base-url",
    default="",
    envvar="JUPYTERHUB_SERVICE_PREFIX",
    help="That of a Jupyter server whose jupyter-server-proxy leads here; JupyterHub tells it by itself.",
)
@click.option("--open/--no-open", "open_page", default=False, help="Open the page in this machine's browser.")
def explore(run: Path, **options: Any) -> None:
    """Fly through the surrogate in RUN (such as runs/tgv) in a browser, until Ctrl-C."""
    with one_line_errors():
        from surrogate.explore.run import Run
        from surrogate.explore.server.terminal import explore as serve

        opened = Run.open(run)
        if opened.missing:
            click.echo(f"{opened.missing}; until then no stored pictures are shown", err=True)
        serve(opened, announce=click.echo, **options)
