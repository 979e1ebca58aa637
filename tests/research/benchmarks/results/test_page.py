"""The page from end to end: every table with what made it, pictures beside it, and what is missing."""

import shutil
import sys
from pathlib import Path

import pytest

from research.benchmarks.results.__main__ import main as results_main
from research.benchmarks.results.gaps import gaps_of
from research.benchmarks.results.page import write
from research.benchmarks.results.scenes import read_scenes
from tests.research.support.commands import invoked
from tests.research.support.results import make_results, make_study
from tests.support import prepared
from tests.support.results import make_catalog, make_scene


def page(root: Path) -> str:
    return write(root / "docs", read_scenes(root / "scenes", root / "records", root / "runs")).read_text()


def test_tables_stand_with_what_made_them_and_gaps_with_what_makes_them(tmp_path: Path) -> None:
    catalog = make_results(tmp_path, "vortex", 30.0, seeds=(30.0, 32.0))
    make_study(tmp_path, "vortex", catalog, {"default": (30.0,), "joint": (29.0,)})
    make_scene(tmp_path, "absent")
    text = page(tmp_path)
    assert "| `vortex` | 31.00 ± 1.41 | 31.00 ± 1.41 |" in text
    assert "| `vortex` | 1,005 ± 7 | 1.00 ± 0.71 | 45 | 100 ± 1 | – | 1.50 | 0.25 | – | 2 |" in text
    assert "| `vortex` | `surrogate evaluate scenes/vortex.toml` | commit `c0ffee`, abacus, 2 cores, seed 0 |" in text
    assert (
        "| `vortex` | `python -m research.studies ceiling scenes/vortex.toml` | commit `c0ffee`, abacus, 2 cores, seed 0 |"
        in text
    )
    repeat = "`python -m research.studies repeat scenes/vortex.toml --seeds 2`"
    assert f"| `vortex` | {repeat} | commit `abc`, abacus, 2 cores, seeds 0, 1 |" in text
    assert (
        "`python -m research.studies ablate scenes/vortex.toml --seconds 60 --seeds 1`: commit `bead`, abacus, 2 cores, seed 0."
        in " ".join(text.split())
    )
    assert "| `absent` | everything | `make results SCENES=absent` |" in text


def test_pictures_are_copied_and_those_of_an_earlier_page_removed(tmp_path: Path) -> None:
    make_results(tmp_path, "vortex", 30.0)
    (tmp_path / "docs").mkdir()
    for name in ("results_gone_comparison.png", "results_of_mine.png", "other.png"):
        (tmp_path / "docs" / name).write_bytes(b"old")
    (tmp_path / "docs/results.md").write_text("![gone](results_gone_comparison.png)\n![up](../results_of_mine.png)\n")
    assert "![vortex](results_vortex_comparison.png)" in page(tmp_path)
    assert (tmp_path / "docs/results_vortex_comparison.png").read_bytes() == b"a picture"
    assert sorted(p.name for p in (tmp_path / "docs").iterdir()) == [
        "other.png",
        "results.md",
        "results_of_mine.png",
        "results_vortex_comparison.png",
    ]


def test_the_same_results_make_the_same_page(tmp_path: Path) -> None:
    make_results(tmp_path, "vortex", 30.0, seeds=(30.0, 32.0))
    assert page(tmp_path) == page(tmp_path)
    assert str(tmp_path) not in page(tmp_path)


def test_what_the_commands_made_stands_on_the_page(tmp_path: Path) -> None:
    scene = make_scene(tmp_path, "blobs")
    make_catalog(tmp_path, "blobs")
    for command in ("train", "repeat", "ceiling", "evaluate"):
        more = [] if command == "train" else ["--records", str(tmp_path / "records")]
        more += ["--seeds", "2"] if command == "repeat" else []
        result = invoked(command, scene, "--runs", tmp_path / "runs", *more)
        assert result.exit_code == 0, result.output
    (results,) = read_scenes(tmp_path / "scenes", tmp_path / "records", tmp_path / "runs")
    assert [gap.what for gap in gaps_of(results)] == ["the ablation of the base appearance"]
    assert results.report is not None
    assert results.repeats is not None
    spread = results.repeats["psnr"]["unseen_views"]["unseen_parameters"]
    text = page(tmp_path)
    assert f"| `blobs` | pictures made elsewhere | {spread['mean']:.2f} ± {spread['deviation']:.2f} |" in text
    assert f"{results.upper_bounds[0]['psnr']:.2f} ({results.upper_bounds[0]['surrogate']['psnr']:.2f})" in text
    assert (tmp_path / "docs/results_blobs_comparison.png").stat().st_size > 5000


@pytest.mark.parametrize("records", ["nowhere", "records"])
def test_without_results_no_page_is_written(tmp_path: Path, records: str) -> None:
    make_scene(tmp_path, "absent")
    (tmp_path / "records").mkdir()
    folders = ["--records", tmp_path / records, "--scenes", tmp_path / "scenes", "--output", tmp_path / "docs"]
    command = "import runpy; runpy.run_module('research.benchmarks.results', run_name='__main__')"
    status, _, errors = prepared.run(command, *folders)
    assert status == 2
    assert "make" in errors.splitlines()[-1]
    assert not (tmp_path / "docs").exists()


def test_a_scene_that_is_wrong_is_named_in_one_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    make_results(tmp_path, "vortex", 30.0)
    make_scene(tmp_path, "wrong").write_text('name = "wrong"\nnonsense = 1\n')
    folders = ["--records", tmp_path / "records", "--scenes", tmp_path / "scenes", "--output", tmp_path / "docs"]
    monkeypatch.setattr(sys, "argv", ["research.benchmarks.results", *map(str, folders)])
    with pytest.raises(SystemExit):
        results_main()
    assert "wrong.toml" in capsys.readouterr().err.splitlines()[-1]
    assert not (tmp_path / "docs").exists()


def test_without_runs_the_pictures_that_are_there_stay(tmp_path: Path) -> None:
    make_results(tmp_path, "vortex", 30.0)
    before = page(tmp_path)
    shutil.rmtree(tmp_path / "runs")
    assert page(tmp_path) == before
    assert (tmp_path / "docs/results_vortex_comparison.png").read_bytes() == b"a picture"


def test_pictures_of_another_report_are_not_taken(tmp_path: Path) -> None:
    make_results(tmp_path, "vortex", 30.0)
    (tmp_path / "runs/vortex/report/report.json").write_text('{"fingerprint": "another"}')
    assert "results_vortex_comparison.png" not in page(tmp_path)
