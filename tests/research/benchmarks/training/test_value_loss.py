"""The table of what the loss on values costs has its rows."""

from __future__ import annotations

from click.testing import CliRunner

from research.benchmarks.training.value_loss import SCALES, main


def test_a_row_for_each_size_of_gaussians() -> None:
    asked = ["--gaussians", "50", "--places", "5", "--steps", "2"]
    shown = CliRunner().invoke(main, asked, catch_exceptions=False).output.splitlines()
    assert [line.split("|")[1].strip() for line in shown[2:6]] == [f"{scale:g}" for scale in SCALES]
