"""A run that grows is compared with runs from the start: each learns the members that it is said to."""

from __future__ import annotations

from pathlib import Path

import pytest

from research.benchmarks.training.growth import Growth, measured
from surrogate.storage.runs import RunFolder
from tests.support.blobs import Blobs, stored

MEMBERS = [("train", p / 8) for p in range(8)] + [("test", 0.3), ("test", 0.7)]


@pytest.mark.slow
def test_the_first_run_lacks_the_later_members_and_the_grown_one_has_all(tmp_path: Path) -> None:
    catalog = stored(tmp_path / "blobs.cdb", Blobs(count=4, size=16), members=MEMBERS)
    growth = Growth(catalog, tmp_path / "growth", 0.25, 60, 0)
    rows = list(measured(growth, lambda _: None))
    assert [row[2] for row in rows] == ["60", "18", "60", "18"]  # two of seven, for one validates
    runs = {name: RunFolder.open(tmp_path / "growth" / name) for name in ("first", "grown", "whole", "short")}
    learnt = {
        name: {member for member, split in run.record.splits.members.items() if split != "test"}
        for name, run in runs.items()
    }
    assert learnt["grown"] == learnt["whole"] == learnt["short"] == learnt["first"] | growth.later
    assert len(growth.later) == 2
    assert growth.later.isdisjoint(learnt["first"])
    assert all(10.0 < float(row[4]) < 60.0 for row in rows)
    assert {row[5] for row in rows} == {"–"}


@pytest.mark.parametrize("share", [0.0, 1.0, -0.5])
def test_a_share_that_leaves_nothing_is_refused(share: float, tmp_path: Path) -> None:
    catalog = stored(tmp_path / "blobs.cdb", Blobs(count=2, size=8))
    with pytest.raises(ValueError, match="--later must lie between 0 and 1"):
        Growth(catalog, tmp_path, share, 10, 0)
