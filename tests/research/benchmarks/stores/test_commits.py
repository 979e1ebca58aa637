"""The benchmark of commits tries what it promises: one session's members in linear time, and killed writers that lose nothing."""

from __future__ import annotations

from pathlib import Path

import click
import pytest

from catalogs.tools.check import check
from research.benchmarks.stores import commits


def test_members_are_committed_and_timed(tmp_path: Path) -> None:
    found = commits.times(tmp_path / "tiny.cdb", [3, 6])
    assert list(found) == [3, 6]
    assert check(tmp_path / "tiny.cdb") == []


@pytest.mark.slow
def test_eight_writers_of_which_some_are_killed_lose_nothing(tmp_path: Path) -> None:
    """`python -m research.benchmarks.stores.commits --kills 200` is the long form."""
    assert commits.kill_writers(tmp_path, 8) > 0


def test_a_lost_member_would_be_noticed(tmp_path: Path) -> None:
    commits.times(tmp_path / "tiny.cdb", [2])
    with pytest.raises(click.ClickException, match="lost"):
        commits._judge(tmp_path / "tiny.cdb", ["m000001", "m000002"])
