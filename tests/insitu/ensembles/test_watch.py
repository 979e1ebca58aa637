"""A watched folder: a dump is rendered once, when it is whole, whatever happens on the way."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner

from catalogs.store.catalog import Catalog
from catalogs.tools.check import check
from catalogs.vocabulary.appearance import Isosurface
from catalogs.vocabulary.parameters import Parameter, ParameterSpace
from catalogs.vocabulary.scene import ViewPlan
from insitu.cli import main
from insitu.ensembles.ensemble import run_ensemble
from insitu.ensembles.files import FileEnsemble
from insitu.ensembles.watch import Arrivals, WatchOptions, space_for, watch_folder
from insitu.fields.location import FieldLocation
from insitu.members.planning import PlanOptions
from insitu.readers.tables import TableRow
from tests.support.executors import AtOnce
from tests.support.hooked import SPACING, blob

PROJECT = Path(__file__).resolve().parents[3]
SPACE = ParameterSpace((Parameter("w", 0.0, 1.0),))
OPTIONS = PlanOptions(SPACE, (Isosurface("core", 0.5),), ViewPlan(frequency=1, width=8, height=8))
ENSEMBLE = FileEnsemble({}, SPACE, location=FieldLocation(spacing=SPACING))
PATTERN = "dump_{w}.npy"


def touch(path: Path, size: int = 1, changed: float = 0.0) -> None:
    path.write_bytes(bytes(size))
    os.utime(path, (changed, changed))


def names(rows: Any) -> list[str]:
    return [row.path.name for row in rows]


def test_a_file_is_whole_when_it_rests(tmp_path: Path) -> None:
    arrivals = Arrivals(WatchOptions(tmp_path, PATTERN, settle=2.0))
    touch(tmp_path / "dump_1.npy", changed=90.0)  # long ago
    touch(tmp_path / "dump_2.npy", changed=99.5)  # just now
    touch(tmp_path / "dump_3.npy", size=0, changed=0.0)  # nothing in it yet
    (tmp_path / "other.txt").touch()
    assert names(arrivals.look(0.0, 100.0)) == ["dump_1.npy"]
    assert arrivals.pending == 3
    arrivals.tried(["w-1.0"], {}, {}, 0.0)
    touch(tmp_path / "dump_2.npy", size=2, changed=101.0)
    assert names(arrivals.look(1.0, 101.0)) == []
    assert names(arrivals.look(2.5, 102.5)) == []
    assert names(arrivals.look(3.5, 103.5)) == ["dump_2.npy"]


def test_a_clock_that_is_ahead_does_not_matter(tmp_path: Path) -> None:
    arrivals = Arrivals(WatchOptions(tmp_path, PATTERN, settle=2.0))
    touch(tmp_path / "dump_1.npy", changed=5000.0)
    assert arrivals.look(0.0, 100.0) == []
    assert names(arrivals.look(2.0, 102.0)) == ["dump_1.npy"]


def test_a_marker_says_that_a_file_is_whole(tmp_path: Path) -> None:
    arrivals = Arrivals(WatchOptions(tmp_path, PATTERN, marker=".done"))
    touch(tmp_path / "dump_1.npy")
    assert arrivals.look(0.0, 1000.0) == []
    touch(tmp_path / "dump_1.npy.done")
    assert names(arrivals.look(0.0, 1000.0)) == ["dump_1.npy"]


def test_what_fails_is_tried_again_for_a_while_and_when_it_changes(tmp_path: Path) -> None:
    arrivals = Arrivals(WatchOptions(tmp_path, PATTERN, settle=0.0, patience=60.0))
    touch(tmp_path / "dump_1.npy")
    tries = []
    for now in np.arange(0.0, 200.0, 0.5):
        rows = arrivals.look(float(now), 1000.0 + now)
        if rows:
            tries.append(now)
            arrivals.tried([], {"w-1.0": "torn"}, {"w-1.0": rows[0]}, float(now))
    assert tries[0] == 0.0
    assert 4 <= len(tries) <= 12
    assert 45.0 <= tries[-1] <= 60.0
    assert (arrivals.pending, arrivals.failures) == (0, {"w-1.0": "torn"})
    touch(tmp_path / "dump_1.npy", size=9)
    assert names(arrivals.look(300.0, 1300.0)) == ["dump_1.npy"]
    arrivals.tried(["w-1.0"], {}, {}, 300.0)
    assert (arrivals.failures, arrivals.done) == ({}, {"w-1.0"})


def watch(folder: Path, **more: Any) -> Arrivals:
    watching = WatchOptions(folder, PATTERN, **{"settle": 0.0, "patience": 0.0, "until_idle": 0.0, **more})
    return watch_folder(folder / "a.cdb", watching, ENSEMBLE, OPTIONS, executor=AtOnce())


def test_it_renders_what_is_there_once_and_goes_on(tmp_path: Path) -> None:
    np.save(tmp_path / "dump_0.2.npy", blob(0.4))
    (tmp_path / "dump_0.3.npy").write_bytes((tmp_path / "dump_0.2.npy").read_bytes()[:600])
    found = watch(tmp_path)
    assert (found.done, list(found.failures)) == ({"w-0.2"}, ["w-0.3"])
    np.save(tmp_path / "dump_0.3.npy", blob(0.5))
    np.save(tmp_path / "dump_0.5.npy", blob(0.6))
    before = (tmp_path / "a.cdb/members/w-0.2/member.json").stat().st_mtime_ns
    assert watch(tmp_path).done == {"w-0.2", "w-0.3", "w-0.5"}
    assert [m.name for m in Catalog.open(tmp_path / "a.cdb").members] == ["w-0.2", "w-0.3", "w-0.5"]
    assert (tmp_path / "a.cdb/members/w-0.2/member.json").stat().st_mtime_ns == before
    assert check(tmp_path / "a.cdb") == []


def test_a_dump_that_is_stored_under_another_name_is_done(tmp_path: Path) -> None:
    np.save(tmp_path / "dump_0.2.npy", blob(0.4))
    row = TableRow(tmp_path / "dump_0.2.npy", {"w": 0.2}, name="first")
    named = replace(ENSEMBLE, rows={"first": row})
    run_ensemble(tmp_path / "a.cdb", named.members(), named, OPTIONS, executor=AtOnce())
    found = watch(tmp_path)
    assert (found.done, found.failures) == ({"w-0.2"}, {})
    assert [m.name for m in Catalog.open(tmp_path / "a.cdb").members] == ["first"]


def test_a_first_dump_that_is_torn_makes_no_catalog(tmp_path: Path) -> None:
    (tmp_path / "dump_0.3.npy").write_bytes(b"torn")
    assert list(watch(tmp_path).failures) == ["w-0.3"]
    assert not (tmp_path / "a.cdb").exists()


def test_a_stored_dump_that_changed_is_named(tmp_path: Path) -> None:
    np.save(tmp_path / "dump_0.2.npy", blob(0.4))
    watch(tmp_path)
    np.save(tmp_path / "dump_0.2.npy", blob(0.7))
    with pytest.raises(ValueError, match=r"other contents of the files than they have now, of w-0\.2"):
        watch(tmp_path)


def test_bounds_are_asked_for(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="please give --bounds a LOW HIGH --bounds b LOW HIGH"):
        space_for(tmp_path / "a.cdb", "x_{a}/y_{b}.npy", {})
    with pytest.raises(ValueError, match=r"--bounds of c"):
        space_for(tmp_path / "a.cdb", "x_{a}.npy", {"a": (0, 1), "c": (0, 1)})
    assert str(space_for(tmp_path / "a.cdb", "x_{a}.npy", {"a": (0, 1)}, ["m"])) == "a in [0, 1] m"
    np.save(tmp_path / "dump_0.2.npy", blob(0.4))
    watch(tmp_path)
    assert space_for(tmp_path / "a.cdb", PATTERN, {}) == SPACE
    with pytest.raises(ValueError, match=r"the pattern names v"):
        space_for(tmp_path / "a.cdb", "dump_{v}.npy", {})


def test_parameters_that_files_say_take_a_reader(tmp_path: Path) -> None:
    bounds = {"a": (0.0, 1.0), "time": (0.0, 2.0)}
    assert space_for(tmp_path / "a.cdb", "run_{a}/plt*", bounds, more_in_files=True).names == ("a", "time")
    assert space_for(tmp_path / "a.cdb", "plt*", {"time": (0, 2)}, more_in_files=True).names == ("time",)
    with pytest.raises(ValueError, match="what files say takes --reader"):
        space_for(tmp_path / "a.cdb", "run_{a}/plt*", bounds)
    with pytest.raises(ValueError, match="please give --bounds NAME LOW HIGH"):
        space_for(tmp_path / "a.cdb", "plt*", {}, more_in_files=True)


def test_a_file_may_hold_several_members_and_have_parts(tmp_path: Path) -> None:
    """A file whose states are known when it is whole, with another one that belongs to it."""
    rows: dict[str, Any] = {"error": ValueError("torn")}

    def members(row: TableRow) -> list[TableRow]:
        if "error" in rows:
            raise rows["error"]
        return [replace(row, parameters={"time": float(t)}, index=(t,)) for t in range(rows["count"])]

    how = {"parameters": ("time",), "members": members, "beside": lambda path: (path.with_suffix(".part"),)}
    arrivals = Arrivals(WatchOptions(tmp_path, "a*.bp", settle=2.0, **how))
    touch(tmp_path / "a.bp", changed=0.0)
    assert arrivals.look(0.0, 100.0) == []  # its part is not there yet
    assert arrivals.pending == 0
    touch(tmp_path / "a.part", changed=99.0)
    assert arrivals.look(0.0, 100.0) == []
    assert arrivals.look(1.0, 101.0) == []
    assert (arrivals.failures, arrivals.pending) == ({str(tmp_path / "a.bp"): "ValueError: torn"}, 1)
    del rows["error"]
    rows["count"] = 2
    assert [row.index for row in arrivals.look(10.0, 110.0)] == [(0,), (1,)]
    arrivals.tried(["time-0.0"], {"time-1.0": "torn"}, {"time-1.0": TableRow(tmp_path / "a.bp", {"time": 1.0})}, 10.0)
    assert arrivals.look(10.5, 110.5) == []
    assert [row.index for row in arrivals.look(20.0, 120.0)] == [(1,)]
    arrivals.tried(["time-1.0"], {}, {}, 20.0)
    rows["count"] = 3
    assert arrivals.look(21.0, 121.0) == []
    touch(tmp_path / "a.bp", size=2, changed=121.0)  # it has grown
    assert [row.index for row in arrivals.look(30.0, 130.0)] == [(2,)]
    assert set(arrivals.failures) <= {str(tmp_path / "a.bp")}


LOOK = '[[appearance]]\nkind = "isosurface"\nname = "core"\nisovalue = 0.5\n'


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ([], "a new catalog needs --appearance FILE"),
        (["--appearance", "{folder}/look.toml"], "please give --bounds w LOW HIGH"),
        (["--appearance", "{folder}/look.toml", "--pattern", "dump.npy"], "names no parameter"),
    ],
)
def test_a_wrong_command_is_one_error(tmp_path: Path, options: list[str], message: str) -> None:
    (tmp_path / "look.toml").write_text(LOOK)
    command = ["watch", str(tmp_path), "--pattern", PATTERN, "--catalog", str(tmp_path / "a.cdb"), "--once"]
    result = CliRunner().invoke(main, [*command, *(o.format(folder=tmp_path) for o in options)])
    assert (result.exit_code, len(result.output.strip().splitlines())) == (1, 1)
    assert message in result.output


@pytest.mark.slow
def test_a_running_simulation_is_followed_until_sigterm(tmp_path: Path) -> None:
    (tmp_path / "look.toml").write_text(LOOK)
    dumps, path = tmp_path / "dumps", tmp_path / "a.cdb"
    dumps.mkdir()
    command = [sys.executable, "-c", "from insitu.cli import main; main()", "watch", str(dumps), "--pattern", PATTERN]
    command += ["--catalog", str(path), "--appearance", str(tmp_path / "look.toml"), "--bounds", "w", "0", "1"]
    command += ["--spacing", "0.1", "0.1", "0.1", "--size", "8", "--settle", "0.2", "--workers", "1"]
    process = subprocess.Popen(command, cwd=PROJECT, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    data = tmp_path / "whole.npy"
    np.save(data, blob(0.4))
    (dumps / "dump_0.5.npy").write_bytes(data.read_bytes()[:500])  # half-written
    data.rename(dumps / "dump_0.2.npy")  # into place
    until = time.monotonic() + 200
    while time.monotonic() < until and not (path / "members" / "w-0.2").exists():
        assert process.poll() is None, process.communicate()
        time.sleep(0.05)
    np.save(dumps / "dump_0.5.npy", blob(0.5))
    while time.monotonic() < until and not (path / "members" / "w-0.5").exists():
        assert process.poll() is None, process.communicate()
        time.sleep(0.05)
    process.send_signal(signal.SIGTERM)
    told, noted = process.communicate(timeout=100)
    assert process.returncode == 0, noted
    assert "2 members" in told
    assert "the same command goes on" in noted
    assert check(path) == []


@pytest.mark.parametrize("suffix", [".vtk", ".vti", ".xdmf"])
def test_a_dump_that_is_cut_is_not_taken_until_it_is_whole(tmp_path: Path, suffix: str) -> None:
    import h5py
    import pyvista

    values = blob(0.5)
    image = pyvista.ImageData(dimensions=values.shape[::-1], spacing=SPACING)
    image["t"] = values.ravel()
    path, cut = tmp_path / f"dump_0.5{suffix}", tmp_path / f"dump_0.5{suffix}"
    if suffix == ".xdmf":
        cut = tmp_path / "a.h5"
        with h5py.File(cut, "w") as file:
            file["t"] = values
        nz, ny, nx = values.shape
        item = '<DataItem Dimensions="{}" Format="{}">{}</DataItem>'
        path.write_text(
            f'<Xdmf Version="2.0"><Domain><Grid><Topology TopologyType="3DCoRectMesh" Dimensions="{nz} {ny} {nx}"/>'
            f'<Geometry GeometryType="ORIGIN_DXDYDZ">{item.format(3, "XML", "0 0 0")}{item.format(3, "XML", "1 1 1")}</Geometry>'
            f'<Attribute Name="t" Center="Node">{item.format(f"{nz} {ny} {nx}", "HDF", "a.h5:/t")}</Attribute>'
            "</Grid></Domain></Xdmf>"
        )
    else:
        image.save(path)
    whole = cut.read_bytes()
    cut.write_bytes(whole[: int(0.8 * len(whole))])
    how = WatchOptions(tmp_path, f"dump_{{w}}{suffix}", settle=0.0, patience=0.2, until_idle=0.2)
    first = watch_folder(
        tmp_path / "a.cdb", how, replace(ENSEMBLE, location=FieldLocation()), OPTIONS, executor=AtOnce()
    )
    assert not first.done
    assert path.name in next(iter(first.failures.values()))
    assert not (tmp_path / "a.cdb").exists()
    cut.write_bytes(whole)
    again = watch_folder(
        tmp_path / "a.cdb", how, replace(ENSEMBLE, location=FieldLocation()), OPTIONS, executor=AtOnce()
    )
    assert len(again.done) == 1
