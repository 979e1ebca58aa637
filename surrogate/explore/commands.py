"""`surrogate explore`."""

from __future__ import annotations

from pathlib import Path

import click

from surrogate.command_line import RUN, one_line_errors


@click.command()
@RUN
@click.option(
    "--host", default="127.0.0.1", show_default=True, help="Address to listen on; others need the printed token."
)
@click.option("--port", default=0, help="Port to listen on.  [default: any that is free]")
@click.option("--open/--no-open", "open_page", default=False, help="Open the page in this machine's browser.")
def explore(run: Path, host: str, port: int, open_page: bool) -> None:
    """Fly through the surrogate in RUN (such as runs/tgv-dvr) in a browser, until Ctrl-C."""
    try:
        from surrogate.explore.application import explore as serve
        from surrogate.explore.run import Run

        with one_line_errors():
            serve(Run.open(run), host=host, port=port, open_page=open_page, announce=click.echo)
    except ModuleNotFoundError as error:
        raise click.ClickException(
            f"the explorer needs the package {error.name}: pip install 'gs-surrogate[explore]'"
        ) from error
