"""Which code wrote a file."""

from __future__ import annotations

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


@pytest.mark.parametrize("named", [["--reader", "mycode"], []])
def test_another_packages_reader_renders_its_dumps(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, named: list[str]
) -> None:
    module, project = documented_code("docs/ensembles.md", "A reader of your own")
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
            "'theirs' in gs_surrogate.readers is left out: it is a int, not an insitu.readers.reader.Reader",
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
    assert len(caught) == 1
    assert "theirs" not in listed
