"""Every benchmark is a command in a room, whose help names it as it is called."""

from __future__ import annotations

import re
import runpy
import sys
import warnings
from pathlib import Path

import pytest

import research.benchmarks

FOLDER = Path(research.benchmarks.__file__).parent
SHARED = {"__init__.py", "page.py", "timing.py"}


def commands() -> list[str]:
    """Modules, and packages with a `__main__`, that `python -m` runs."""
    found = []
    for path in sorted(FOLDER.rglob("*.py")):
        parts = path.relative_to(FOLDER).with_suffix("").parts
        if 'if __name__ == "__main__":' in path.read_text():
            found.append(".".join(("research.benchmarks", *(part for part in parts if part != "__main__"))))
    return found


def test_only_what_all_share_lies_outside_the_rooms() -> None:
    assert {path.name for path in FOLDER.glob("*.py")} == SHARED
    assert len(commands()) > 30


@pytest.mark.slow
@pytest.mark.parametrize("name", commands())
def test_help_names_the_module(name: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.setattr(sys, "argv", [name, "--help"])
    warnings.simplefilter("ignore")  # the module may be imported already; pytest puts filters back
    with pytest.raises(SystemExit) as ended:
        runpy.run_module(name, run_name="__main__", alter_sys=True)
    text = capsys.readouterr().out
    assert ended.value.code in (0, None)
    assert re.search(rf"^usage: python -m {re.escape(name)}( |$)", text, re.IGNORECASE | re.MULTILINE), text[:200]
