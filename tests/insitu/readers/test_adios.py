"""ADIOS2: the values are the writer's, streams arrive step by step, and no crash or wait of the library is ours."""

from __future__ import annotations

import importlib.util
import shutil
import tempfile
import time
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from insitu.ensembles.files import FileEnsemble
from insitu.fields.location import FieldLocation
from insitu.readers import adios
from insitu.readers.files import read_data
from insitu.readers.reader import Sampling
from insitu.readers.states import dumps_below, reader_for, table_of_files, with_states
from tests.support.adios_writer import SPACING, density, start, write
from tests.support.damage import damaged, read_or_refused

pytestmark = pytest.mark.skipif(
    importlib.util.find_spec("adios2") is None, reason="adios2 is not installed: pip install 'gs-surrogate[adios2]'"
)


@pytest.fixture(scope="module")
def written(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write(tmp_path_factory.mktemp("adios") / "run.bp")


@pytest.mark.parametrize("engine", ["BP3", "BP4", "BP5"])
def test_the_values_are_the_writers(tmp_path: Path, engine: str) -> None:
    path = write(tmp_path / "run.bp", engine)
    assert adios.recognizes(path)
    found = read_data(path, array="density", index=(2,))
    assert np.array_equal(found.values, density(2))
    assert (found.spacing, found.origin, found.name) == (SPACING, (0, 0, 0), "density")
    assert np.array_equal(read_data(path).values, density(0))


def test_steps_are_members_and_say_what_the_file_says(written: Path) -> None:
    reader = reader_for([written])
    assert reader is adios.READER
    rows = with_states(table_of_files(dumps_below(written.parent)), reader, Sampling()).rows
    assert [(row.index, dict(row.parameters)) for row in rows] == [((i,), {"time": 0.5 * i}) for i in range(3)]
    named = with_states(table_of_files([written]), reader, Sampling(), ["Re", "step"])
    assert dict(named.rows[1].parameters) == {"Re": 1600.0, "step": 1.0}
    with pytest.raises(ValueError, match="there is no array 'pressure' of numbers; the file holds density float32"):
        read_data(written, array="pressure")
    with pytest.raises(ValueError, match="leave resolution out"):
        read_data(written, sampling=Sampling((2, 2, 2)))


@pytest.mark.slow
@pytest.mark.parametrize("engine", ["BP3", "BP4", "BP5"])
def test_steps_without_the_field_are_left_out(tmp_path: Path, engine: str) -> None:
    path = write(tmp_path / "run.bp", engine, steps=5, every=2)
    files = table_of_files([path])
    with pytest.warns(UserWarning, match="3 of 5 states lack pressure and are left out: the first is ") as caught:
        table = with_states(files, adios.READER, Sampling(), arrays=["pressure"])
    assert len(caught) == 1
    assert [(row.index, dict(row.parameters)) for row in table.rows] == [((1,), {"time": 0.5}), ((3,), {"time": 1.5})]
    for step in (1, 3):
        assert np.array_equal(read_data(path, array="pressure", index=(step,)).values, 10 * density(step))
        assert np.array_equal(read_data(path, array="mask", index=(step,)).values, density(99))  # as at the first step
    with pytest.raises(ValueError, match="it is not written at step 2, but at 1, 3"):
        read_data(path, array="pressure", index=(2,))
    assert len(with_states(files, adios.READER, Sampling(), ["step"], ["density", "mask"]).rows) == 5
    assert {state.says["nu"] for state in adios.READER.records(path, Sampling())} == {0.25}
    with pytest.raises(ValueError, match=r"run\.bp: no state has pressures; they have density, mask, pressure"):
        with_states(files, adios.READER, Sampling(), arrays=["pressures"])


def test_openpmd_is_referred_to_its_converter(tmp_path: Path) -> None:
    path = write(tmp_path / "run.bp", attribute="/openPMD")
    with pytest.raises(ValueError, match=r"openpmd-pipe --infile run\.bp --outfile run_%T\.h5"):
        read_data(path, array="density", index=(0,))


def test_a_file_that_grew_has_not_changed(tmp_path: Path) -> None:
    path = write(tmp_path / "run.bp", steps=2)
    table = with_states(table_of_files([path]), adios.READER, Sampling())
    ensemble = FileEnsemble.of(table, reader="adios2")
    member = ensemble.members()[0]
    before = ensemble.record(member)
    shutil.rmtree(path)
    write(path, steps=3)
    assert not ensemble.is_changed(member, before)
    data = path / "data.0"
    data.write_bytes(data.read_bytes()[:-8000])
    assert ensemble.is_changed(member, before)


@pytest.mark.slow
@pytest.mark.parametrize("engine", ["BP4", "BP5"])
@pytest.mark.parametrize("part", [0.0, 0.4])
def test_data_cut_short_are_answered_soon(tmp_path: Path, engine: str, part: float) -> None:
    path = write(tmp_path / "run.bp", engine)
    data = path / "data.0"
    data.write_bytes(data.read_bytes()[: int(part * data.stat().st_size)])
    start = time.monotonic()
    with pytest.raises(
        ValueError, match=r"run\.bp: .*ADIOS2 (did not answer in time: was the file cut|cannot read it)"
    ):
        read_data(path, array="density", index=(2,))
    assert time.monotonic() - start < 20.0


FAKES = {
    # what stands for the library; what is told of it
    "import os; os.abort()": r"run\.bp: ADIOS2 ended its process \(signal 6\) when reading it: it is damaged",
    "import time; time.sleep(1000)": "ADIOS2 did not answer in time",
    "raise SystemExit(3)": r"ADIOS2 ended its process \(status 3\)",
    "def FileReader(path): raise RuntimeError('not\\n a BP file')": "ADIOS2 cannot read it: RuntimeError: not a BP file",
    "def FileReader(path): raise MemoryError()": "ADIOS2 cannot read it: MemoryError",
}


@pytest.mark.parametrize("code", FAKES)
def test_whatever_the_library_does_is_one_error(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, code: str) -> None:
    (tmp_path / "adios2.py").write_text(code)
    (tmp_path / "run.bp").touch()
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setattr(adios, "PATIENCE", 2.0 if "sleep" in code else 60.0)
    with pytest.raises(ValueError, match=FAKES[code]):
        read_data(tmp_path / "run.bp")


LYING = """
class FileReader:
    def __init__(self, path): pass
    def __enter__(self): return self
    def __exit__(self, *_): pass
    def num_steps(self): return STEPS
    def available_variables(self):
        return {"u": {"Type": "float", "Shape": "SHAPE", "SingleValue": "false", "AvailableStepsCount": "1"}}
    def available_attributes(self): return {}
    def read(self, name, step_selection):
        import numpy
        return numpy.zeros((2, 2, 2), dtype="f4")
def type_adios_to_numpy(name):
    import numpy
    return numpy.float32
"""


@pytest.mark.parametrize(
    ("steps", "shape", "message"),
    [
        ("10**12", "2, 2, 2", "it holds 1000000000000 steps"),
        ("1", "4000000, 4000000, 4000000", "claims .* GB, more than the .* GB of memory that are free"),
        ("1", "2, 2, 3", r"'u' has \(2, 2, 2\) values, its description says \(2, 2, 3\)"),
        ("1", "2, 2", "name the array to render; the file holds no array"),
    ],
)
def test_claims_are_not_believed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, steps: str, shape: str, message: str
) -> None:
    (tmp_path / "adios2.py").write_text(LYING.replace("STEPS", steps).replace("SHAPE", shape))
    (tmp_path / "run.bp").touch()
    monkeypatch.syspath_prepend(tmp_path)
    with pytest.raises(ValueError, match=message):
        read_data(tmp_path / "run.bp", FieldLocation(spacing=(1, 1, 1)))


