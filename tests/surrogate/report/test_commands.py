import json
import shutil
from pathlib import Path

import pytest
from click.testing import CliRunner

from surrogate.cli import main
from surrogate.report import records
from tests.support.results import make_catalog, make_scene


@pytest.mark.slow
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
