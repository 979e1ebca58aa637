"""The table of frames a second: each way to draw at both sizes, its renderer, and the page's own modules in node."""

from __future__ import annotations

import shutil
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from research.benchmarks.explorer.card import main, processor_times
from surrogate.explore.run import Run
from tests.support.browsers import find_browser
from tests.support.models import following

pytestmark = pytest.mark.slow


@pytest.mark.skipif(not shutil.which("node"), reason="node is not installed")
def test_node_times_the_modules_of_the_page(tmp_path: Path) -> None:
    surrogate = following()
    count, times = processor_times(Run("blobs", surrogate), tmp_path)
    assert count == len(surrogate.gaussians)
    assert 0 < times[0] < times[1] < 100


@pytest.mark.skipif(find_browser() is None, reason="no browser is installed")
def test_a_table_says_what_drew_and_how_fast(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    following().save(tmp_path / "blobs" / "surrogate")
    with ThreadPoolExecutor(1) as alone:  # the tests' own browser has this thread's loop
        alone.submit(main, [str(tmp_path / "blobs"), "--seconds", "0.05"]).result()
    said = capsys.readouterr().out
    rows = [line.split(" | ") for line in said.splitlines() if line.startswith("| blobs")]
    assert [row[2] for row in rows] == ["512²", "1024²"] * 2
    assert all(float(row[3]) > 0 and float(row[4]) > 0 for row in rows)
    assert "Renderer: " in said
    assert "software card" in said or "SwiftShader" not in said
