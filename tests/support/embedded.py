"""Programs in C and Fortran that are compiled with the library of the hook, and run."""

from __future__ import annotations

import os
import shutil
import subprocess
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import pytest

from insitu.bindings.build import BuildError, build

ENVIRONMENT = {**os.environ, "OMP_NUM_THREADS": "1", "LP_NUM_THREADS": "1"}


def run(*command: object, **environment: str) -> subprocess.CompletedProcess[str]:
    """A command's status, output and errors."""
    return subprocess.run(
        [str(part) for part in command],
        capture_output=True,
        text=True,
        timeout=200,
        env={**ENVIRONMENT, **environment},
        check=False,
    )


@dataclass(frozen=True)
class Library:
    """The built library in a folder; its programs are compiled into `programs`."""

    folder: Path
    programs: Path

    def program(self, source: Path | str, *options: str, compiler: str = "cc", suffix: str = ".c") -> Path:
        """The program of a source file, or of its text; the test is skipped without the compiler, and fails on warnings."""
        if shutil.which(compiler) is None:
            pytest.skip(f"needs {compiler}")
        number = len(list(self.programs.iterdir()))
        folder = self.programs / str(number)
        folder.mkdir(parents=True)
        if isinstance(source, str):
            file = folder / f"program{suffix}"
            file.write_text(source)
        else:
            file = source
        done = run(compiler, *options, *self._compiled(file, folder), "-o", folder / "program")
        assert done.returncode == 0, done.stderr
        return folder / "program"

    def _compiled(self, file: Path, folder: Path) -> Sequence[object]:
        module = [f"-J{folder}", self.folder / "insitu.f90"] if file.suffix == ".f90" else [f"-I{self.folder}"]
        return [*module, file, f"-L{self.folder}", "-linsitu", f"-Wl,-rpath,{self.folder}", "-lm", "-pthread"]


def built(folder: Path) -> Library:
    """The library, built in a folder; the test is skipped where that can't be."""
    try:
        build(folder / "library")
    except BuildError as error:
        pytest.skip(str(error))
    (folder / "programs").mkdir()
    return Library(folder / "library", folder / "programs")
