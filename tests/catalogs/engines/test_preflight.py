"""Questions to a worker before it works."""

from __future__ import annotations

from pathlib import Path

import pytest

from catalogs.engines.preflight import Prepared, complaints, marked, software


def test_a_fit_worker_has_no_complaints_and_marks_go(tmp_path: Path) -> None:
    with marked([tmp_path / "to" / "come"]) as marks:
        assert Path(marks[0]).parent == tmp_path
        assert complaints(software(), marks, str(tmp_path)) == []
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("asked", "wrong"),
    [
        (("gs-surrogate 9", (), "/"), "install the same there"),
        ((software(), ["/not/there/mark"], "/"), "does not see the folder /not/there"),
        ((software(), (), "/not/there"), "has no folder /not/there"),
    ],
)
def test_what_is_wrong_is_named_with_its_remedy(asked: tuple[str, list[str], str], wrong: str) -> None:
    [told] = complaints(*asked)
    assert wrong in told


def test_a_task_is_not_begun_where_two_would_run(tmp_path: Path) -> None:
    task = Prepared(lambda: pytest.fail("begun"), software(), str(tmp_path), lambda: 2)
    with pytest.raises(RuntimeError, match="has 2 threads"):
        task()
