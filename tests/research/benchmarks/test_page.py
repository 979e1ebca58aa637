"""Tables and pages are written whole, and what is not ours on a page stays."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from research.benchmarks.page import PROJECT, RESULTS, command_line, commit, fill, made_by, page_in, stopwatch, table

PAGE = "# Title\n\nabove\n<!-- one: begin -->\nold\n<!-- one: end -->\nbetween\n<!-- two: begin -->\n<!-- two: end -->\nbelow\n"


def test_table_is_markdown() -> None:
    assert table(["a", "b"], [["1", "2"], ["3", ""]]) == "| a | b |\n| --- | --- |\n| 1 | 2 |\n| 3 |  |\n"


@pytest.mark.parametrize("row", [["1"], ["1", "2", "3"], ["1", "x | y"], ["1", "x\ny"]])
def test_a_row_that_would_break_the_table_is_refused(row: list[str]) -> None:
    with pytest.raises(ValueError, match="cell"):
        table(["a", "b"], [row])


def test_fill_replaces_one_part_and_nothing_else(tmp_path: Path) -> None:
    page = tmp_path / "page.md"
    page.write_text(PAGE)
    fill(page, "two", "| new |\n")
    fill(page, "one", "fresh")
    fill(page, "one", "fresher\n\n")
    wanted = PAGE.replace("old", "fresher").replace("<!-- two: begin -->\n", "<!-- two: begin -->\n| new |\n")
    assert page.read_text() == wanted
    assert list(tmp_path.iterdir()) == [page]


@pytest.mark.parametrize(
    "text",
    [
        "nothing",
        "<!-- one: begin -->",
        "<!-- one: end --> <!-- one: begin -->",
        "<!-- one: begin --><!-- one: end -->" * 2,
    ],
)
def test_fill_refuses_a_page_without_its_markers(tmp_path: Path, text: str) -> None:
    page = tmp_path / "page.md"
    page.write_text(text)
    with pytest.raises(ValueError, match="one: begin"):
        fill(page, "one", "body")
    assert page.read_text() == text


def test_the_line_under_a_table_names_command_commit_and_machine() -> None:
    made = made_by("splatting.changes", "docs", on="a processor", environment="LP_NUM_THREADS=0 ")
    assert (
        made
        == f"`LP_NUM_THREADS=0 python -m research.benchmarks.splatting.changes`, commit {commit('docs')}, a processor"
    )


def test_a_page_elsewhere_begins_as_it_is_in_docs(tmp_path: Path) -> None:
    page = page_in(tmp_path / "new", "gpu.md")
    assert page.read_bytes() == (RESULTS / "gpu.md").read_bytes()
    assert page_in(RESULTS, "gpu.md") == RESULTS / "gpu.md"


def test_the_command_line_says_what_the_benchmark_does(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        command_line("splatting.changes", "What it does.\n\n    as it is laid out").parse_args(["--help"])
    shown = capsys.readouterr().out
    assert "python -m research.benchmarks.splatting.changes" in shown
    assert "What it does.\n\n    as it is laid out" in shown
    stopwatch()("drawing")
    assert capsys.readouterr().err == "[    0 s] drawing\n"


def test_every_part_has_its_place_on_the_page() -> None:
    from research.benchmarks.rendering import accuracy as rendering
    from research.benchmarks.simulation import taylor_green
    from research.benchmarks.splatting.__main__ import PAGE, PARTS

    simulation = taylor_green.sections(np.empty((0, 4)), with_finest=True)
    for page, parts in {RESULTS / PAGE: PARTS, rendering.PAGE: rendering.PARTS, taylor_green.PAGE: simulation}.items():
        text = page.read_text()
        for part in parts:
            assert text.count(f"<!-- {part}: begin -->") == text.count(f"<!-- {part}: end -->") == 1, (page, part)


def test_commit_is_of_the_folders_only() -> None:
    found = commit("LICENSE")
    if not (PROJECT / ".git").exists():
        pytest.skip("this is no checkout")
    assert found.removesuffix("+dirty")
    assert " " not in found
