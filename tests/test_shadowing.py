"""A user's own files that are named as our packages are: nothing of ours is hidden silently."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from tests.support.installed import run_installed

pytestmark = pytest.mark.slow
LOOP = """
import numpy as np, insitu
axis = np.linspace(-1, 1, 12)
z, y, x = np.meshgrid(axis, axis, axis, indexing="ij")
blob = insitu.Isosurface("blob", 0.5)
with insitu.Session("blob.cdb", space={"a": (0, 1)}, appearances=blob, views=insitu.ViewPlan(1, 16, 16),
                    background=BACKGROUND) as session:
    session.render_member(np.exp(-x * x - y * y - z * z), {"a": 0.5}, spacing=(0.1, 0.1, 0.1))
print(len(insitu.Catalog.open("blob.cdb").members))
"""
THEIRS = "raise SystemExit('a file of the user ran')\n"
IMPORTS = {
    "insitu": ("render", "native", "catalogs"),
    "render": ("native", "catalogs"),
    "surrogate": ("native", "catalogs"),
}


def write(place: Path, name: str, text: str) -> Path:
    (place / name).parent.mkdir(exist_ok=True)
    (place / name).write_text(text)
    return place / name


@pytest.mark.parametrize("shape", ["{}.py", "{}/__init__.py"])
@pytest.mark.parametrize(("ours", "theirs"), [(ours, name) for ours, names in IMPORTS.items() for name in names])
def test_the_first_import_names_the_file_and_the_remedy(
    installed: Path, tmp_path: Path, ours: str, theirs: str, shape: str
) -> None:
    hiding = write(tmp_path, shape.format(theirs), THEIRS)
    write(tmp_path, "script.py", f"import {ours}\nprint('imported')\n")
    refused = run_installed(["python", "script.py"], installed, tmp_path)
    assert refused.stderr.splitlines()[-1] == (
        f"ImportError: {hiding} hides the package `{theirs}` of gs-surrogate: rename it, or keep its folder from the path "
        "(python -P script.py)"
    )
    followed = run_installed(["python", "-P", "script.py"], installed, tmp_path)
    assert followed.stdout == "imported\n", followed.stderr


@pytest.mark.parametrize("first", ["import insitu", "import render, insitu"])
def test_a_script_that_has_the_name_itself(installed: Path, tmp_path: Path, first: str) -> None:
    script = write(tmp_path, "render.py", f"{first}\n")
    refused = run_installed(["python", "render.py"], installed, tmp_path)
    assert f"ImportError: {script} hides the package `render`" in refused.stderr


def test_folders_without_code_hide_nothing(installed: Path, tmp_path: Path) -> None:
    """A regular package further down the path goes before a folder that has no `__init__.py`."""
    for name in ("catalogs", "native", "render", "insitu", "surrogate"):
        write(tmp_path, f"{name}/notes.txt", "pictures of last year")
    write(tmp_path, "script.py", LOOP.replace("BACKGROUND", "False") + "import surrogate\n")
    done = run_installed(["python", "script.py"], installed, tmp_path)
    assert done.stdout == "1\n", done.stderr


def test_processes_that_we_start_look_elsewhere(installed: Path, tmp_path: Path) -> None:
    """The simulation's script lies elsewhere; the folder that it runs in has files of these names."""
    (tmp_path / "code").mkdir()
    place = tmp_path / "place"
    place.mkdir()
    for name in ("catalogs.py", "render.py", "insitu.py"):
        write(place, name, THEIRS)
    script = write(tmp_path / "code", "script.py", LOOP.replace("BACKGROUND", "True"))
    done = run_installed(["python", str(script)], installed, place)
    assert done.stdout == "1\n", done.stderr


@pytest.mark.parametrize("command", ["insitu", "catalogs", "surrogate"])
def test_commands_look_elsewhere(installed: Path, tmp_path: Path, command: str) -> None:
    for name in ("catalogs.py", "render.py", "insitu.py", "surrogate.py"):
        write(tmp_path, name, THEIRS)
    done = run_installed([command, "--help"], installed, tmp_path)
    assert done.returncode == 0, done.stderr
    assert "Usage" in done.stdout


def test_a_checkout_as_the_current_folder_hides_nothing(installed: Path) -> None:
    project = Path(__file__).resolve().parent.parent
    program = "import insitu, surrogate, os; print(os.path.dirname(os.path.dirname(insitu.__file__)))"
    done = run_installed(["python", "-c", program], installed, project)
    assert done.stdout.strip() == os.fspath(project), done.stderr
