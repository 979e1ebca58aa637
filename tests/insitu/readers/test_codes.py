"""Which code wrote a file."""

from __future__ import annotations

import re
import sys
import tomllib
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from catalogs.store.catalog import Catalog
from insitu.cli import main
from insitu.readers.codes import OURS, listed_readers, reader_named, reader_of
from tests.support.documented import documented_code
from tests.support.foreign_packages import install

pytestmark = pytest.mark.usefixtures("prepared_workers")


def test_every_reader_is_found_by_name_and_listed() -> None:
    assert len({reader.name for reader in OURS}) == len(OURS)
    for reader in OURS:
        assert reader_named(reader.name) is reader
        assert reader.name in listed_readers()
        assert (reader.read is None) != (reader.opens is None)
    with pytest.raises(ValueError, match="there is no reader 'nyx', there are"):
        reader_named("nyx")


def test_files_of_general_formats_are_no_codes(tmp_path: Path) -> None:
    np.save(tmp_path / "a.npy", np.zeros((2, 2, 2)))
    (tmp_path / "empty.vtk").touch()
    (tmp_path / "clover.00001.00001.vtk").mkdir()
    for path in (*tmp_path.iterdir(), tmp_path, tmp_path / "absent"):
        assert reader_of(path) is None, path


@pytest.mark.parametrize("command", ["ensemble", "probe", "watch"])
def test_the_commands_help_lists_the_readers(command: str) -> None:
    told = " ".join(CliRunner().invoke(main, [command, "--help"]).output.split())
    for reader in OURS:
        assert reader.name in told


@pytest.mark.parametrize("named", [pytest.param(["--reader", "mycode"], marks=pytest.mark.slow), []])
def test_another_packages_reader_renders_its_dumps(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, named: list[str]
) -> None:
    module, project = documented_code("docs/how-to/extend.md", "A reader of your own")
    install(tmp_path, "my_package", tomllib.loads(project)["project"]["entry-points"], module)
    monkeypatch.syspath_prepend(str(tmp_path))
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    for number in range(2):
        dump = tmp_path / "run" / f"dump{number}.mycode"
        dump.mkdir(parents=True)
        np.random.default_rng(number).random(120).astype("f4").tofile(dump / "values")
        (dump / "time").write_text(str(0.5 * number))
    look = tmp_path / "look.toml"
    look.write_text('[[appearance]]\nkind = "isosurface"\nname = "surface"\nisovalue = 0.5\n')
    catalog = str(tmp_path / "a.cdb")
    command = ["ensemble", str(tmp_path / "run"), "--catalog", catalog, "--appearance", str(look), "--size", "8"]
    result = CliRunner().invoke(main, [*command, "--workers", "1", *named])
    assert result.exit_code == 0, result.output
    assert [dict(m.parameters) for m in Catalog.open(catalog).members] == [{"time": 0.0}, {"time": 0.5}]


@pytest.mark.parametrize(
    ("source", "sentence"),
    [
        ("raise RuntimeError('no licence')", "'theirs' of their_code in .* does not load: RuntimeError: no licence"),
        (
            "READER = 7",
            "'theirs' of their_code in gs_surrogate.readers is left out: its type is int, not insitu.readers.reader.Reader",
        ),
        ("from insitu.readers.amrex import READER", "'theirs' .* there is a reader 'amrex' already"),
    ],
)
def test_a_broken_package_is_named_in_one_sentence(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, source: str, sentence: str
) -> None:
    install(tmp_path, "their_code", {"gs_surrogate.readers": {"theirs": "their_code:READER"}}, source)
    monkeypatch.syspath_prepend(str(tmp_path))
    monkeypatch.delitem(sys.modules, "their_code", raising=False)
    with pytest.warns(UserWarning, match=sentence) as caught:
        listed = listed_readers()
    assert [Path(warning.filename) for warning in caught] == [Path(__file__)]
    assert "theirs" not in listed


