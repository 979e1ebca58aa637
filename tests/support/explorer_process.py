"""The explorer as a process of its own."""

from __future__ import annotations

import re
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from tests.support.prepared import Program

COMMAND = Path(sys.executable).with_name("surrogate")
PROGRAM = "from surrogate.cli import main; main()"


@contextmanager
def installed(*arguments: object) -> Iterator[tuple[subprocess.Popen[str], str]]:
    """The running command as it is installed, and the first line that it prints."""
    process = subprocess.Popen(
        [COMMAND, "explore", *map(str, arguments)], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )
    try:
        assert process.stdout is not None
        yield process, process.stdout.readline()
    finally:
        process.kill()
        process.wait()


@contextmanager
def command(*arguments: object) -> Iterator[tuple[Program, str]]:
    """The same, in a process that need not import it first."""
    process = Program(PROGRAM, "explore", *arguments)
    try:
        yield process, process.stdout.readline()
    finally:
        process.close()


def address_in(line: str) -> str:
    (address,) = re.findall(r"http://\S+", line)
    return str(address)
