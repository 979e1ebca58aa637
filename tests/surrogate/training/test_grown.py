"""Members that were rendered after a run began are named, with the command that learns from them."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest
from click.testing import CliRunner

from catalogs.store.catalog import Catalog
from surrogate.cli import main
from surrogate.training.begin import TrainingOptions, begin
from surrogate.training.budget import Budget
from surrogate.training.messages import grown_line
from tests.support.results import make_catalog

SAID = (
    "2 members of {catalog} came after this run began: once it is finished, `surrogate train {folder} --new-members` goes on with "
    "them from its model"
)
OF_SCENE = (
    "2 members of {catalog} came after this run began: `surrogate train {catalog} -o {folder}-3` begins a run with them"
)


def add(catalog: Catalog, name: str, p: float) -> None:
    with catalog.begin_member(name, {"p": p}) as writer:
        for view, _ in enumerate(catalog.plan.cameras):
            writer.write_image("drawn", view, catalog.image("train-0", "drawn", view))


def test_members_that_came_later_are_counted(tmp_path: Path) -> None:
    catalog, folder = make_catalog(tmp_path, "flow"), tmp_path / "mine"
    run = begin(catalog.path, folder, TrainingOptions(Budget(steps=12), settings={"gaussians": 20}))
    assert grown_line(run.catalog, "drawn", folder) == ""
    assert grown_line(catalog, "drawn", folder) == ""  # a catalog of no run
    add(catalog, "late", 0.3)
    add(catalog, "later", 0.4)
    assert grown_line(run.catalog, "drawn", folder) == SAID.format(catalog=catalog.path, folder=folder)
    assert grown_line(run.catalog, "another", folder) == ""
    assert run.record is not None
    replace(run.record, asked={}).save(folder)
    folder.with_name("mine-2").mkdir()
    assert grown_line(run.catalog, "drawn", folder) == OF_SCENE.format(catalog=catalog.path, folder=folder)


@pytest.mark.slow
def test_the_command_says_so_before_and_after_training(tmp_path: Path) -> None:
    catalog, folder = make_catalog(tmp_path, "flow"), tmp_path / "mine"
    words = ["train", str(catalog.path), "-o", str(folder), "gaussians=20", "--steps", "12"]
    begin(catalog.path, folder, TrainingOptions(Budget(steps=12), settings={"gaussians": 20}))
    add(catalog, "late", 0.3)
    add(catalog, "later", 0.4)
    said = SAID.format(catalog=catalog.path, folder=folder)
    for arguments in (words, words, ["train", str(folder)]):
        result = CliRunner().invoke(main, arguments)
        assert result.exit_code == 0, result.output
        assert result.output.count(said) == 1
    assert "nothing to do" in result.output
    other = CliRunner().invoke(main, ["train", str(catalog.path), "-o", f"{folder}-2", "gaussians=20", "--steps", "12"])
    assert "6 members" in other.output
    assert "came after" not in other.output
