"""Which code wrote a file."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from insitu.cli import main
from insitu.readers.codes import READERS, listed_readers, reader_named, reader_of


def test_every_reader_is_found_by_name_and_listed() -> None:
    assert len({reader.name for reader in READERS}) == len(READERS)
    for reader in READERS:
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
    for reader in READERS:
        assert reader.name in told
