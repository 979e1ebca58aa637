"""Version and commit of this project, the same for all of its packages and commands."""

from __future__ import annotations

import subprocess
from collections.abc import Callable
from importlib.metadata import PackageNotFoundError
from importlib.metadata import version as installed
from pathlib import Path
from typing import Any, TypeVar

DISTRIBUTION = "gs-surrogate"
UNKNOWN = "unknown"
HERE = Path(__file__).resolve()

Command = TypeVar("Command", bound=Callable[..., Any])


def version() -> str:
    """The version that is installed, such as "0.1.0"; "unknown" where none is."""
    try:
        return installed(DISTRIBUTION)
    except PackageNotFoundError:
        return UNKNOWN


def commit() -> str:
    """The commit of this checkout, with "+dirty" when it has changes (but for measured records).

    "unknown" outside one, also where the packages are installed within a repository of something else.
    """
    try:
        _git("ls-files", "--error-unmatch", HERE.name)
        head = _git("rev-parse", "--short=12", "HEAD")
        changed = _git("status", "--porcelain", "--untracked-files=no", "--", ":/", ":(top,exclude,glob)**/records/**")
    except (OSError, subprocess.SubprocessError):
        return UNKNOWN
    return f"{head}+dirty" if changed else head


def described() -> str:
    """Version and, where it is known, commit: "0.1.0 (commit 1a2b3c4d5e6f)"."""
    head = commit()
    return version() if head == UNKNOWN else f"{version()} (commit {head})"


def version_option(command: Command) -> Command:
    """Give a click command the option --version, which prints its name and `described()`."""
    import click

    def show(context: click.Context, parameter: click.Parameter, requested: bool) -> None:
        if requested and not context.resilient_parsing:
            click.echo(f"{context.find_root().info_name} {described()}")
            context.exit()

    option = click.option(
        "--version", is_flag=True, is_eager=True, expose_value=False, callback=show, help="Show version and commit."
    )
    return option(command)


def _git(*arguments: str) -> str:
    command = ["git", "--no-optional-locks", "-C", str(HERE.parent), *arguments]
    return subprocess.run(command, capture_output=True, text=True, timeout=10, check=True).stdout.strip()
