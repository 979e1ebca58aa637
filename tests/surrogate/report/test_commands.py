import json
import shutil
from pathlib import Path

import pytest
from click.testing import CliRunner

from surrogate.cli import main
from surrogate.model import Surrogate
from surrogate.report import records
from surrogate.report.seeds import save
from tests.support.results import make_catalog, make_scene, save_upper_bound, upper_bound_entry
from tests.support.scores import scores_of


def test_figures_are_kept_and_answer_where_there_is_no_model(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    scene, _ = make_scene(tmp_path, "blobs"), make_catalog(tmp_path, "blobs")

    def call(command: str, *options: str) -> str:
        result = CliRunner().invoke(main, [command, str(scene), "--runs", str(tmp_path / "runs"), *options])
        assert result.exit_code == (0 if "surrogate train" not in result.output else 1), result.output
        return result.output

    kept = ["--records", str(tmp_path / "kept")]
    call("train")
    call("evaluate", *kept)
    record = json.loads((tmp_path / "kept/blobs/evaluation/0.json").read_text())
    report = json.loads((tmp_path / "runs/blobs/report/report.json").read_text())
    assert record["values"] == {name: value for name, value in report.items() if name not in records.NO_FIGURES}
    assert record["provenance"]["processor_seconds"] > 0
    assert "nothing to do" in call("evaluate", *kept)
    shutil.rmtree(tmp_path / "runs/blobs/surrogate")
    assert "kept/blobs/evaluation/0.json: nothing to do" in call("evaluate", *kept)
    assert "surrogate train" in call("evaluate", "--records", str(tmp_path / "nowhere"))
    monkeypatch.setattr("surrogate.provenance.code", lambda: "later")
    assert "surrogate train" in call("evaluate", *kept)


@pytest.mark.slow
def test_what_is_measured_beside_is_shown_from_the_folder_of_records(tmp_path: Path) -> None:
    scene, _ = make_scene(tmp_path, "blobs"), make_catalog(tmp_path, "blobs")
    run, kept = tmp_path / "runs/blobs", tmp_path / "kept"

    def call(*words: str) -> str:
        result = CliRunner().invoke(main, [words[0], str(scene), "--runs", str(tmp_path / "runs"), *words[1:]])
        assert result.exit_code == 0, result.output
        return result.output

    call("train")
    mark = Surrogate.load(run / "surrogate").training["fingerprint"]
    save_upper_bound(run, upper_bound_entry(mark, 30.0))
    call("evaluate")
    assert (run / "evaluation/0.json").is_file()
    assert "nothing to do" in call("evaluate")
    for seed in (0, 1):
        save(kept / "blobs", scores_of(seed, 30.0, base=mark))
    save_upper_bound(kept / "blobs", upper_bound_entry(mark, 31.0, "else"))
    assert "report.md (" in call("evaluate", "--records", str(kept))  # anew, for what is known there
    report = json.loads((run / "report/report.json").read_text())
    assert report["repeats"]["seeds"] == [0, 1]
    assert [entry["appearance"] for entry in report["ceilings"]] == ["drawn", "else"]
    assert (kept / "blobs/evaluation/0.json").is_file()
