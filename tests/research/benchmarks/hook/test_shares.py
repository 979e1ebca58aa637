"""Shares of a member's time are measured for both backends."""

import pytest
from click.testing import CliRunner

from research.benchmarks.hook.shares import main


@pytest.mark.slow
def test_each_case_has_a_row_for_each_backend() -> None:
    done = CliRunner().invoke(main, ["--sizes", "16", "--pixels", "8"])
    assert done.exit_code == 0, done.output
    rows = [line for line in done.output.splitlines() if line.startswith("| 16³")]
    assert [row.split(" | ")[2] for row in rows] == ["vtk", "cpu"]
