"""Groups of commands, and errors in one line, that the commands of all packages share."""

from __future__ import annotations

import warnings
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import Any

import click

from catalogs.extras import remedy


class Commands(click.Group):
    """A group of commands that report a missing package in one sentence with the pip command.

    Parameters
    ----------
    extra : of this project, which brings what the commands need.
    extras : the extra of each command that needs another one, by the command's name.
    """

    def __init__(self, *arguments: Any, extra: str = "", extras: Mapping[str, str] | None = None, **more: Any) -> None:
        super().__init__(*arguments, **more)
        self.extra, self.extras = extra, extras or {}

    def invoke(self, context: click.Context) -> Any:
        """Run the command that was named, its warnings as lines; raises ClickException where a package is missing."""
        try:
            with warnings.catch_warnings():
                warnings.showwarning = lambda message, *where, **more: click.echo(f"Warning: {message}", err=True)
                return super().invoke(context)
        except ModuleNotFoundError as error:
            name = str(context.invoked_subcommand)
            raise click.ClickException(remedy(error, f"`{name}`", self.extras.get(name, self.extra))) from error


@contextmanager
def one_line_errors(*more: type[Exception], interrupted: str = "") -> Iterator[None]:
    """Print ValueError, OSError and `more` in one line without a traceback, and `interrupted` after Ctrl-C.

    A reader of the output that has gone, as in `... | head`, is none of them: click then ends the command silently.
    """
    expected: tuple[type[Exception], ...] = (ValueError, OSError, *more)
    try:
        yield
    except BrokenPipeError:
        raise
    except expected as error:
        raise click.ClickException(str(error)) from error
    except KeyboardInterrupt:
        if not interrupted:
            raise
        raise click.ClickException(f"interrupted; {interrupted}") from None
