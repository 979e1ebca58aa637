"""A process that renders member after member keeps its memory and its open files, and the benchmark would see it if not."""

from __future__ import annotations

from pathlib import Path

import pytest

from benchmarks import growth
from catalogs.catalog import Catalog
from catalogs.check import check

KILOBYTES = 40.0  # a member: far above what a session keeps of one, far below a leaked window, grid or texture


def per_member(states: list[growth.State]) -> float:
    first, last = states[0], states[-1]
    return 1e3 * (last.megabytes - first.megabytes) / (last.members - first.members)


def test_members_leave_nothing_open_and_no_memory_taken(tmp_path: Path) -> None:
    states = growth.states(tmp_path / "growth.cdb", 140, [60])
    assert [state.members for state in states] == [60, 140]
    assert states[0].files == states[1].files
    assert states[0].threads == states[1].threads
    assert per_member(states) < KILOBYTES
    assert len(Catalog.open(tmp_path / "growth.cdb").members) == 140
    assert check(tmp_path / "growth.cdb", decode=False) == []


def test_a_leak_would_be_seen(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    kept: list[object] = []
    render = growth.insitu.Session.render_member

    def leaky(self: object, field: object, *arguments: object, **options: object) -> object:
        kept.append(bytearray(b"x" * 200_000))
        kept.append(Path("/dev/null").open("rb"))  # noqa: SIM115
        return render(self, field, *arguments, **options)

    monkeypatch.setattr(growth.insitu.Session, "render_member", leaky)
    states = growth.states(tmp_path / "growth.cdb", 30, [10])
    for stream in kept[1::2]:
        stream.close()  # type: ignore[attr-defined]
    assert states[1].files - states[0].files == 20
    assert per_member(states) > KILOBYTES
