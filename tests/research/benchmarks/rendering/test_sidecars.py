"""The cost of sidecars is measured on real ones."""

from __future__ import annotations

from click.testing import CliRunner

from research.benchmarks.rendering.sidecars import main, stored_bytes, waves


def test_even_points_take_the_bytes_that_they_must() -> None:
    grid = waves(8)
    per_point = (stored_bytes(grid, 3000) - stored_bytes(grid, 1000)) / 2000
    assert 10 < per_point < 17  # four numbers of four bytes, a little compressed


def test_the_table_has_a_row_for_each_number_of_points() -> None:
    asked = ["--sizes", "6,8", "--even", "0,10", "--seconds", "0"]
    shown = CliRunner().invoke(main, asked, catch_exceptions=False).output.splitlines()
    assert [line.split("|")[1:3] for line in shown[2:6]] == [[f" {s}³ ", f" {n} "] for s in (6, 8) for n in (0, 10)]
