"""Scenes whose fields a function makes: a caller's own, or that of a script."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from numpy.typing import NDArray

import insitu
from catalogs.store.catalog import Catalog
from catalogs.tools.check import check
from catalogs.vocabulary.scene import PlannedMember, Scene
from insitu.cli import main
from insitu.ensembles.dataset import make_dataset
from insitu.ensembles.function_source import HookedSource
from insitu.ensembles.sources import ensemble_of
from insitu.fields.field import Field
from tests.support.scenes import scene

pytestmark = pytest.mark.usefixtures("prepared_workers")

HOOKED = """
name = "ball"
[source]
kind = "hooked"
script = "ball/simulation.py"
settings = { size = 9 }
[[parameters]]
name = "radius"
low = 0.3
high = 0.9
[members]
train = [0.3, 0.9]
test = [0.6]
[[appearance]]
kind = "volume"
name = "dvr"
[appearance.transfer_function]
color_points = [[-1.0, 0.0, 0.0, 1.0], [1.0, 1.0, 0.0, 0.0]]
opacity_points = [[-1.0, 0.0], [1.0, 0.8]]
opacity_unit_distance = 0.5
[views]
frequency = 1
width = 16
height = 16
[render]
target_decibels = 35.0
"""
TIMED = HOOKED.replace("[members]", '[[parameters]]\nname = "time"\nlow = 0.0\nhigh = 2.0\n[members]').replace(
    "train = [0.3, 0.9]\ntest = [0.6]",
    "train = [{ radius = 0.3, time = [0.5, 2.0] }, { radius = 0.9, time = 1.0 }]\ntest = [{ radius = 0.3, time = 1.0 }]",
)
WITHOUT_SCRIPT = HOOKED.replace('script = "ball/simulation.py"\n', "")
SCRIPT = """
from tests.insitu.ensembles.test_function_source import ball as simulate
"""


def ball(parameters: Mapping[str, float], size: int) -> Field:
    """The depth within a ball around the middle of the cube [-1, 1]³."""
    return Field(depth(parameters["radius"], size), (2.0 / (size - 1),) * 3, (-1.0,) * 3)


def depth(radius: float, size: int) -> NDArray[np.float32]:
    axis = np.linspace(-1.0, 1.0, size)
    z, y, x = np.meshgrid(axis, axis, axis, indexing="ij")
    return (radius - np.sqrt(x**2 + y**2 + z**2)).astype(np.float32)


def shell(parameters: Mapping[str, float], size: int) -> Field:
    """A ball without values around it."""
    found = ball(parameters, size)
    return Field(np.where(found.values < -0.5, np.nan, found.values), found.spacing, found.origin)


def growing(parameters: Mapping[str, float], times: Sequence[float], size: int) -> Iterator[Field]:
    """A ball whose radius grows by a tenth in each unit of time."""
    assert set(parameters) == {"radius"}
    assert list(times) == sorted(times)
    for time in times:
        yield ball({"radius": parameters["radius"] + 0.1 * time}, size)


def broken(parameters: Mapping[str, float], size: int) -> Field:
    if parameters["radius"] == 0.6:
        raise ArithmeticError("the time step fell below 1e-12")
    return ball(parameters, size)


def with_script(folder: Path, text: str = SCRIPT, requirements: str | None = None) -> Scene:
    (folder / "ball").mkdir()
    (folder / "ball/simulation.py").write_text(text)
    if requirements is not None:
        (folder / "ball/requirements.txt").write_text(requirements)
    return scene(folder, HOOKED)


def center_of(catalog: Path, member: str) -> float:
    """The largest value of a member, which is that in the middle."""
    return float(Catalog.open(catalog).member(member).summary().maximum)


@pytest.mark.slow
def test_a_function_makes_the_members_of_a_scene(tmp_path: Path) -> None:
    assert insitu.make_dataset is make_dataset
    asked = scene(tmp_path, WITHOUT_SCRIPT)
    result = insitu.make_dataset(asked.path, tmp_path / "runs", simulate=ball, workers=1)
    assert (result.members, result.made, result.failures) == (3, 3, {})
    assert check(result.catalog) == []
    made = Catalog.open(result.catalog)
    assert [(m.name, m.split) for m in made.members] == [
        ("test-000", "test"),
        ("train-000", "train"),
        ("train-001", "train"),
    ]
    for member in made.members:
        assert center_of(result.catalog, member.name) == pytest.approx(member.parameters["radius"])
    source = made.members[0].provenance["source"]
    assert source == {"kind": "hooked", "script": "ball", "settings": {"size": 9}}
    assert not (result.catalog.parent / "pilots").exists()
    assert insitu.make_dataset(asked, tmp_path / "runs", simulate=ball).made == 0


@pytest.mark.slow
def test_dumps_of_a_run_are_asked_for_in_the_order_of_time(tmp_path: Path) -> None:
    asked = scene(tmp_path, TIMED.replace('script = "ball/simulation.py"\n', ""))
    result = make_dataset(asked, tmp_path / "runs", simulate=growing, workers=1)
    assert (result.made, result.failures) == (4, {})
    for member in Catalog.open(result.catalog).members:
        radius = member.parameters["radius"] + 0.1 * member.parameters["time"]
        assert center_of(result.catalog, member.name) == pytest.approx(radius)


def test_runs_hold_the_members_that_differ_in_time_alone() -> None:
    members = [PlannedMember(str(t), {"a": a, "time": t}, "train") for a, t in ((1.0, 3.0), (2.0, 2.5), (1.0, 0.5))]
    grouped = HookedSource(growing, "growing", in_time=True).runs(members)
    assert [[m.name for m in run] for run in grouped] == [["0.5", "3.0"], ["2.5"]]
    assert [len(run) for run in HookedSource(ball, "ball").runs(members)] == [1, 1, 1]


def test_a_run_is_not_carried_on_beyond_its_last_dump() -> None:
    def endless(parameters: Mapping[str, float], times: Sequence[float]) -> Iterator[Field]:
        for number in range(100):
            assert number < len(times)
            yield ball({"radius": 0.5}, 3)

    members = [PlannedMember(str(t), {"time": t}, "train") for t in (1.0, 2.0)]
    assert len(list(HookedSource(endless, "endless", in_time=True).dumps(members, lambda fraction: None))) == 2


@pytest.mark.slow
def test_a_script_runs_from_the_command_line_over_processes(tmp_path: Path) -> None:
    asked = with_script(tmp_path)
    arguments = ["dataset", str(asked.path), "--runs", str(tmp_path / "runs"), "--workers", "2"]
    done = CliRunner().invoke(main, arguments)
    assert done.exit_code == 0, done.output
    catalog = asked.run_directory(tmp_path / "runs") / "catalog.cdb"
    assert len(Catalog.open(catalog).members) == 3
    assert Catalog.open(catalog).members[0].provenance["source"]["script"] == "ball/simulation.py"
    (tmp_path / "ball/simulation.py").write_text(SCRIPT + "# a remark")  # what is complete stays
    assert "nothing to do" in CliRunner().invoke(main, arguments).output


@pytest.mark.slow
def test_a_member_that_fails_costs_no_other_and_is_tried_again(tmp_path: Path) -> None:
    asked = scene(tmp_path, WITHOUT_SCRIPT)
    first = make_dataset(asked, tmp_path / "runs", simulate=broken, workers=1)
    assert first.made == 2
    assert "time step" in first.failures["test-000"]
    with pytest.raises(ValueError, match="is not the one that"):
        make_dataset(
            scene(tmp_path, WITHOUT_SCRIPT.replace("low = 0.3", "low = 0.1")), tmp_path / "runs", simulate=ball
        )


@pytest.mark.slow
def test_values_that_are_not_there_are_refused_or_transparent(tmp_path: Path) -> None:
    refused = scene(tmp_path, WITHOUT_SCRIPT)
    with pytest.raises(ValueError, match="NaN"):
        make_dataset(refused, tmp_path / "runs", simulate=shell, workers=1)
    asked = scene(tmp_path, WITHOUT_SCRIPT + 'nan = "transparent"\n')
    result = make_dataset(asked, tmp_path / "runs", simulate=shell, workers=1)
    assert (result.made, result.failures) == (3, {})  # two of them by way of the folder of pilots


@pytest.mark.parametrize(
    ("old", "new", "named"),
    [
        ('script = "ball/simulation.py"', 'script = "none.py"', r"none\.py"),
        ('script = "ball/simulation.py"', "script = 3", "source.script"),
        ('script = "ball/simulation.py"', "", "lacks script"),
        ("settings = { size = 9 }", "settings = 9", "source.settings"),
        ("settings = { size = 9 }", "settings = { size = nan }", "source.settings"),
        ("settings = { size = 9 }", "setting = { size = 9 }", "setting"),
    ],
)
def test_a_mistake_in_the_source_is_named_before_anything_is_written(
    tmp_path: Path, old: str, new: str, named: str
) -> None:
    with_script(tmp_path)
    with pytest.raises(ValueError, match=named):
        make_dataset(scene(tmp_path, HOOKED.replace(old, new)), tmp_path / "runs")
    assert not (tmp_path / "runs").exists()


@pytest.mark.parametrize(
    ("requirements", "remedy"), [("", "pip install -r "), (None, "install it there")], ids=["with", "without"]
)
def test_a_script_whose_code_is_not_installed_is_told_in_one_sentence(
    tmp_path: Path, requirements: str | None, remedy: str
) -> None:
    asked = with_script(tmp_path, "import no_such_package", requirements)
    done = CliRunner().invoke(main, ["dataset", str(asked.path), "--runs", str(tmp_path / "runs")])
    assert done.exit_code == 1
    assert "'no_such_package'" in done.output
    assert remedy in done.output
    assert "Traceback" not in done.output
    assert not (tmp_path / "runs").exists()


def test_a_script_without_the_function_is_named(tmp_path: Path) -> None:
    asked = with_script(tmp_path, "answer = 42")
    with pytest.raises(ValueError, match=r"no function simulate\(parameters"):
        make_dataset(asked, tmp_path / "runs")


def test_a_function_is_for_hooked_scenes_alone(tmp_path: Path) -> None:
    members = "train = [0.3, 0.9]\ntest = [0.6]\n"
    other = scene(tmp_path, HOOKED.replace('kind = "hooked"', 'kind = "hdf5"').replace(members, ""))
    with pytest.raises(ValueError, match="simulate="):
        make_dataset(other, tmp_path / "runs", simulate=ball)


def test_what_the_catalog_records_can_be_json() -> None:
    identity = HookedSource(ball, "ball.py", {"cells": 64}).identity
    assert json.loads(json.dumps(identity)) == identity


def test_an_edited_script_is_another_source(tmp_path: Path) -> None:
    asked = with_script(tmp_path)
    before = ensemble_of(asked).source.identity
    assert ensemble_of(asked).source.identity == before
    (tmp_path / "ball/simulation.py").write_text(f'"""What this is."""\n{SCRIPT}# edited')
    assert ensemble_of(asked).source.identity == before, "comments and docstrings make no other fields"
    (tmp_path / "ball/simulation.py").write_text(SCRIPT + "answer = 42")
    assert ensemble_of(asked).source.identity != before
    (tmp_path / "ball/simulation.py").write_text("no Python")
    with pytest.raises(ValueError, match="not a Python file"):
        ensemble_of(asked)
