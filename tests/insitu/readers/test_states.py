"""Members that their files tell apart: which files of a folder, a pattern or a table, and which of what they say."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import h5py
import numpy as np
import pytest
from click.testing import CliRunner

from catalogs.vocabulary.scene import Scene
from insitu.cli import main
from insitu.ensembles.files import FileEnsemble
from insitu.ensembles.sources import ensemble_of
from insitu.readers.reader import Reader, Sampling, StoredState
from insitu.readers.states import dumps_below, reader_for, table_of_files, with_states
from insitu.readers.tables import MemberTable, TableRow, match_files, read_table
from tests.support.cloverleaf_files import write_dump

AXES = [np.arange(4.0)] * 3


def dumps(folder: Path, steps: Sequence[int] = (0, 10, 20)) -> Path:
    """A run on two ranks, with an array on cells and one on points."""
    more = {"x_vel": np.zeros((4, 4, 4))}
    folder.mkdir(exist_ok=True)
    (folder / "clover.visit").write_text("!NBLOCKS     2\n")
    for step in steps:
        write_dump(folder, step, AXES, {"energy": np.full((3, 3, 3), float(step))}, more, ((1,), (), ()))
    return folder


def members(table: MemberTable, wanted: Sequence[str] = ()) -> MemberTable:
    reader = reader_for([row.path for row in table.rows])
    assert reader is not None
    return with_states(table, reader, Sampling(), wanted)


def test_a_folder_of_dumps_is_an_ensemble_over_what_they_say(tmp_path: Path) -> None:
    found = members(table_of_files(dumps_below(dumps(tmp_path))))
    assert [dict(row.parameters) for row in found.rows] == [{"step": 0.0}, {"step": 10.0}, {"step": 20.0}]
    assert [row.path.name for row in found.rows] == [f"clover.00001.000{step}.vtk" for step in ("00", "10", "20")]
    ensemble = FileEnsemble.of(found, arrays=("energy",), reader="cloverleaf")
    values = [ensemble.field(member, lambda fraction: None)["energy"].values for member in ensemble.members()]
    assert [np.unique(v).tolist() for v in values] == [[0.0], [10.0], [20.0]]


def test_a_pattern_may_name_every_rank_and_leave_the_step_to_the_files(tmp_path: Path) -> None:
    for run in (1, 2):
        dumps(tmp_path / f"run_{run}")
    found = members(match_files("run_{gamma}/clover.*.vtk", tmp_path, more_in_files=True))
    assert found.names == ("gamma", "step")
    assert [tuple(row.parameters.values()) for row in found.rows] == [
        (g, s) for g in (1.0, 2.0) for s in (0.0, 10.0, 20.0)
    ]
    assert members(match_files("run_1/clover.*.{n}.vtk", tmp_path, more_in_files=True)).names == (
        "n",
    )  # which is the step


def one_file(*states: dict[str, float]) -> Reader:
    """A reader whose every file has these states."""
    records = [StoredState((i,), says) for i, says in enumerate(states)]
    return Reader("code", "a code's files", Path.is_file, lambda path, sampling: records, lambda *all: None)


def test_a_time_that_stands_twice_is_said_once_and_the_later_state_taken(tmp_path: Path) -> None:
    times = (0.0, 0.5, 1.0, 0.5, 1.0, 1.5)  # a run that was restarted after its second output
    reader = one_file(*({"time": time, "step": float(i), "Re": 100.0} for i, time in enumerate(times)))
    table = MemberTable((TableRow(tmp_path / "a.h5", {}),), {})
    with pytest.warns(UserWarning, match=r"2 states stand twice in a file, .*: time 0.5 in .*a.h5") as caught:
        found = with_states(table, reader, Sampling())
    assert len(caught) == 1
    assert [(row.index, dict(row.parameters)) for row in found.rows] == [
        ((i,), {"time": time}) for i, time in ((0, 0.0), (3, 0.5), (4, 1.0), (5, 1.5))
    ]
    assert len(with_states(table, reader, Sampling(), ["step"]).rows) == 6  # as was asked for


def test_equal_numbers_of_other_states_are_no_repetition(tmp_path: Path) -> None:
    for reader in (
        one_file(*({"residual": 0.5 - 0.5 * (i == 0), "step": float(i)} for i in range(4))),
        one_file(*({"Re": 100.0, "step": float(i)} for i in range(4))),
        one_file(*({"time": float(i % 2), "trajectory": float(i // 2)} for i in range(4))),
    ):
        assert len(with_states(MemberTable((TableRow(tmp_path, {}),), {}), reader, Sampling()).rows) == 4


def test_a_table_may_leave_parameters_to_the_files(tmp_path: Path) -> None:
    dumps(tmp_path)
    (tmp_path / "t.csv").write_text("path,split\nclover.00001.00000.vtk,train\nclover.00002.00020.vtk,test\n")
    found = members(read_table(tmp_path / "t.csv", more_in_files=True))
    assert [(row.path.name, row.split, dict(row.parameters)) for row in found.rows] == [
        ("clover.00001.00000.vtk", "train", {"step": 0.0}),
        ("clover.00001.00020.vtk", "test", {"step": 20.0}),
    ]


def test_what_belongs_to_a_member_counts_as_its_contents(tmp_path: Path) -> None:
    found = members(table_of_files(dumps_below(dumps(tmp_path))))
    ensemble = FileEnsemble.of(found, arrays=("energy",), reader="cloverleaf")
    first, second, _ = ensemble.members()
    before = ensemble.record(first), ensemble.record(second)
    other = tmp_path / "clover.00002.00000.vtk"
    other.write_text(other.read_text().replace("0.1000E+01", "0.1001E+01"))
    assert ensemble.is_changed(first, before[0])
    assert not ensemble.is_changed(second, before[1])
    assert before[0]["reader"] == "cloverleaf"


SAYING = [
    # what each file says; names asked for; the parameters then
    ([{"redshift": 2.0, "time": 1.0}, {"redshift": 1.0, "time": 3.0}], (), ("redshift",)),
    ([{"redshift": 2.0, "time": 1.0}, {"redshift": 1.0, "time": 3.0}], ("time",), ("time",)),
    ([{"step": 1.0, "time": 0.5}, {"step": 1.0, "time": 0.7}, {"step": 2.0, "time": 0.7}], (), ("step", "time")),
    ([{"a": 1.0, "time": 0.5}, {"a": 1.0, "time": 0.7}], (), ("time",)),
    ([{"a": 1.0, "time": 0.5}, {"time": 0.7}], (), ("time",)),
]


def code(says: Sequence[dict[str, float]]) -> Reader:
    """A reader of files that are called by their number."""
    return Reader("code", "files", lambda path: True, lambda path, sampling: [StoredState((), says[int(path.name)])])


@pytest.mark.parametrize(("says", "wanted", "names"), SAYING)
def test_of_what_files_say_that_which_tells_members_apart_is_taken(
    says: list[dict[str, float]], wanted: tuple[str, ...], names: tuple[str, ...]
) -> None:
    table = MemberTable(tuple(TableRow(Path(str(i)), {}) for i in range(len(says))), {})
    found = with_states(table, code(says), Sampling(), wanted)
    assert found.names == names
    assert [tuple(row.parameters.values()) for row in found.rows] == [tuple(s[n] for n in names) for s in says]


def test_a_table_chooses_among_the_states_of_a_file() -> None:
    states = [StoredState((t, s), {"trajectory": float(t), "time": 0.1 * s}) for t in range(2) for s in range(3)]
    reader = replace(code([]), records=lambda path, sampling: states, units={"time": "s"})
    both = with_states(MemberTable((TableRow(Path("a"), {"Ma": 1.0}),), {}), reader, Sampling())
    assert both.names == ("Ma", "trajectory", "time")
    assert [row.index for row in both.rows] == [(t, s) for t in range(2) for s in range(3)]
    assert both.units == {"time": "s"}
    rows = (
        TableRow(Path("a"), {"trajectory": 1.0, "Ma": 1.0}, name="x"),
        TableRow(Path("b"), {"trajectory": 0.0, "Ma": 2.0}),
    )
    one = with_states(MemberTable(rows, {}), reader, Sampling(), ("Ma", "time"))
    assert [(row.path.name, row.index, row.name) for row in one.rows] == [
        *(("a", (1, s), "") for s in range(3)),
        *(("b", (0, s), "") for s in range(3)),
    ]
    same = [StoredState((s,), {"Re": 1600.0, "time": 0.1 * s}) for s in range(3)]
    other = with_states(
        MemberTable((TableRow(Path("a"), {"Re": 100.0}),), {}), replace(reader, records=lambda *_: same), Sampling()
    )
    assert [dict(r.parameters) for r in other.rows] == [{"Re": 100.0, "time": 0.1 * s} for s in range(3)]
    with pytest.raises(ValueError, match=r"a: none of its 6 states has \{'trajectory': 7.0\}"):
        with_states(MemberTable((TableRow(Path("a"), {"trajectory": 7.0}),), {}), reader, Sampling())


def test_what_is_missing_is_told(tmp_path: Path) -> None:
    (tmp_path / "notes.txt").touch()
    with pytest.raises(ValueError, match=r"is not an ensemble: name a table of files .* cloverleaf \(CloverLeaf"):
        dumps_below(tmp_path)
    with pytest.raises(FileNotFoundError, match=r"there is no file .*absent"):
        table_of_files([tmp_path / "absent"])
    dumps(tmp_path, [7])
    with pytest.raises(ValueError, match="nothing tells the members apart: the files say step 7, the same in all 1"):
        members(table_of_files(dumps_below(tmp_path)))
    with pytest.raises(ValueError, match=r"--parameters time are none of step"):
        members(table_of_files(dumps_below(tmp_path)), ["time"])
    with pytest.raises(ValueError, match="the files are of several kinds"):
        reader_for([tmp_path / "clover.00001.00007.vtk", tmp_path / "notes.txt"])
    (tmp_path / "a.csv").write_text("path,step\nclover.00001.00007.vtk,1\nclover.00002.00007.vtk,2\n")
    with pytest.raises(ValueError, match="have the same file"):
        FileEnsemble.of(members(read_table(tmp_path / "a.csv", more_in_files=True)))


SCENE = """
name = "dumps"
[source]
kind = "files"
path = "t.csv"
fields = ["energy"]
SETTINGS
[[parameters]]
name = "step"
low = 0.0
high = 20.0
[[appearance]]
kind = "isosurface"
name = "core"
isovalue = 0.5
field = "energy"
"""


def scene(folder: Path, settings: str) -> Scene:
    (folder / "scene.toml").write_text(SCENE.replace("SETTINGS", settings))
    return Scene.load(folder / "scene.toml")


def test_a_scene_may_name_a_reader(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("GS_SURROGATE_DATA", str(tmp_path))
    dumps(tmp_path)
    (tmp_path / "t.csv").write_text("path\nclover.00001.00000.vtk\nclover.00002.00020.vtk\n")
    found = ensemble_of(scene(tmp_path, 'reader = "cloverleaf"'))
    assert [dict(member.parameters) for member in found.members] == [{"step": 0.0}, {"step": 20.0}]
    held = found.source.field(found.members[1], lambda fraction: None)
    assert np.unique(held["energy"].values).tolist() == [20.0]
    for settings, message in (
        ('reader = "nyx"', "there is no reader 'nyx'"),
        ("reader = 1", "source.reader must be a word, got 1"),
        ("resolution = [2, 2]", r"source.resolution must be a list of three whole numbers, got \[2, 2\]"),
        ('interpolation = "cubic"', "interpolation must be one of"),
    ):
        with pytest.raises(ValueError, match=message):
            ensemble_of(scene(tmp_path, settings))


@pytest.mark.parametrize(
    ("sources", "message"),
    [
        (["{folder}"], "name the array to render"),
        (["{folder}/clover.00001.00000.vtk", "{folder}/a.npy"], "the files are of several kinds"),
        (["{folder}/a.npy"], "is not an ensemble: name a table of files"),
        (["{folder}/one.h5", "--resolution", "2", "2", "2"], "is not resampled: leave --resolution out"),
        (["{folder}", "--reader", "amrex"], "is not an ensemble"),
        (["{folder}", "--reader", "amrx"], "there is no reader 'amrx', there are "),
        (["{folder}/clover.00001.00000.vtk", "--parameters", "step"], "give --bounds step LOW HIGH"),
    ],
)
def test_a_wrong_command_is_one_error_and_writes_nothing(tmp_path: Path, sources: list[str], message: str) -> None:
    dumps(tmp_path)
    np.save(tmp_path / "a.npy", np.zeros((2, 2, 2)))
    with h5py.File(tmp_path / "one.h5", "w") as file:
        file["field"] = np.zeros((2, 2, 2, 2))
    command = ["ensemble", *(word.format(folder=tmp_path) for word in sources), "--catalog", str(tmp_path / "a.cdb")]
    result = CliRunner().invoke(main, command)
    assert result.exit_code == 1, result.output
    assert message in result.output
    assert not (tmp_path / "a.cdb").exists()
