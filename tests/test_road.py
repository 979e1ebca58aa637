"""The road of a person with an ensemble of their own, as the README tells it: the loop, training, the report, the explorer.

The project is packed, installed into a fresh virtual environment and used from an empty folder, so that nothing of the source
tree can help.  Only its dependencies and its compiled kernels are taken from the environment of the tests.
"""

from __future__ import annotations

import re
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pytest

from catalogs import Catalog
from catalogs.tools.check import check
from tests.support.browsers import pixels
from tests.support.explored import settled
from tests.support.explorer_process import address_in
from tests.support.installed import environment, run_installed

if TYPE_CHECKING:
    from playwright.sync_api import Page

PROJECT = Path(__file__).resolve().parent.parent
ROAD = re.search(r"^## Two minutes\n(.*?)^## ", (PROJECT / "README.md").read_text(), re.DOTALL | re.MULTILINE)
SMALLER = {  # what the README prints, and what is enough for a test
    "frequency=2, width=128, height=128": "frequency=1, width=64, height=64",
    "[np.linspace(-1, 1, 48)]": "[np.linspace(-1, 1, 24)]",
    "2 / 47": "2 / 23",
    "np.linspace(0, 2, 5)": "np.linspace(0, 2, 3)",
    "--minutes 1": "--steps 90 gaussians=300",
}


def smaller(text: str) -> str:
    for printed, enough in SMALLER.items():
        text = text.replace(printed, enough)
    return text


def section() -> str:
    assert ROAD is not None, "the README has no section `Two minutes`"
    return ROAD[1]


def blocks(language: str) -> list[str]:
    return re.findall(rf"^```{language}\n(.*?)^```", section(), re.DOTALL | re.MULTILINE)


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """An empty folder to work in."""
    return tmp_path_factory.mktemp("work")


def run(command: list[str], installed: Path, place: Path) -> str:
    done = run_installed(command, installed, place)
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


@contextmanager
def running(command: str, installed: Path, place: Path) -> Iterator[str]:
    """The first line that a command prints; it is stopped afterwards."""
    process = subprocess.Popen(
        command.split(),
        cwd=place,
        env=environment(installed),
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
    )
    try:
        assert process.stdout is not None
        yield process.stdout.readline()
    finally:
        process.kill()
        process.wait()


@pytest.mark.slow(seconds=25)
@pytest.mark.timeout(600)
def test_from_a_loop_of_ones_own_to_the_explorer(installed: Path, place: Path, page: Page) -> None:
    (loop, in_python), (commands,) = blocks("python"), blocks("sh")
    assert all(printed in loop + commands for printed in SMALLER)
    (place / "heat.py").write_text(smaller(loop))
    python = str(installed / "python")
    run([python, "heat.py"], installed, place)
    catalog = Catalog.open(place / "heat.cdb")
    assert check(catalog.path) == []
    assert len(catalog.members) == 15
    stored = {path: path.stat().st_mtime_ns for path in catalog.path.rglob("*.png")}
    run([python, "heat.py"], installed, place)  # a restarted simulation renders nothing twice
    assert stored == {path: path.stat().st_mtime_ns for path in catalog.path.rglob("*.png")}

    lines = [line.split("#")[0].strip() for line in commands.splitlines()]
    assert lines[0] == "python heat.py"
    train, evaluate, explore, export = lines[1:]
    run(smaller(train).split(), installed, place)
    (place / "look.py").write_text(
        f"{in_python}\nassert picture.shape == (64, 64, 4) and picture[..., 3].max() > 0.2\n"
        "import insitu, surrogate\nprint(insitu.__file__, surrogate.__file__, sep='\\n')\n"
    )
    for where in run([python, "look.py"], installed, place).splitlines():
        assert Path(where).is_relative_to(installed.parent)
    run(evaluate.split(), installed, place)
    report = (place / "runs/heat/report/report.md").read_text()
    assert "unseen parameters" in report
    with running(explore, installed, place) as line:
        page.goto(address_in(line))
        page.wait_for_function("() => document.title.includes('heat')")
        picture = page.locator("canvas, img").first
        picture.wait_for()
        settled(page)
        assert np.ptp(pixels(picture).reshape(-1, 3), axis=0).max() > 60  # something is to be seen
        run(export.split(), installed, place)
        page.goto((place / "heat.html").as_uri())
        page.wait_for_function("() => document.documentElement.dataset.shown")
        assert np.ptp(pixels(page.locator("canvas").first).reshape(-1, 3), axis=0).max() > 60
