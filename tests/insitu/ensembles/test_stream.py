"""Steps of a stream become members as they arrive."""

from __future__ import annotations

import importlib.util
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from catalogs.store.catalog import Catalog
from catalogs.tools.check import check
from catalogs.vocabulary.appearance import Isosurface
from catalogs.vocabulary.parameters import Parameter, ParameterSpace
from catalogs.vocabulary.scene import ViewPlan
from insitu.cli import main
from insitu.ensembles.stream import StreamResult, render_stream
from insitu.members.planning import PlanOptions
from insitu.readers.adios import StreamStep
from insitu.readers.arrays import Arrays, StoredArray
from tests.support.adios_writer import start
from tests.support.hooked import SPACING, blob

PROJECT = Path(__file__).resolve().parents[3]
SPACE = ParameterSpace((Parameter("time", 0.0, 9.0),))
OPTIONS = PlanOptions(SPACE, (Isosurface("core", 0.5),), ViewPlan(frequency=1, width=8, height=8))


def step(number: int, **more: float) -> StreamStep:
    values = blob(0.3 + 0.05 * number)
    array = StoredArray("u", values.shape, values.dtype, ("", "", ""), {}, lambda index: values[index])
    return StreamStep(number, {"time": 0.5 * number, **more}, Arrays({"u": array}, {"": {"spacing": SPACING}}))


def test_every_step_is_a_member_once(tmp_path: Path) -> None:
    first = render_stream(tmp_path / "a.cdb", [step(0), step(1)], OPTIONS)
    assert (first.rendered, first.skipped, first.failures) == (["time-0.0", "time-0.5"], [], {})
    said: list[str] = []
    again = render_stream(tmp_path / "a.cdb", [step(0), step(1), step(2)], OPTIONS, arrays=("u",), say=said.append)
    assert (again.rendered, again.skipped) == (["time-1.0"], ["time-0.0", "time-0.5"])
    assert said == ["rendered time-1.0; 1 in all"]
    assert check(tmp_path / "a.cdb") == []


def test_a_step_that_cannot_be_rendered_costs_itself_alone(tmp_path: Path) -> None:
    broken = step(1)
    broken.arrays.arrays["u"].fetch(())[0, 0, 0] = np.nan
    silent = StreamStep(3, {}, step(3).arrays)
    found = render_stream(tmp_path / "a.cdb", [step(0), broken, step(2), silent], OPTIONS)
    assert found.rendered == ["time-0.0", "time-1.0"]
    assert list(found.failures) == ["time-0.5", "step 3"]
    assert "NaN" in found.failures["time-0.5"]
    assert "it does not say ['time']" in found.failures["step 3"]


def test_steps_without_the_field_are_left_out_and_said_once(tmp_path: Path) -> None:
    said: list[str] = []
    without = [StreamStep(number, {"time": 0.5 * number}, Arrays({}, {"": {}})) for number in (1, 3)]
    found = render_stream(tmp_path / "a.cdb", [step(0), without[0], step(2), without[1]], OPTIONS, say=said.append)
    assert (found.rendered, found.failures, found.lacking) == (["time-0.0", "time-1.0"], {}, ["step 1", "step 3"])
    assert [line for line in said if "lacks" in line] == ["step 1 lacks a field; such steps are left out"]
    with pytest.raises(ValueError, match="none of 2 steps had v"):
        render_stream(tmp_path / "b.cdb", [step(0), step(1)], OPTIONS, arrays=("v",))


def test_what_an_interruption_leaves_is_whole(tmp_path: Path) -> None:
    def steps() -> Iterator[StreamStep]:
        yield step(0)
        raise KeyboardInterrupt

    arrived = StreamResult()
    with pytest.raises(KeyboardInterrupt):
        render_stream(tmp_path / "a.cdb", steps(), OPTIONS, arrived=arrived)
    assert arrived.rendered == ["time-0.0"]
    assert [member.name for member in Catalog.open(tmp_path / "a.cdb").members] == ["time-0.0"]


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ([], "please give --pattern"),
        (["--reader", "mpas"], "please give --pattern"),
        (["--reader", "adios2"], "please give --bounds NAME LOW HIGH"),
        (["--pattern", "a_{time}.npy"], "there is no folder"),
    ],
)
def test_a_wrong_command_is_one_error(tmp_path: Path, options: list[str], message: str) -> None:
    (tmp_path / "look.toml").write_text('[[appearance]]\nkind = "isosurface"\nname = "core"\nisovalue = 0.5\n')
    command = ["watch", str(tmp_path / "run.bp"), "--catalog", str(tmp_path / "a.cdb")]
    result = CliRunner().invoke(main, [*command, "--appearance", str(tmp_path / "look.toml"), *options])
    assert (result.exit_code, len(result.output.strip().splitlines())) == (1, 1)
    assert message in result.output


@pytest.mark.slow
@pytest.mark.skipif(importlib.util.find_spec("adios2") is None, reason="adios2 is not installed")
def test_the_command_follows_a_simulation_to_its_end(tmp_path: Path) -> None:
    (tmp_path / "look.toml").write_text('[[appearance]]\nkind = "isosurface"\nname = "core"\nisovalue = 0.5\n')
    command = [sys.executable, "-c", "from insitu.cli import main; main()", "watch", str(tmp_path / "run.sst")]
    command += ["--reader", "adios2", "--array", "density", "--bounds", "time", "0", "9", "--size", "8"]
    command += [
        "--catalog",
        str(tmp_path / "a.cdb"),
        "--appearance",
        str(tmp_path / "look.toml"),
        "--until-idle",
        "100",
    ]
    watching = subprocess.Popen(command, cwd=PROJECT, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    writer = start(tmp_path / "run", "SST", 3)
    try:
        told, noted = watching.communicate(timeout=200)
        assert watching.returncode == 0, noted
        assert "3 members" in told
        assert writer.wait(60) == 0
    finally:
        watching.kill()
        writer.kill()
    names = [member.name for member in Catalog.open(tmp_path / "a.cdb").members]
    assert names == ["time-0.0", "time-0.5", "time-1.0"]
