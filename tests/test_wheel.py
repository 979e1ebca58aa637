"""The contents of the wheel."""

from __future__ import annotations

import configparser
import os
import subprocess
import sys
import zipfile
from pathlib import Path

import numpy as np
import pytest

from tests.support.installed import PROJECT

PACKAGES = ("catalogs", "insitu", "render", "surrogate")
COMMANDS = ("catalogs", "insitu", "surrogate")


@pytest.mark.slow
def test_the_wheel_holds_the_five_packages_alone(wheel: Path) -> None:
    with zipfile.ZipFile(wheel) as archive:
        names = archive.namelist()
        (about,) = {name.split("/")[0] for name in names} - {*PACKAGES, "native"}
        commands = archive.read(f"{about}/entry_points.txt").decode()
    assert about.endswith(".dist-info")
    for package in PACKAGES:
        assert {f"{package}/__init__.py", f"{package}/__init__.pyi", f"{package}/py.typed"} <= set(names)
    assert {name.rpartition(".")[2] for name in names} >= {"py", "pyi", "js", "css", "html"}
    assert "native/kernels/_kernels.pyi" in names
    assert not [name for name in names if name.endswith((".cpp", ".hpp", ".inc")) or "test" in name.lower()]
    entries = configparser.ConfigParser()
    entries.read_string(commands)
    assert dict(entries["console_scripts"]) == {name: f"{name}.cli:main" for name in COMMANDS}
    assert set(entries.sections()) == {"console_scripts", "gs_surrogate.scene_tables"}


@pytest.mark.slow
def test_without_a_compiler_all_but_the_kernels_is_installed(tmp_path: Path) -> None:
    """`pip install '.[insitu]'` on a compute node that has no C++ compiler."""
    build = [sys.executable, "-m", "pip", "wheel", "--quiet", "--no-deps", "--wheel-dir", str(tmp_path)]
    options = ["--no-build-isolation", "--config-settings", f"build-dir={tmp_path / 'build'}", str(PROJECT)]
    pytest.importorskip("scikit_build_core")
    built = subprocess.run([*build, *options], env={**os.environ, "CXX": "/bin/false"}, capture_output=True, text=True)
    assert built.returncode == 0, built.stderr
    (made,) = tmp_path.glob("*.whl")
    with zipfile.ZipFile(made) as archive:
        assert not [name for name in archive.namelist() if name.endswith(".so")]
        archive.extractall(tmp_path / "packages")
    program = "import insitu, render, catalogs; insitu.Session; print(insitu.__file__)\nimport native.kernels"
    path = os.pathsep.join([str(tmp_path / "packages"), str(Path(np.__file__).parent.parent)])
    outside = {**os.environ, "PYTHONPATH": path}
    ran = subprocess.run(
        [sys.executable, "-S", "-c", program], env=outside, cwd=tmp_path, capture_output=True, text=True
    )
    assert ran.stdout.startswith(str(tmp_path / "packages")), ran.stderr
    last = ran.stderr.strip().splitlines()[-1]
    assert last.startswith("ModuleNotFoundError: the C++ kernels of gs-surrogate were not built")
    assert "install g++ and python3-dev" in last