def test_without_the_library_it_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "run.bp").touch()
    monkeypatch.setattr(adios, "find_spec", lambda name: None)
    with pytest.raises(ModuleNotFoundError, match=r"gs-surrogate\[adios2\]"):
        read_data(tmp_path / "run.bp")


@pytest.mark.slow
@settings(max_examples=6)
@given(st.sampled_from(["md.idx", "md.0", "mmd.0", "data.0"]), st.data())
def test_a_damaged_folder_is_read_or_refused(written: Path, name: str, data: st.DataObject) -> None:
    """The library crashes or hangs in every fourth of these; that is one error, and soon."""
    with tempfile.TemporaryDirectory() as folder, pytest.MonkeyPatch.context() as patch:
        patch.setattr(adios, "PATIENCE", 3.0)
        path = Path(folder, "run.bp")
        shutil.copytree(written, path)
        (path / name).write_bytes(data.draw(damaged((path / name).read_bytes())))
        found = read_or_refused(lambda: read_data(path, array="density", index=(0,), reader="adios2"), path)
        assert found is None or found.values.ndim == 3


@pytest.mark.slow
@pytest.mark.parametrize(("name", "engine"), [("run.bp", "BP5"), ("run.bp", "BP4"), ("run.sst", "SST")])
def test_steps_come_while_they_are_written(tmp_path: Path, name: str, engine: str) -> None:
    steps = adios.follow(tmp_path / name, ("density",), idle=60.0)
    writer = start(tmp_path / (name if engine != "SST" else "run"), engine, 3, 0.2)
    try:
        for number, step in enumerate(steps):
            assert step.number == number
            assert step.says == {"Re": 1600.0, "time": 0.5 * number, "step": float(number)}
            assert np.array_equal(step.arrays.arrays["density"].read(), density(number))
        assert number == 2
        assert writer.wait(60) == 0
    finally:
        writer.kill()


def test_a_stream_that_does_not_come_ends_the_wait(tmp_path: Path) -> None:
    assert list(adios.follow(tmp_path / "never.sst", idle=1.0)) == []
