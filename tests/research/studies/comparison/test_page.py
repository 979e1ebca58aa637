"""Tables say who leads a cell, and plots show what was measured."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from research.studies.comparison.methods import CONTESTANTS, EMULATED, LIGHT, MADE_FOR, OURS, chosen, usual
from research.studies.comparison.page import cell_names, in_short, leaders, tables
from research.studies.comparison.pictures import SHOWN, TRUTH, path_of, stored_images
from research.studies.comparison.plots import curves, sheet, without_pictures
from research.studies.comparison.result import AS_PUBLISHED, TRIVIAL, ComparisonResult, MethodRow, Terms, load, save
from research.studies.comparison.trivial import best_of
from tests.research.support.compared_pictures import keep_pictures

CELLS = ("novel views", "both")
FIVE = Terms("cpu", "small", 5.0)


def result(method: str, seed: int, psnr: float, minutes: float = 5.0, **also) -> ComparisonResult:
    cells = {c: {"psnr": psnr, "ssim": 0.9, "ms_ssim": None, "flip": 0.1, "images": 24} for c in CELLS}
    form = {"steps": 300, "seconds": 301.0, "megabytes": 1.5, "cells": cells, "curve": [[10.0, 20.0], [301.0, psnr]]}
    return ComparisonResult(method, minutes, seed, "small", "float32", "mark", **{**form, **also})


def trivial(psnr: float) -> ComparisonResult:
    cells = {"mean image: both": {"psnr": psnr - 5.0}, "linear interpolation: both": {"psnr": psnr}}
    return ComparisonResult(TRIVIAL, 0.0, 0, "small", "float32", "mark", cells=cells)


def rows(text: str) -> dict[str, list[str]]:
    """The cells of each line of a table by its first."""
    lines = [
        [cell.strip() for cell in line.strip("|").split("|")] for line in text.splitlines() if line.startswith("|")
    ]
    return {cells[0]: cells[1:] for cells in lines}


def test_the_best_of_a_cell_is_bold() -> None:
    found = [result(OURS, 0, 30.0), result(OURS, 1, 32.0), result("k-planes", 0, 31.5), trivial(28.0)]
    table = rows(tables(found))
    assert table["**this surrogate**"][:2] == ["30.00 ± 1.41".replace("30.00", "31.00")] * 2
    assert table["K-Planes (hybrid)"][:2] == ["**31.50**", "**31.50**"]
    assert table["stored pictures, mixed"][:2] == ["–", "28.00 (linear interpolation)"]
    assert leaders(found, FIVE) == {"novel views": MethodRow("k-planes"), "both": MethodRow("k-planes")}


def test_in_short_ours_stands_beside_the_best_published_one_and_mixtures() -> None:
    found = [result(OURS, 0, 30.0), result(OURS, 1, 32.0), result("k-planes", 0, 31.5), result("visnerf", 0, 20.0)]
    found += [trivial(40.0), result(LIGHT, 0, 50.0), result("visnerf", 0, 33.0, 30.0)]
    assert in_short("blobs", found) == [
        ["`blobs`", "5 min", "novel views", "31.00", "**31.50 (K-Planes (hybrid))**", "–"],
        ["`blobs`", "5 min", "both", "31.00", "31.50 (K-Planes (hybrid))", "**40.00**"],
    ]


def test_stored_pictures_may_lead() -> None:
    found = [result(OURS, 0, 30.0), trivial(45.0)]
    assert leaders(found, FIVE) == {"novel views": MethodRow(OURS), "both": MethodRow(TRIVIAL)}
    assert "**45.00 (linear interpolation)**" in tables(found)


def test_precisions_stand_in_rows_of_their_own() -> None:
    found = [result("insitunet", 0, 20.0), replace(result("insitunet", 0, 25.0), precision="bfloat16")]
    table = rows(tables([*found, result("insitunet", 1, 22.0)]))
    assert list(table)[2:4] == ["InSituNet", "InSituNet, in bfloat16"]
    assert [table[name][0] for name in list(table)[2:4]] == ["21.00 ± 1.41", "**25.00**"]


def test_what_was_trained_on_other_terms_stands_in_another_table() -> None:
    found = [
        result("k-planes", 0, 20.0),
        replace(result("k-planes", 0, 30.0, AS_PUBLISHED), size="official"),
        replace(result("k-planes", 0, 40.0, AS_PUBLISHED), size="official", device="cuda"),
    ]
    text = tables(found)
    headings = [text.index(f"| {heading} |") for heading in ("5 min", "sizes and steps as published")]
    assert headings == sorted(headings)
    assert "| sizes and steps as published, cuda |" in text
    assert all(f"**{psnr:.2f}**" in text for psnr in (20.0, 30.0, 40.0))
    assert len({r.name for r in found}) == 3


def test_there_is_a_table_for_each_time() -> None:
    found = [result(OURS, 0, 30.0), result(OURS, 0, 35.0, minutes=30.0)]
    text = tables(found)
    assert "| 5 min |" in text
    assert "| 30 min |" in text
    assert text.index("30.00") < text.index("35.00")


def test_steps_stand_beside_the_published_ones() -> None:
    table = rows(tables([result("visnerf", 0, 20.0, steps=900), result(OURS, 0, 30.0)]))
    assert "1 %" in table[CONTESTANTS["visnerf"].title]
    assert table["**this surrogate**"][5] == "–"


def test_a_metric_that_no_picture_is_large_enough_for_has_no_column() -> None:
    small = result(OURS, 0, 30.0)
    cells = {name: {**cell, "ms_ssim": 0.75} for name, cell in small.cells.items()}
    large = replace(small, size="official", minutes=AS_PUBLISHED, cells=cells)
    headers = [line for line in tables([small, large]).splitlines() if "both, SSIM" in line]
    assert ["both, MS-SSIM" in header for header in headers] == [False, True]


def test_a_failure_stands_in_its_row() -> None:
    broken = ComparisonResult("k-planes", 5.0, 0, "small", "float32", "mark", error="Diverged: its loss is nan | inf")
    text = tables([result(OURS, 0, 30.0), broken])
    assert rows(text)["K-Planes (hybrid)"][0] == "Diverged: its loss is nan / inf"
    widths = {line.count("|") for line in text.splitlines() if line.startswith("|")}
    assert len(widths) == 1


def test_what_is_missing_leaves_no_row_and_nothing_makes_no_table() -> None:
    assert "K-Planes" not in tables([result(OURS, 0, 30.0)])
    assert tables([]) == ""
    assert cell_names([]) == []


def test_results_are_kept_as_they_are(tmp_path: Path) -> None:
    found = [result(OURS, seed, 30.0 + seed) for seed in (0, 1)]
    for one in found:
        save(tmp_path, one)
    assert [(r.method, r.seed, r.cells, [list(p) for p in r.curve]) for r in load(tmp_path)] == [
        (r.method, r.seed, r.cells, [list(p) for p in r.curve]) for r in found
    ]


def test_names_of_results_tell_them_apart() -> None:
    forms = [("small", "float32"), ("official", "float32"), ("small", "bfloat16"), ("official", "bfloat16")]
    names = {
        ComparisonResult("one", m, s, size, precision, "").name
        for m in (0.5, 5)
        for s in (0, 1)
        for size, precision in forms
    }
    assert len(names) == 16


def test_curves_are_drawn(tmp_path: Path) -> None:
    assert curves([trivial(20.0)]) is None
    drawn = curves([result(OURS, 0, 30.0), result("visnerf", 0, 20.0), trivial(25.0)])
    assert drawn is not None
    assert drawn.startswith(b"\x89PNG")


def test_a_sheet_shows_whom_there_are_pictures_of(tmp_path: Path) -> None:
    found = [result(OURS, 0, 30.0), result("visnerf", 0, 20.0)]
    keep_pictures(tmp_path, found[0].name)
    assert sheet(tmp_path, found, FIVE) is None  # without the truth
    keep_pictures(tmp_path, TRUTH)
    two_columns = sheet(tmp_path, found, FIVE)
    assert without_pictures(tmp_path, found, FIVE) == [found[1].row]
    assert sheet(tmp_path, found, FIVE._replace(minutes=30.0)) is None
    keep_pictures(tmp_path, found[1].name)
    three_columns = sheet(tmp_path, found, FIVE)
    assert without_pictures(tmp_path, found, FIVE) == []
    assert two_columns is not None
    assert three_columns is not None
    assert _width(three_columns) == pytest.approx(1.5 * _width(two_columns), abs=2)


def test_pictures_are_kept_all_or_none(tmp_path: Path) -> None:
    keep_pictures(tmp_path, TRUTH)
    assert len(stored_images(tmp_path, TRUTH)) == len(SHOWN)
    path_of(tmp_path, TRUTH, 1).unlink()
    assert stored_images(tmp_path, TRUTH) == []


def _width(png: bytes) -> int:
    return int.from_bytes(png[16:20], "big")  # of its header


def test_the_best_rule_is_that_of_its_cell() -> None:
    cells = {"one: both": {"psnr": 3.0}, "two: both": {"psnr": 4.0}, "two: not both": {"psnr": 9.0}}
    assert best_of(cells, "both") == ("two", 4.0)
    assert best_of(cells, "neither") is None


def test_contestants_are_chosen_by_name() -> None:
    assert [c.name for c in chosen(["visnerf", OURS])] == [OURS, "visnerf"]
    ordinary = [c.name for c in chosen([])]
    assert {OURS, "gs-surrogate", "4dgs-hd", "k-planes", "visnerf", "insitunet"} < set(ordinary) < set(CONTESTANTS)
    assert set(CONTESTANTS) - set(ordinary) == {LIGHT, EMULATED, "k-planes-naive", "4dgs-hd-naive", *MADE_FOR}
    before = [*ordinary[: ordinary.index("ours-in-steps-of-gs-surrogate")], ""]
    assert {contestant.steps_of for contestant in CONTESTANTS.values()} <= set(before)
    with pytest.raises(ValueError, match=r"unknown methods \['nerf'\]; known are"):
        chosen(["nerf"])


def test_networks_for_one_kind_of_variation_are_compared_there_alone() -> None:
    functions, isosurfaces = "gs-surrogate-functions", "gs-surrogate-isosurfaces"
    for kind, name in (("transfer_function", functions), ("isovalue", isosurfaces), ("", None)):
        names = [contestant.name for contestant in chosen([], kind=kind)]
        assert [other for other in names if other in MADE_FOR] == [name] * (name is not None)
        assert tuple(names) == usual(kind)
    assert [c.name for c in chosen([functions])] == [functions], "where the kind isn't known yet"
    with pytest.raises(
        ValueError, match=f"{functions} is made for variations of kind transfer_function, not for isovalue"
    ):
        chosen([functions, isosurfaces], kind="isovalue")
    with pytest.raises(ValueError, match="not for none"):
        chosen([isosurfaces], kind="")
