"""A process that renders member after member keeps its memory and its open files, and the benchmark would see it if not."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

from catalogs.store.catalog import Catalog
from catalogs.tools.check import check

KILOBYTES = 40.0  # a member: far above what a session keeps of one, far below a leaked window, grid or texture
PROGRAM = """
import json, sys
from pathlib import Path
from research.benchmarks.hook import growth
{before}
found = growth.states(Path(sys.argv[1]), int(sys.argv[2]), [int(sys.argv[3])])
print(json.dumps([vars(state) for state in found]))
"""
LEAK = """
kept, render = [], growth.insitu.Session.render_member
def leaky(self, field, *arguments, **options):
    kept.extend([bytearray(b"x" * 200_000), open("/dev/null")])
    return render(self, field, *arguments, **options)
growth.insitu.Session.render_member = leaky
"""


def states(path: Path, members: int, mark: int, before: str = "") -> list[dict[str, float]]:
    """The states of a process of its own: one that has done other things has memory to spare, which hides what is lost."""
    command = [sys.executable, "-c", PROGRAM.format(before=before), str(path), str(members), str(mark)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    found: list[dict[str, float]] = json.loads(done.stdout.splitlines()[-1])
    return found


def per_member(found: list[dict[str, float]]) -> float:
    first, last = found
    return 1e3 * (last["megabytes"] - first["megabytes"]) / (last["members"] - first["members"])


def test_members_leave_nothing_open_and_no_memory_taken(tmp_path: Path) -> None:
    found = states(tmp_path / "growth.cdb", 140, 60)
    assert [state["members"] for state in found] == [60, 140]
    assert found[0]["files"] == found[1]["files"]
    assert found[0]["threads"] == found[1]["threads"]
    assert per_member(found) < KILOBYTES
    assert len(Catalog.open(tmp_path / "growth.cdb").members) == 140
    assert check(tmp_path / "growth.cdb", decode=False) == []


def test_a_leak_would_be_seen(tmp_path: Path) -> None:
    found = states(tmp_path / "growth.cdb", 30, 10, LEAK)
    assert found[1]["files"] - found[0]["files"] == 20
    assert per_member(found) > KILOBYTES
