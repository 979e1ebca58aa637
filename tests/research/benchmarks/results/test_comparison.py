"""The page of the comparison, from records alone."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from research.benchmarks.results.comparison import main, page, plots
from research.studies.comparison import tuning
from research.studies.comparison.pictures import TRUTH
from research.studies.comparison.result import AS_PUBLISHED, ComparisonResult, save
from surrogate.storage.records import Provenance
from tests.research.support.compared_pictures import keep_pictures

CELLS = {"both": {"psnr": 30.0, "ssim": 0.9, "ms_ssim": None, "flip": 0.1, "images": 24}}


@pytest.fixture
def records(tmp_path: Path) -> Path:
    for scene, method in (("one", "ours"), ("one", "visnerf"), ("two", "k-planes")):
        result = ComparisonResult(
            method, 5.0, 0, "small", "float32", "mark", cells=CELLS, curve=[[1.0, 9.0], [300.0, 30.0]], steps=9
        )
        save(tmp_path / scene, result)
    found = tuning.Tuning("visnerf", "small", "float32", "one", 60.0, {"0.1": 12.25, "1": 14.5, "10": None})
    tuning.save(tmp_path, found)
    return tmp_path


def test_every_scene_has_a_section_and_rates_stand_below(records: Path) -> None:
    text = page(records, ["one", "two"], [])
    assert text.index("## `one`") < text.index("| ViSNeRF | 30.00") < text.index("## `two`") < text.index("## Rates")
    assert "| ViSNeRF | `one` | small | float32 | 12.25 | – | 14.50 | – | – |" in text
    assert "![" not in text


def test_figures_of_other_data_stand_apart(records: Path) -> None:
    ours, _, others = page(records, ["one", "two"], []).partition("## The paper's own figures, on its own data")
    assert "| ViSNeRF | 33.97 | 33.81 | 32.92 |" in others
    assert "32.92" not in ours


def test_who_was_trained_where_is_said_where_machines_differ(records: Path) -> None:
    def made(method: str, instructions: str) -> ComparisonResult:
        machine = {"processor": "P", "instructions": instructions, "cores": 1}
        result = ComparisonResult(method, 5.0, 0, "small", "float32", "mark", cells=CELLS, steps=9)
        return replace(result, provenance=Provenance("c0ffee", "code", machine, "", 1.0))

    for one in (made("ours", "avx2"), made("visnerf", "avx512"), made("k-planes", "avx512")):
        save(records / "three", one)
    last = page(records, ["three"], []).partition("scenes/three.toml`; ")[2].partition(".</sub>")[0]
    assert last == "commit `c0ffee`. P (avx512), 1 core: K-Planes (hybrid); ViSNeRF. P (avx2), 1 core: this surrogate"


def test_the_table_of_published_steps_is_empty_until_it_is_run(records: Path) -> None:
    text = page(records, ["one", "two"], [])
    assert "| ViSNeRF | 90,000 | – | – | – |" in text
    assert "| this surrogate, in as many steps as GS-Surrogate | 80,000 | – | – | – |" in text
    save(
        records / "one",
        ComparisonResult("visnerf", AS_PUBLISHED, 0, "official", "float32", "mark", "cuda", cells=CELLS, steps=90_000),
    )
    text = page(records, ["one", "two"], [])
    assert "| sizes and steps as published, cuda |" in text
    assert "| ViSNeRF | 90,000 | – |" not in text


def test_plots_are_named_by_scene_and_shown_where_they_are_drawn(records: Path) -> None:
    drawn = plots(records, "one")
    assert set(drawn) == {"comparison_one_curves.png"}
    text = page(records, ["one", "two"], drawn)
    assert text.count("![") == 1
    assert "(comparison_one_curves.png)" in text


def test_a_sheet_is_shown_with_whom_it_lacks(records: Path) -> None:
    for name in (TRUTH, "ours.5.0"):
        keep_pictures(records / "one", name)
    drawn = plots(records, "one")
    assert set(drawn) == {"comparison_one_curves.png", "comparison_one_5.png"}
    text = page(records, ["one", "two"], drawn)
    assert "(comparison_one_5.png)" in text
    assert text.count("No pictures were kept of: ViSNeRF.") == 1


def test_a_command_writes_all_that_is_known(records: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    output = tmp_path / "docs"
    output.mkdir()
    words = ["comparison", "--records", str(records), "-o", str(output)]
    monkeypatch.setattr("sys.argv", words)
    main()
    assert "## `two`" in (output / "comparison.md").read_text()
    assert (output / "comparison_two_curves.png").is_file()


def test_a_scene_without_records_is_an_error(
    records: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("sys.argv", ["comparison", "three", "--records", str(records)])
    with pytest.raises(SystemExit):
        main()
    assert "no records of three" in capsys.readouterr().err
