"""Folders of records, as the commands of the studies choose them."""

import re
import subprocess
import sys
from pathlib import Path

import pytest

from research.studies.__main__ import main
from research.studies.commands import StudiedRun
from research.studies.repeats.seeds import load_scores
from research.studies.upper_bound_records import load_upper_bounds
from surrogate.command_line import RESULTS
from tests.research.support.commands import invoked
from tests.support.results import make_catalog, make_scene

PROJECT = Path(__file__).resolve().parents[3]


def test_every_command_is_there_and_help_loads_nothing_heavy() -> None:
    assert sorted(main.commands) == ["ablate", "ceiling", "compare", "repeat", "stress"]
    program = "import sys, research.studies.__main__; print([n for n in ('torch', 'numpy', 'matplotlib') if n in sys.modules])"
    assert subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True).stdout == "[]\n"


def test_studies_that_pages_name_exist() -> None:
    pages = [*PROJECT.glob("*.md"), *(PROJECT / "docs").rglob("*.md"), PROJECT / "Makefile"]
    named = [re.findall(r"(?:research\.studies|\$\(STUDY\)) ([a-z]\w+)", page.read_text()) for page in pages]
    assert set().union(*named) == set(main.commands)


def test_records_lie_in_research_where_that_is_and_results_in_runs(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path, _ = make_scene(tmp_path, "blobs"), make_catalog(tmp_path, "blobs")
    monkeypatch.chdir(tmp_path)
    assert StudiedRun.open(path, RESULTS, None).records == Path("runs/blobs")
    (tmp_path / "research/records").mkdir(parents=True)
    assert StudiedRun.open(path, RESULTS, None).records == Path("research/records/blobs")
    assert StudiedRun.open(path, tmp_path / "runs", None).records == tmp_path / "runs/blobs"
    assert StudiedRun.open(path, RESULTS, Path("mine")).records == Path("mine/blobs")


@pytest.mark.slow
def test_studies_store_what_they_measured(tmp_path: Path) -> None:
    scene, _ = make_scene(tmp_path, "blobs"), make_catalog(tmp_path, "blobs")

    def call(*words: str) -> str:
        result = invoked(words[0], scene, "--runs", tmp_path / "runs", *words[1:])
        assert result.exit_code == 0, result.output
        return result.output

    call("train")
    assert "drawn of test-0, fitted alone" in call("ceiling")
    call("repeat", "--seeds", "2")
    assert len(load_scores(tmp_path / "runs/blobs")) == 2
    assert [entry["appearance"] for entry in load_upper_bounds(tmp_path / "runs/blobs")] == ["drawn"]
    assert "over 2 seeds" in (tmp_path / "runs/blobs/seeds/seeds.md").read_text()