FAILING = """
from insitu.readers.reader import Reader, StoredState

def recognizes(path):
    {recognizes}

def records(path, sampling):
    {records}

def read(path, array, index, sampling):
    {read}

READER = Reader("theirs", "their files", recognizes, records, read)
"""
SOUND = {
    "recognizes": "return path.suffix == '.theirs'",
    "records": "return [StoredState((), {'time': float(path.stem)})]",
    "read": "return None",
}


def with_their_reader(folder: Path, monkeypatch: pytest.MonkeyPatch, **parts: str) -> list[str]:
    """Two dumps and their reader; the command that renders them."""
    install(
        folder,
        "their_code",
        {"gs_surrogate.readers": {"theirs": "their_code:READER"}},
        FAILING.format(**{**SOUND, **parts}),
    )
    monkeypatch.syspath_prepend(str(folder))
    monkeypatch.setenv("PYTHONPATH", str(folder))
    monkeypatch.delitem(sys.modules, "their_code", raising=False)
    for number in range(3):
        np.save(folder / f"run_{number}.npy", np.random.default_rng(number).random((4, 5, 6)))
        (folder / f"{number}.theirs").touch()
    (folder / "look.toml").write_text('[[appearance]]\nkind = "isosurface"\nname = "surface"\nisovalue = 0.5\n')
    catalog = ["--catalog", str(folder / "a.cdb"), "--appearance", str(folder / "look.toml"), "--size", "8"]
    return [*catalog, "--workers", "1"]


@pytest.mark.slow
def test_a_reader_that_cannot_tell_files_is_left_out_and_named_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    command = with_their_reader(tmp_path, monkeypatch, recognizes="raise RuntimeError('no licence')")
    result = CliRunner().invoke(main, ["ensemble", str(tmp_path / "run_{n}.npy"), *command, "--spacing", *"111"])
    assert result.exit_code == 0, result.output
    [line] = [line for line in result.output.splitlines() if "theirs" in line]
    assert re.search("Warning: 'theirs' of their_code in .* its recognizes failed .* no licence", line)
    assert "no licence" not in capfd.readouterr().err  # of the workers
    assert len(Catalog.open(tmp_path / "a.cdb").members) == 3
    named = CliRunner().invoke(main, ["probe", str(tmp_path / "1.theirs"), "--reader", "theirs"])
    assert "Error: " in named.output  # what `read` gives is no field


def test_a_reader_goes_before_vtk(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with_their_reader(tmp_path, monkeypatch, recognizes="return path.suffix == '.xdmf'")
    (tmp_path / "a.xdmf").touch()
    found = reader_of(tmp_path / "a.xdmf")
    assert found is not None
    assert found.name == "theirs"


@pytest.mark.parametrize(
    ("parts", "sentence"),
    [
        ({"records": "return {}['time']"}, "0.theirs: the reader 'theirs' failed: KeyError: 'time'"),
        (
            {"records": "return None"},
            "0.theirs: the reader 'theirs' failed: TypeError: 'NoneType' object is not iterable",
        ),
        ({"records": "return []"}, "0.theirs: the reader 'theirs' finds no state in it"),
        ({"records": "return [{'time': 1}]"}, "0.theirs: the reader 'theirs' finds dict in place of a StoredState"),
        (
            {"records": "return [StoredState((), {'time': float('nan')})]"},
            "0.theirs: its time must be a finite number, got nan",
        ),
        ({"read": "return [][0]"}, "0.theirs: the reader 'theirs' failed: IndexError: list index out of range"),
        ({"read": "assert False, 'never'"}, "0.theirs: the reader 'theirs' failed: AssertionError: never"),
    ],
)
def test_what_a_reader_should_not_raise_names_it_in_one_sentence(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, parts: dict[str, str], sentence: str
) -> None:
    command = with_their_reader(tmp_path, monkeypatch, **parts)
    result = CliRunner().invoke(main, ["ensemble", *(str(tmp_path / f"{n}.theirs") for n in range(2)), *command])
    assert result.exit_code == 1
    assert sentence in " ".join(result.output.split())
    assert "Traceback" not in result.output
