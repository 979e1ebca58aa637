"""A scene's data set from simulation, file and foreign images: made once, completed, and never mixed up."""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
from pathlib import Path

import h5py
import numpy as np
import pytest
from click.testing import CliRunner

from catalogs.store.catalog import Catalog
from catalogs.tools.check import check
from catalogs.vocabulary.scene import Scene
from insitu.cli import main
from insitu.ensembles.dataset import make_dataset
from insitu.ensembles.dumps import runs_of
from insitu.ensembles.sources import ensemble_of
from insitu.simulations import simulation
from tests.support.scenes import REYNOLDS, SIMULATED, scene

pytestmark = pytest.mark.usefixtures("prepared_workers")

PROJECT = Path(__file__).resolve().parents[3]

APPEARANCE = """
[[appearance]]
kind = "volume"
name = "dvr"
[appearance.transfer_function]
color_points = [[-1.0, 0.0, 0.0, 1.0], [1.0, 1.0, 0.0, 0.0]]
opacity_points = [[-1.0, 0.3], [0.0, 0.0], [1.0, 0.3]]
opacity_unit_distance = 0.5
[views]
frequency = 1
width = 24
height = 24
[render]
target_decibels = 40.0
"""

SIMULATION = f"""
name = "flow"
{SIMULATED}resolution = 16
time = 0.5
{REYNOLDS}[members]
train = [100.0, 200.0]
test = [150.0]
{APPEARANCE}"""


TIMED = SIMULATION.replace("time = 0.5\n", "").replace(
    "[members]", '[[parameters]]\nname = "time"\nlow = 0.1\nhigh = 0.9\n[members]'
)
TIMED = TIMED.replace("[100.0, 200.0]", "[[100.0, 0.2], [100.0, 0.8], [200.0, 0.5]]").replace(
    "[150.0]", "[[150.0, 0.4]]"
)


