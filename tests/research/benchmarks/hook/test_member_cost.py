"""The cost of a member is measured on real ones, its coarse field's share too."""

from __future__ import annotations

import sys

import pytest

from research.benchmarks.hook import member_cost


@pytest.mark.slow
def test_both_tables_are_printed(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.setattr(sys, "argv", ["member_cost", "--sizes", "16", "66", "--pixels", "8", "--members", "1"])
    member_cost.main()
    lines = capsys.readouterr().out.splitlines()
    cells = [
        [cell.strip() for cell in line.split("|")[1:-1]] for line in lines if line.startswith("| 16³") or "66³" in line
    ]
    assert [row[1] for row in cells[2:]] == ["16 x 16 x 16", "64 x 64 x 64"]
    assert all(float(row[5].split()[0]) <= 0.3 for row in cells[2:])
