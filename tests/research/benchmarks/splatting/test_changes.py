"""The timed changes go where they say, and the table names them."""

from __future__ import annotations

import pytest

from research.benchmarks.splatting.changes import changes, made_up, main
from surrogate import Surrogate


def test_every_call_goes_to_a_place_of_its_own(monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[dict[str, float]] = []
    at = Surrogate.at
    monkeypatch.setattr(Surrogate, "at", lambda self, **given: (asked.append(given), at(self, **given))[1])
    for call in changes(made_up(30)).values():
        call()
        call()
    assert [len(given) for given in asked] == [1, 1, 2, 2, 5, 5]
    assert len({tuple(given.items()) for given in asked}) == 6


def test_the_table_has_a_row_for_each_change(capsys: pytest.CaptureFixture[str]) -> None:
    main(["--gaussians", "30", "--seconds", "0.01"])
    rows = capsys.readouterr().out.splitlines()
    assert [row.split(" | ")[0] for row in rows[2:5]] == [
        "| simulation",
        "| simulation and isovalue",
        "| simulation and transfer function",
    ]
