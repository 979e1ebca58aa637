"""Which images an evaluation takes."""

from __future__ import annotations

from pathlib import Path

from surrogate.evaluation.cases import Case, base_cells, base_validation, drawn_evenly, sample_of
from tests.support.varied_blobs import varied_catalog, varied_surrogate


def test_equally_many_of_each_group_are_drawn(tmp_path: Path) -> None:
    member = varied_catalog(tmp_path / "a.cdb", varied_surrogate()).member("train-0")
    cases = [Case(member, i, name) for name, count in (("a", 40), ("b", 3), ("c", 40)) for i in range(count)]
    kept = drawn_evenly(cases, 21)
    counts = [sum(case.appearance == name for case in kept) for name in "abc"]
    assert counts == [9, 3, 9]
    assert [cases.index(case) for case in kept] == sorted(cases.index(case) for case in kept)
    assert drawn_evenly(cases, 21) == kept
    assert drawn_evenly(cases, 100) == cases
    assert drawn_evenly([], 5) == []


def test_some_are_drawn_without_replacement_and_in_order(tmp_path: Path) -> None:
    member = varied_catalog(tmp_path / "a.cdb", varied_surrogate()).member("train-0")
    cases = [Case(member, view, "dvr") for view in range(50)]
    views = [case.view for case in sample_of(cases, 20)]
    assert len(set(views)) == 20
    assert views == sorted(views)
    assert sample_of(cases, 20) == sample_of(cases, 20)
    assert sample_of(cases, 50) == cases


def test_without_validation_members_their_views_are_taken(tmp_path: Path) -> None:
    catalog = varied_catalog(
        tmp_path / "a.cdb", varied_surrogate(), {"train-0": (0.0, ("dvr",)), "test-0": (1.0, ("dvr",))}
    )
    assert [(case.member.name, case.view) for case in base_validation(catalog, "dvr")] == [("train-0", 2)]
    cells = base_cells(catalog, "dvr")
    assert [case.view for case in cells["seen_views"]["unseen_parameters"]] == [0, 1]
    assert [case.member.name for case in cells["unseen_views"]["seen_parameters"]] == ["train-0", "train-0"]
