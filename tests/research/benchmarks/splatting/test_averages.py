"""The benchmark of averages measures what is drawn, and prints both tables."""

from __future__ import annotations

import pytest

from research.benchmarks.splatting import averages
from surrogate.appearance.averages import TOLERANCE


@pytest.mark.parametrize("name", ["step", "12 random points"])
def test_errors_are_those_that_the_kernel_promises(name: str) -> None:
    nodes, exact, drawn = averages.errors(*averages.functions()[name], 8)
    assert nodes >= 4
    assert max(exact) <= TOLERANCE
    assert max(drawn) <= 2.0 * TOLERANCE


def test_both_tables_are_printed(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    few = {name: averages.functions()[name] for name in ("cloverleaf", "needle of a millionth")}
    monkeypatch.setattr(averages, "functions", lambda: few)
    monkeypatch.setattr(averages, "SIZES", (50,))
    averages.main(["--quick"])
    said = capsys.readouterr().out
    for text in (
        "| backward, 50 Gaussians | ",
        "| needle of a millionth | ",
        "python -m research.benchmarks.splatting.averages",
    ):
        assert text in said
