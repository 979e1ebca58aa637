"""The stub that gives the kernels types."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

import native.kernels


@pytest.mark.slow
def test_the_stub_is_what_nanobind_writes(tmp_path: Path) -> None:
    """`python -m nanobind.stubgen -m native.kernels._kernels -O native/kernels` renews it."""
    pytest.importorskip("nanobind")
    command = [sys.executable, "-m", "nanobind.stubgen", "-q", "-m", "native.kernels._kernels", "-O", str(tmp_path)]
    subprocess.run(command, check=True)
    stub = Path(str(native.kernels.__file__)).parent / "_kernels.pyi"
    assert stub.read_text() == (tmp_path / "_kernels.pyi").read_text()
