"""Errors in one line, of the commands of all packages."""

from __future__ import annotations

import os
import subprocess
import sys
import warnings
from pathlib import Path

import click
import pytest
from click.testing import CliRunner

from catalogs.commands import Commands, one_line_errors

PROJECT = Path(__file__).resolve().parents[2]


def test_expected_errors_take_one_line_and_bugs_a_traceback() -> None:
    with pytest.raises(click.ClickException, match="no such scene"), one_line_errors():
        raise ValueError("no such scene")
    with pytest.raises(RuntimeError), one_line_errors():
        raise RuntimeError("a bug")
    with pytest.raises(click.ClickException), one_line_errors(RuntimeError):
        raise RuntimeError("another process is training there")


def test_an_interruption_says_what_is_stored() -> None:
    with pytest.raises(click.ClickException, match="all is stored"), one_line_errors(interrupted="all is stored"):
        raise KeyboardInterrupt
    with pytest.raises(KeyboardInterrupt), one_line_errors():
        raise KeyboardInterrupt


def test_a_reader_that_has_gone_ends_a_command_silently(tmp_path: Path) -> None:
    """As `catalogs show PATH | head` does."""
    program = (
        "import click\nfrom catalogs.commands import one_line_errors\n@click.command()\n"
        "def show():\n    with one_line_errors():\n        for _ in range(10000):\n            click.echo('line')\n"
        "show()"
    )
    reading, writing = os.pipe()
    os.close(reading)
    command = [sys.executable, "-c", program]
    ended = subprocess.run(command, cwd=PROJECT, stdout=writing, stderr=subprocess.PIPE, text=True, check=False)
    os.close(writing)
    assert ended.stderr == ""


def test_a_warning_is_a_line_without_a_place_in_the_source() -> None:
    @click.group(cls=Commands)
    def group() -> None:
        pass

    @group.command()
    def warned() -> None:
        warnings.warn("the later one is taken", stacklevel=1)

    assert CliRunner().invoke(group, ["warned"]).output == "Warning: the later one is taken\n"
