import subprocess
import sys
from pathlib import Path

import click
import pytest

from surrogate.cli import main
from surrogate.command_line import OpenRun
from tests.support.results import SETTINGS_OF_SCENE, make_catalog, make_scene


def test_every_command_is_there_and_help_loads_nothing_heavy() -> None:
    names = ["ask", "docs", "doctor", "evaluate", "explore", "export", "show", "sweep", "train"]
    assert sorted(main.commands) == names
    program = (
        "import sys, surrogate.cli; print([n for n in ('torch', 'numpy', 'aiohttp', 'matplotlib') if n in sys.modules])"
    )
    assert subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True).stdout == "[]\n"


def test_a_scene_is_opened_with_its_data_set(tmp_path: Path) -> None:
    path, catalog = make_scene(tmp_path, "blobs"), make_catalog(tmp_path, "blobs")
    opened = OpenRun.open(path, tmp_path / "runs")
    assert (opened.name, opened.settings) == ("blobs", SETTINGS_OF_SCENE)
    assert opened.catalog.path == catalog.path
    assert (opened.folder, opened.model) == (tmp_path / "runs/blobs", tmp_path / "runs/blobs/surrogate")


def test_a_missing_data_set_is_named_with_what_makes_it(tmp_path: Path) -> None:
    with pytest.raises(click.ClickException, match=r"catalog\.cdb does not exist yet: make it with `insitu dataset "):
        OpenRun.open(make_scene(tmp_path, "blobs"), tmp_path / "runs")