@pytest.fixture
def stored(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An HDF5 ensemble of five members in the data folder."""
    path = tmp_path / "ensemble.h5"
    random = np.random.default_rng(0)
    with h5py.File(path, "w") as file:
        file["field"] = random.uniform(-1, 1, (5, 6, 7, 8)).astype(np.float16)
        file["params"] = random.random((5, 2))
        file["split"] = np.array(["train", "train", "train", "train", "test"], dtype="S")
        file.attrs.update(names=["a", "b"], lower=[0.0, 0.0], upper=[1.0, 1.0], spacing=[1, 1, 1], origin=[0, 0, 0])
    monkeypatch.setenv("GS_SURROGATE_DATA", str(tmp_path))
    return path


@pytest.fixture(scope="module")
def finished(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A finished `runs/flow`, made once: copy it to change it."""
    folder = tmp_path_factory.mktemp("flow")
    make_dataset(scene(folder, SIMULATION), folder / "runs", workers=1)
    return folder / "runs" / "flow"


@pytest.fixture
def flow(finished: Path, tmp_path: Path) -> Path:
    """A finished `runs/flow` of this test's own."""
    return Path(shutil.copytree(finished, tmp_path / "runs" / "flow"))


@pytest.mark.slow
def test_a_simulation_is_rendered_over_processes_and_then_left_alone(tmp_path: Path) -> None:
    asked = scene(tmp_path, SIMULATION)
    lines: list[str] = []
    result = make_dataset(asked, tmp_path / "runs", workers=2, progress=lambda state: lines.append(str(state)))
    assert (result.members, result.made, result.failures) == (3, 3, {})
    assert check(result.catalog) == []
    made = Catalog.open(result.catalog)
    assert [m.split for m in made.members] == ["test", "train", "train"]
    assert made.plan.provenance["scene"] == "flow"
    assert any("images" in line for line in lines)
    record = result.catalog.parent / "dataset.json"
    before = record.read_bytes(), (result.catalog / "data.csv").stat().st_mtime_ns
    again = make_dataset(asked, tmp_path / "runs")
    assert again.made == 0
    assert before == (record.read_bytes(), (result.catalog / "data.csv").stat().st_mtime_ns)
    assert json.loads(record.read_text())["seconds"] == pytest.approx(result.seconds, abs=1.0)


@pytest.mark.slow
def test_a_catalog_that_is_there_is_only_looked_at(tmp_path: Path) -> None:
    made = make_dataset(scene(tmp_path, SIMULATION), tmp_path / "runs", workers=1)
    shutil.move(made.catalog, tmp_path / "flow.cdb")
    path = tmp_path / "mine.toml"
    path.write_text('name = "mine"\n[source]\nkind = "catalog"\npath = "flow.cdb"\n')
    found = make_dataset(Scene.load(path), tmp_path / "runs")
    assert (found.catalog, found.members, found.made) == (tmp_path / "flow.cdb", 3, 0)
    assert not (tmp_path / "runs/mine").exists()
    path.write_text('name = "mine"\n[source]\nkind = "catalog"\npath = "none.cdb"\n')
    with pytest.raises(ValueError, match=r"none\.cdb"):
        make_dataset(Scene.load(path), tmp_path / "runs")


@pytest.mark.slow
def test_what_is_missing_is_made_and_another_scene_is_refused(tmp_path: Path) -> None:
    first = scene(tmp_path, SIMULATION.replace("test = [150.0]", ""))
    make_dataset(first, tmp_path / "runs", workers=1)
    whole = scene(tmp_path, SIMULATION)
    assert make_dataset(whole, tmp_path / "runs", workers=1).made == 1
    other = scene(tmp_path, SIMULATION.replace("[-1.0, 0.3]", "[-1.0, 0.4]"))
    with pytest.raises(ValueError, match="opacity_points"):
        make_dataset(other, tmp_path / "runs")
    assert len(Catalog.open(tmp_path / "runs/flow/catalog.cdb").members) == 3


@pytest.mark.parametrize(
    ("old", "new", "named"),
    [
        ("resolution = 16", "resolution = 24", "source.resolution: 24 here, 16 in the catalog"),
        ("train = [100.0, 200.0]", "train = [100.0, 190.0]", "train-001 parameters.Re: 190.0 here, 200.0"),
        ("test = [150.0]", "validation = [150.0]", "member test-000: not in the scene"),
        ("width = 24", "width = 32", "width 32 here, 24"),
        ("target_decibels = 40.0", "target_decibels = 45.0", "target_decibels: 45.0 here, 40.0"),
        ("high = 200.0", "high = 300.0", "space.Re.high: 300.0 here, 200.0"),
    ],
)
def test_a_changed_scene_is_told_what_changed_and_nothing_is_touched(
    flow: Path, tmp_path: Path, old: str, new: str, named: str
) -> None:
    before = {p: (p.read_bytes(), p.stat().st_mtime_ns) for p in flow.rglob("*") if p.is_file()}
    with pytest.raises(ValueError, match=r"remove .*flow to make it anew") as caught:
        make_dataset(scene(tmp_path, SIMULATION.replace(old, new, 1)), flow.parent)
    assert named in str(caught.value)
    assert before == {p: (p.read_bytes(), p.stat().st_mtime_ns) for p in flow.rglob("*") if p.is_file()}


def test_training_and_title_may_change(flow: Path, tmp_path: Path) -> None:
    changed = scene(tmp_path, SIMULATION.replace("[members]", "[training]\ngaussians = 5\n[members]", 1))
    assert make_dataset(changed, flow.parent).made == 0


NOTHING_TO_DO = """
import sys
from multiprocessing.process import BaseProcess
BaseProcess.start = None  # a worker can't be started
from insitu.cli import main
main(standalone_mode=False)
print(sorted({"torch", "vtkmodules", "pyvista", "scipy", "OpenImageIO", "matplotlib"} & set(sys.modules)))
"""


def test_doing_nothing_loads_and_starts_little_and_says_so(flow: Path, tmp_path: Path) -> None:
    command = [sys.executable, "-c", NOTHING_TO_DO, "dataset", str(scene(tmp_path, SIMULATION).path)]
    result = subprocess.run(
        [*command, "--runs", str(flow.parent)], cwd=PROJECT, capture_output=True, text=True, check=True
    )
    said, loaded = result.stdout.splitlines()
    assert said.endswith("nothing to do")
    assert loaded == "[]"


@pytest.mark.slow
def test_seconds_add_up_over_runs(flow: Path, tmp_path: Path) -> None:
    record = flow / "dataset.json"
    record.write_text(json.dumps({"seconds": 1000.0}))
    more = scene(tmp_path, SIMULATION.replace("test = [150.0]", "test = [150.0, 160.0]", 1))
    result = make_dataset(more, flow.parent, workers=1)
    assert result.made == 1
    assert 1000.0 < json.loads(record.read_text())["seconds"] < 1100.0
    assert result.seconds == pytest.approx(json.loads(record.read_text())["seconds"], abs=0.1)


@pytest.mark.slow
def test_a_stored_ensemble_is_rendered(tmp_path: Path, stored: Path) -> None:
    text = f'name = "file"\n[source]\nkind = "hdf5"\npath = "{stored.name}"\n[members]\nvalidation = 1\n{APPEARANCE}'
    result = make_dataset(scene(tmp_path, text), tmp_path / "runs", workers=1)
    made = Catalog.open(result.catalog)
    assert sorted(m.split for m in made.members) == ["test", "train", "train", "train", "validation"]
    with h5py.File(stored) as file:
        for member, row in zip(made.members, file["params"][()], strict=True):
            assert list(member.parameters.values()) == row.tolist()


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("resolution = 16\n", "", "resolution"),
        ("resolution = 16", "resolution = 16\nsize = 3", "size"),
        ('"taylor_green"', '"weather"', "weather"),
        ('name = "Re"', 'name = "Ma"', "Re"),
        ("time = 0.5\n", "", "source of kind simulation lacks time: state it in"),
        ("resolution = 16", "resolution = 16\nsolver_resolution = 12", "at least the field's 16, got 12"),
        (
            "resolution = 16",
            "resolution = 16\nsolver_resolution = 24.5",
            "solver_resolution must be a whole number, got 24.5",
        ),
        ("time = 0.5", 'time = "late"', "source.time must be a number, got 'late'"),
        ("frequency = 1", "frequenzy = 1", "views: unknown keys frequenzy; known are fill, frequency, height"),
        ("[render]", "[render]\nnann = 1", "render: unknown keys nann; known are backend, coarse_field, nan"),
        ("opacity_unit", "opacity_unt", "'dvr' of kind 'volume': transfer_function: unknown keys opacity_unt_distance"),
        ("[members]", "[training]\nstep = 5\n[members]", r"training: unknown keys step"),
        ("[members]", "[training]\ngaussians = -1\n[members]", "training.*gaussians"),
        ("[members]", '[training]\nappearance = "iso"\n[members]', r"training.appearance must be one of dvr"),
    ],
)
def test_a_wrong_source_is_named_before_anything_is_written(tmp_path: Path, old: str, new: str, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        make_dataset(scene(tmp_path, SIMULATION.replace(old, new, 1)), tmp_path / "runs")
    assert not (tmp_path / "runs").exists()


@pytest.mark.slow
def test_time_may_be_a_parameter(tmp_path: Path) -> None:
    timed = scene(tmp_path, TIMED)
    source = ensemble_of(timed).source
    assert [[m.name for m in run] for run in runs_of(source, timed.members)] == [
        ["train-000", "train-001"],
        ["train-002"],
        ["test-000"],
    ]
    result = make_dataset(timed, tmp_path / "runs", workers=1)
    assert (result.made, result.failures) == (4, {})
    made = Catalog.open(result.catalog)
    assert [m.provenance["time"] for m in made.members] == [m.parameters["time"] for m in made.members]
    assert "time" not in made.plan.provenance["source"]
    assert make_dataset(timed, tmp_path / "runs").made == 0
    field = simulation("taylor_green").run({"Re": 100.0}, resolution=16, time=0.8).values
    assert made.member("train-001").parameters == {"Re": 100.0, "time": 0.8}
    summary = made.member("train-001").summary()
    assert summary is not None
    assert summary.maximum == pytest.approx(field.max(), rel=1e-3)


def test_time_stands_in_one_place(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match=r"scene\.toml: time is one of .*leave it out of \[source\]"):
        make_dataset(
            scene(tmp_path, TIMED.replace("resolution = 16", "resolution = 16\ntime = 0.5")), tmp_path / "runs"
        )
    assert not (tmp_path / "runs").exists()


def test_the_command_line_says_what_is_wrong_in_one_line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("GS_SURROGATE_DATA", str(tmp_path / "nowhere"))
    path = tmp_path / "scene.toml"
    path.write_text(f'name = "file"\n[source]\nkind = "hdf5"\npath = "absent.h5"\n{APPEARANCE}')
    result = CliRunner().invoke(main, ["dataset", str(path), "--runs", str(tmp_path / "runs")])
    assert result.exit_code == 1
    assert "GS_SURROGATE_DATA" in result.output
    assert "Traceback" not in result.output


@pytest.mark.slow
def test_an_hdf5_file_is_rendered_with_the_suggested_transfer_function(tmp_path: Path, stored: Path) -> None:
    out = tmp_path / "out.cdb"
    arguments = [
        "ensemble",
        str(stored),
        "--catalog",
        str(out),
        "--size",
        "16",
        "--workers",
        "2",
        "--target-decibels",
        "20",
    ]
    result = CliRunner().invoke(main, arguments)
    assert result.exit_code == 0, result.output
    assert "opacity_points" in result.output
    assert len(Catalog.open(out).members) == 5
    again = CliRunner().invoke(main, ["ensemble", str(stored), "--catalog", str(out)])  # the rest is the catalog's
    assert again.exit_code == 0, again.output
    assert "5 were there already" in again.output
    other = CliRunner().invoke(main, ["ensemble", str(stored), "--catalog", str(out), "--size", "32"])
    assert other.exit_code == 1
    assert "32 here, 16 in the catalog" in other.output


@pytest.mark.slow
def test_an_hdf5_file_is_rendered_as_a_toml_file_says(tmp_path: Path, stored: Path) -> None:
    (tmp_path / "look.toml").write_text(APPEARANCE.split("[views]")[0])
    arguments = ["ensemble", str(stored), "--catalog", str(tmp_path / "out.cdb"), "--size", "16", "--workers", "1"]
    shown = CliRunner().invoke(main, [*arguments, "--appearance", str(tmp_path / "look.toml"), "--shard", "1/2"])
    assert shown.exit_code == 0, shown.output
    made = Catalog.open(tmp_path / "out.cdb")
    assert made.plan.appearances == scene(tmp_path, SIMULATION).appearances
    assert [m.name for m in made.members] == ["member-0000", "member-0002", "member-0004"]


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--shard", "0/2"], "1 <= i <= n"),
        (["--shard", "two"], "I/N"),
        (["--appearance", "{folder}/empty.toml"], r"empty.toml: it holds no [[appearance]]"),
        (["--appearance", "{folder}/empty.toml", "--scene", "{folder}/empty.toml"], "leave out"),
        (["--dataset", "pressure"], "no field pressure"),
        (["--validation", "9"], "9 validation members"),
    ],
)
def test_a_wrong_option_is_named_before_anything_is_written(
    tmp_path: Path, stored: Path, options: list[str], message: str
) -> None:
    (tmp_path / "empty.toml").write_text("title = 'nothing'")
    arguments = ["ensemble", str(stored), "--catalog", str(tmp_path / "out.cdb"), "--size", "16"]
    result = CliRunner().invoke(main, [*arguments, *(o.format(folder=tmp_path) for o in options)])
    assert result.exit_code == 1
    assert message in result.output
    assert not (tmp_path / "out.cdb").exists()


def test_probe_suggests_what_parses(tmp_path: Path, stored: Path) -> None:
    preview = tmp_path / "preview.png"
    result = CliRunner().invoke(main, ["probe", str(stored), "--members", "2", "--preview", str(preview)])
    assert result.exit_code == 0, result.output
    assert preview.stat().st_size > 1000
    table = result.output[result.output.index("[[appearance]]") :].rsplit("\n/", 1)[0]
    parsed = scene(tmp_path, f'name = "x"\n[source]\nkind = "hdf5"\npath = "{stored.name}"\n{table}')
    assert parsed.appearances[0].name == "dvr"
