"""The tables that clients are timed on are Cinema databases of the wanted size."""

from __future__ import annotations

from pathlib import Path

import pytest
from click.testing import CliRunner

from catalogs.files import cinema
from research.benchmarks.stores import clients


@pytest.mark.parametrize("rows", [1, 252, 600])
def test_a_table_has_so_many_rows_and_breaks_no_rule(tmp_path: Path, rows: int) -> None:
    clients.write_table(tmp_path / "a.cdb", rows)
    header, cells = cinema.parse((tmp_path / "a.cdb/data.csv").read_bytes().decode())
    assert len(cells) == rows
    assert len({row[-1] for row in cells}) == rows
    assert cinema.header_problems(header) == cinema.column_problems(header, cells) == []


def test_every_client_that_is_there_reads_all_rows(tmp_path: Path) -> None:
    result = CliRunner().invoke(clients.main, ["--rows", "300", "--folder", str(tmp_path)])
    assert result.exit_code == 0, result.output
    for client in clients.READERS:
        assert f"300 rows: {client}" in result.output or f"{client} is not installed" in result.output
    assert list(tmp_path.iterdir()) == []
