"""Catalogs of repeated members hold what they should, and leave the catalog that they come from as it was."""

from __future__ import annotations

from pathlib import Path

import pytest

from catalogs.tools.check import check
from research.benchmarks.training.streaming import HEADER, measured, repeated
from tests.support.blobs import Blobs, stored

MEMBERS = [("train", 0.2), ("train", 0.8), ("validation", 0.4), ("test", 0.6)]


def test_members_are_repeated_at_other_places_and_the_source_stays(tmp_path: Path) -> None:
    source = stored(tmp_path / "blobs.cdb", Blobs(count=4, size=16), members=MEMBERS)
    before = {path: path.read_bytes() for path in source.path.rglob("*") if path.is_file()}
    views = source.members[0].view_splits.count("train")
    catalog = repeated(source, tmp_path / "more.cdb", 4 * views + 1)
    assert check(catalog.path) == []
    training = [member for member in catalog.members if member.split == "train"]
    assert len(training) == 5
    assert len({tuple(member.parameters.values()) for member in training}) == 5
    assert {member.split for member in catalog.members} == {"train", "validation", "test"}
    assert {path: path.read_bytes() for path in source.path.rglob("*") if path.is_file()} == before


@pytest.mark.slow
def test_steps_are_timed_and_memory_is_measured(tmp_path: Path) -> None:
    source = stored(tmp_path / "blobs.cdb", Blobs(count=4, size=16), members=MEMBERS)
    cells = measured(source, tmp_path / "streaming", 20, 200, 20)
    assert len(cells) == len(HEADER)
    assert int(cells[0]) >= 20
    assert 0.1 < float(cells[2]) < 3.0
    assert not (tmp_path / "streaming").exists()
