"""The table of pictures in blocks is made of what ranks of MPI did."""

from __future__ import annotations

import pytest
from click.testing import CliRunner

from research.benchmarks.hook.blocks import SHOWN, main
from tests.support.mpi import need_mpi


@pytest.mark.slow
def test_a_row_for_every_number_of_ranks_and_appearance() -> None:
    need_mpi()
    done = CliRunner().invoke(main, ["--sizes=16", "--ranks=1", "--ranks=2", "--views=2", "--pixels=24"])
    assert done.exit_code == 0, done.output
    rows = [[cell.strip() for cell in line.strip("|").split("|")] for line in done.output.splitlines()[2:]]
    assert [(row[1], row[2]) for row in rows] == [(str(n), name) for n in (1, 2) for name in SHOWN]
    for row in rows:
        sent, gathered = float(row[5]), float(row[6])
        assert (sent > 0) == (gathered > 0) == (row[1] == "2")
        assert row[7] == "the same" or float(row[7].split()[0]) >= 90.0
