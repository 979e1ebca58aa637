"""The project as a user installs it: packed as a wheel, in a fresh environment, with nothing of the source tree.

Its dependencies and its compiled kernels are those of the tests' environment.
"""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest

PROJECT = Path(__file__).resolve().parent.parent.parent


@pytest.fixture(scope="session")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The project's wheel, without the kernels, which were compiled when it was set up here."""
    folder = tmp_path_factory.mktemp("wheel")
    command = [sys.executable, "-m", "pip", "wheel", "--quiet", "--no-deps", "--wheel-dir", str(folder)]
    built = subprocess.run(
        [*command, "--config-settings", "wheel.cmake=false", str(PROJECT)], capture_output=True, text=True
    )
    if built.returncode != 0 and re.search("connection|No matching distribution|network", built.stderr, re.IGNORECASE):
        pytest.skip("the tools that build a wheel can't be had: no network")
    assert built.returncode == 0, built.stderr
    (made,) = folder.glob("*.whl")
    return made


@pytest.fixture(scope="session")
def installed(wheel: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The commands' folder of a fresh environment that holds the project."""
    from surrogate.kernels import _kernels

    folder = tmp_path_factory.mktemp("fresh")
    subprocess.run([sys.executable, "-m", "venv", "--without-pip", str(folder)], check=True)
    (packages,) = folder.glob("lib/python*/site-packages")
    (packages / "dependencies.pth").write_text(f"{Path(np.__file__).parent.parent}\n")
    target = [str(folder / "bin" / "python"), "-m", "pip", "install", "--quiet", "--no-deps", "--no-index"]
    subprocess.run([*target, str(wheel)], check=True)
    shutil.copy(str(_kernels.__file__), packages / "surrogate" / "kernels")
    return folder / "bin"


def environment(installed: Path) -> dict[str, str]:
    """The variables of a shell in which that environment is active."""
    own = {key: value for key, value in os.environ.items() if key != "PYTHONPATH"}
    return own | {"PATH": f"{installed}{os.pathsep}{own['PATH']}"}


def run_installed(command: Sequence[str], installed: Path, place: Path) -> subprocess.CompletedProcess[str]:
    """The output of one of its commands, or its `python`, in the folder `place`."""
    program = [str(installed / command[0]), *command[1:]]
    return subprocess.run(program, cwd=place, env=environment(installed), capture_output=True, text=True, timeout=300)
