"""Missing packages: the extra that brings each, in one sentence from every command and public name."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
import tomllib
from importlib.metadata import packages_distributions
from pathlib import Path

import numpy as np
import pytest

from catalogs.extras import OF_PACKAGE, remedy

PROJECT = Path(__file__).resolve().parents[2]
SENTENCE = r"^Error: `{command}` needs the package {package}: pip install 'gs-surrogate\[{extra}\]'$"


def test_the_table_is_that_of_the_projects_extras() -> None:
    """Each package that an extra names is imported by the name that the table has."""
    project = tomllib.loads((PROJECT / "pyproject.toml").read_text())["project"]
    not_imported = ("all", "test", "docs")
    extras = {name: texts for name, texts in project["optional-dependencies"].items() if name not in not_imported}
    brought: dict[str, set[str]] = {}
    for extra, texts in extras.items():
        for text in texts:
            brought.setdefault(re.split(r"[\[>=<; ]", text)[0].lower().replace("_", "-"), set()).add(extra)
    brought.pop("gs-surrogate")
    distributions = {**packages_distributions(), "vtkmodules": ["vtk"]}
    for package, extra in OF_PACKAGE.items():
        for name in distributions.get(package, ()):
            found = brought.pop(name.lower().replace("_", "-"), set())
            assert extra in found or (extra == "" and len(found) != 1), package
    assert brought.keys() <= {"gsplat", "ninja"}, "all others are installed where tests run"


@pytest.mark.parametrize(
    ("package", "extra", "wanted"),
    [
        ("torch", "surrogate", "X needs the package torch: pip install 'gs-surrogate[surrogate]'"),
        ("torch.nn", "explore", "X needs the package torch: pip install 'gs-surrogate[explore]'"),
        ("xarray", "insitu", "X needs the package xarray: pip install 'gs-surrogate[xarray]'"),
        ("psutil", "insitu", "X needs the package psutil: pip install 'gs-surrogate[insitu]'"),
        ("numpy", "", "X needs the package numpy: pip install 'gs-surrogate'"),
        ("numcodecs", "insitu", "X needs the package numcodecs, which is not installed"),
    ],
)
def test_the_extra_of_a_package_is_named(package: str, extra: str, wanted: str) -> None:
    assert remedy(ModuleNotFoundError(name=package), "X", extra) == wanted


def test_a_sentence_of_a_reader_is_kept_and_a_module_of_ours_is_a_bug() -> None:
    assert remedy(ModuleNotFoundError("reading it takes xarray"), "X", "insitu") == "reading it takes xarray"
    with pytest.raises(ModuleNotFoundError):
        remedy(ModuleNotFoundError(name="catalogs.nowhere"), "X", "insitu")


@pytest.mark.parametrize(
    ("package", "commands"),
    [
        (
            "torch",
            {
                "surrogate train c.cdb": "surrogate",
                "surrogate train scene.toml": "surrogate",
                "surrogate evaluate run": "surrogate",
                "surrogate show run": "surrogate",
                "surrogate explore run": "explore",
                "surrogate sweep run --over p -o a.gif": "explore",
            },
        ),
        pytest.param("aiohttp", {"surrogate explore run": "explore"}, marks=pytest.mark.slow),
        pytest.param("safetensors", {"surrogate export run -o a.png": "explore"}, marks=pytest.mark.slow),
        ("vtkmodules", {"insitu probe field.npy": "insitu"}),
        (
            "psutil",
            {
                "insitu ensemble m_{i}.npy --catalog b.cdb": "insitu",
                "insitu watch . --catalog b.cdb --pattern m_{i}.npy": "insitu",
                "insitu dataset scene.toml": "insitu",
            },
        ),
        ("numpy", {"catalogs check c.cdb": ""}),
    ],
)
def test_a_command_names_the_extra_of_a_missing_package(tmp_path: Path, package: str, commands: dict[str, str]) -> None:
    for (words, extra), (code, output, error) in zip(
        commands.items(), without(tmp_path, [package], list(commands)), strict=True
    ):
        command = words.split()[1]
        wanted = SENTENCE.format(command=command, package=package, extra=extra).replace(r"\[\]", "")
        assert code == 1, error
        assert re.search(wanted, error.strip()), error
        assert output == ""


def test_files_of_an_extra_name_it_too(tmp_path: Path) -> None:
    commands = ["insitu probe a.nc", "insitu ensemble a.nc --catalog b.cdb"]
    for code, _, error in without(tmp_path, ["netCDF4", "xarray", "h5netcdf"], commands):
        assert code == 1
        assert re.fullmatch(r"Error: reading .*: pip install 'gs-surrogate\[\w+\]'\n", error), error


# Each command runs in a process of its own, forked from one that has loaded what the commands share.
RUN = """
import importlib, os, sys
hidden, commands = {hidden!r}, {commands!r}
sys.modules.update(dict.fromkeys(hidden))
for program in sorted({{words.split()[0] for words in commands}}):
    importlib.import_module(program + ".cli")
for number, words in enumerate(commands):
    if not (child := os.fork()):
        for descriptor, name in ((1, "out"), (2, "err")):
            os.dup2(os.open(f"{{number}}.{{name}}", os.O_WRONLY | os.O_CREAT), descriptor)
        program, *arguments = words.split()
        importlib.import_module(program + ".cli").main(arguments)
        os._exit(0)
    _, status = os.waitpid(child, 0)
    print(os.waitstatus_to_exitcode(status), flush=True)
"""


def without(folder: Path, hidden: list[str], commands: list[str]) -> list[tuple[int, str, str]]:
    """The exit status, output and errors of commands in `folder` where packages can't be imported."""
    for name in ("field", "m_1", "m_2"):
        np.save(folder / f"{name}.npy", np.zeros((4, 4, 4)))
    (folder / "a.nc").write_bytes(b"CDF\x05" + bytes(44))
    (folder / "c.cdb").mkdir()
    (folder / "c.cdb" / "catalog.json").write_text(json.dumps({"schema": 1}))
    (folder / "run" / "surrogate").mkdir(parents=True)
    (folder / "scene.toml").write_text((PROJECT / "scenes" / "tiny.toml").read_text())
    text = RUN.format(hidden=hidden, commands=commands)
    environment = {**os.environ, "PYTHONPATH": str(PROJECT)}
    done = subprocess.run([sys.executable, "-c", text], cwd=folder, env=environment, capture_output=True, text=True)
    codes = [int(line) for line in done.stdout.split()]
    assert len(codes) == len(commands), done.stderr
    return [(c, *((folder / f"{i}.{name}").read_text() for name in ("out", "err"))) for i, c in enumerate(codes)]  # type: ignore[misc]
