"""The table of batches has a row of each case, and stands in its page."""

from __future__ import annotations

from pathlib import Path

from research.benchmarks.splatting.batches import main, random_surrogate


def test_the_table_has_a_row_of_each_case(tmp_path: Path) -> None:
    main(["--quick", "--output", str(tmp_path), "--machine", "an abacus"])
    page = (tmp_path / "batches.md").read_text()
    rows = [line.split(" | ") for line in page.splitlines() if line.startswith("| 16²")]
    assert [(row[1], row[2]) for row in rows] == [
        ("members", "1"), ("members", "4"), ("views", "4")
    ]  # fmt: skip
    assert "an abacus" in page


def test_a_model_of_ones_own_is_measured(tmp_path: Path) -> None:
    random_surrogate(100).save(tmp_path / "model")
    main([str(tmp_path / "model"), "--quick", "--output", str(tmp_path)])
    assert "100 Gaussians" in (tmp_path / "batches.md").read_text()
