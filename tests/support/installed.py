"""The project as a user installs it: packed as a wheel, in a fresh environment, with nothing of the source tree.

Its dependencies and its compiled kernels are those of the tests' environment.
"""

from __future__ import annotations

import fcntl
import os
import re
import shutil
import subprocess
import sys
from collections.abc import Callable, Sequence
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest

PROJECT = Path(__file__).resolve().parent.parent.parent


@pytest.fixture(scope="session")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The project's wheel, without the kernels, which were compiled when it was set up here."""
    (path,) = _made_once(tmp_path_factory, "wheel", _build).glob("*.whl")
    return path


@pytest.fixture(scope="session")
def installed(wheel: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The commands' folder of a fresh environment that holds the project."""
    return _made_once(tmp_path_factory, "fresh", lambda folder: _install(wheel, folder)) / "bin"


def _made_once(factory: pytest.TempPathFactory, name: str, make: Callable[[Path], None]) -> Path:
    """A folder that the first test process to ask for it makes, for all that run these tests side by side."""
    root = factory.getbasetemp()
    root = root.parent if "PYTEST_XDIST_WORKER" in os.environ else root
    folder, complete = root / name, root / f"{name}.complete"
    with (root / f"{name}.lock").open("w") as file:
        fcntl.flock(file, fcntl.LOCK_EX)
        if not complete.exists():
            make(folder)
            complete.touch()
    return folder


def _build(folder: Path) -> None:
    command = [sys.executable, "-m", "pip", "wheel", "--quiet", "--no-deps", "--wheel-dir", str(folder)]
    if find_spec("scikit_build_core"):  # else the build's own environment brings it, over the network
        command.append("--no-build-isolation")
    built = subprocess.run(
        [*command, "--config-settings", "wheel.cmake=false", str(PROJECT)], capture_output=True, text=True
    )
    if built.returncode != 0 and re.search("connection|No matching distribution|network", built.stderr, re.IGNORECASE):
        pytest.skip("the tools that build a wheel can't be had: no network")
    assert built.returncode == 0, built.stderr


def _install(wheel: Path, folder: Path) -> None:
    from native.kernels import _kernels

    subprocess.run([sys.executable, "-m", "venv", "--without-pip", str(folder)], check=True)
    (packages,) = folder.glob("lib/python*/site-packages")
    (packages / "dependencies.pth").write_text(f"{Path(np.__file__).parent.parent}\n")
    target = [str(folder / "bin" / "python"), "-m", "pip", "install", "--quiet", "--no-deps", "--no-index"]
    subprocess.run([*target, str(wheel)], check=True)
    shutil.copy(str(_kernels.__file__), packages / "native" / "kernels")


def environment(installed: Path) -> dict[str, str]:
    """The variables of a shell in which that environment is active."""
    own = {key: value for key, value in os.environ.items() if key != "PYTHONPATH"}
    return own | {"PATH": f"{installed}{os.pathsep}{own['PATH']}"}


def run_installed(command: Sequence[str], installed: Path, place: Path) -> subprocess.CompletedProcess[str]:
    """The output of one of its commands, or its `python`, in the folder `place`."""
    program = [str(installed / command[0]), *command[1:]]
    return subprocess.run(program, cwd=place, env=environment(installed), capture_output=True, text=True, timeout=300)
