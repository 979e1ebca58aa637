"""Commands in the environments of simulation codes, which `make examples` makes."""

from __future__ import annotations

import os
import subprocess
from pathlib import Path

import pytest

PROJECT = Path(__file__).resolve().parents[2]


def in_environment(example: str, *command: str, folder: Path | None = None, seconds: float = 240.0) -> str:
    """Standard output of a command of an example's environment, run in `folder`; the test skips where there is none."""
    environment = PROJECT / f".venv-{example}"
    if not (environment / ".complete").exists():
        pytest.skip(f"the environment of examples/{example} is not made: `make examples` does it")
    done = subprocess.run(
        [environment / "bin" / command[0], *command[1:]],
        cwd=folder or PROJECT,
        env={**os.environ, "OMP_NUM_THREADS": "1", "LP_NUM_THREADS": "1"},
        capture_output=True,
        text=True,
        timeout=seconds,
        check=False,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


def with_settings(scene: str, folder: Path, replaced: dict[str, str]) -> Path:
    """A scene of the repository with parts of its text replaced, in a file of `folder`."""
    text = (PROJECT / f"scenes/{scene}.toml").read_text().replace("../examples", str(PROJECT / "examples"))
    for old, new in replaced.items():
        assert old in text, old
        text = text.replace(old, new)
    path = folder / f"{scene}.toml"
    path.write_text(text)
    return path
