"""The contents of the wheel."""

from __future__ import annotations

import zipfile
from pathlib import Path

import pytest

PACKAGES = ("catalogs", "insitu", "render", "surrogate")
COMMANDS = ("catalogs", "insitu", "surrogate")


@pytest.mark.slow
def test_the_wheel_holds_the_four_packages_alone(wheel: Path) -> None:
    with zipfile.ZipFile(wheel) as archive:
        names = archive.namelist()
        (about,) = {name.split("/")[0] for name in names} - set(PACKAGES)
        commands = archive.read(f"{about}/entry_points.txt").decode()
    assert about.endswith(".dist-info")
    for package in PACKAGES:
        assert {f"{package}/__init__.py", f"{package}/__init__.pyi", f"{package}/py.typed"} <= set(names)
    assert {name.rpartition(".")[2] for name in names} >= {"py", "pyi", "js", "css", "html"}
    assert "surrogate/kernels/_kernels.pyi" in names
    assert not [name for name in names if name.endswith((".cpp", ".hpp", ".inc")) or "test" in name.lower()]
    assert sorted(commands.split("\n")[1:]) == ["", "", *(f"{name} = {name}.cli:main" for name in COMMANDS)]
