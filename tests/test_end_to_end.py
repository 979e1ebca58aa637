"""The whole line as a user runs it, on the tiny scene: interrupted, taken up again and finished."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

PROJECT = Path(__file__).resolve().parent.parent
SMALLER = {  # what the scene says, and what is enough for a test
    "height = 64": "height = 64\nfrequency = 2",
    "deformation_steps = 1200": "deformation_steps = 200",
}


def start(command: str, runs: Path, *arguments: str) -> subprocess.Popen[str]:
    package, *rest = command.split()
    program = [
        sys.executable,
        "-c",
        f"from {package}.cli import main; main()",
        *rest,
        str(runs / "tiny.toml"),
        "--runs",
        str(runs),
    ]
    return subprocess.Popen(
        [*program, *arguments],
        cwd=PROJECT,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        start_new_session=True,
    )


def finish(process: subprocess.Popen[str], seconds: float = 550.0) -> str:
    output, _ = process.communicate(timeout=seconds)
    assert process.returncode == 0, output
    return output


def interrupt_when(process: subprocess.Popen[str], ready: Path, pattern: str, seconds: float = 300.0) -> None:
    """Press Ctrl-C, for the whole process group, as soon as a file that matches is there."""
    until = time.monotonic() + seconds
    while time.monotonic() < until and process.poll() is None and not list(ready.glob(pattern)):
        time.sleep(0.05)
    assert process.poll() is None, process.communicate()[0]
    os.killpg(process.pid, signal.SIGINT)
    output, _ = process.communicate(timeout=300)
    assert process.returncode != 0
    assert "Traceback" not in output, output


@pytest.mark.slow(seconds=25)
@pytest.mark.timeout(600)
def test_from_simulation_to_report(tmp_path: Path) -> None:
    runs, folder = tmp_path / "runs", tmp_path / "runs" / "tiny"
    text = (PROJECT / "scenes" / "tiny.toml").read_text()
    for said, enough in SMALLER.items():
        assert said in text
        text = text.replace(said, enough)
    runs.mkdir()
    (runs / "tiny.toml").write_text(text)

    interrupt_when(start("insitu dataset", runs), folder, "catalog.cdb/members/*/member.json")
    assert not list((folder / "catalog.cdb/members").glob(".*"))
    assert "7 members" in finish(start("insitu dataset", runs))
    assert "nothing to do" in finish(start("insitu dataset", runs))

    interrupt_when(start("surrogate train", runs), folder, "surrogate")
    finish(start("surrogate train", runs))
    finish(start("surrogate evaluate", runs))

    record = json.loads((folder / "report" / "report.json").read_text())
    assert record["psnr"]["unseen_views"]["unseen_parameters"] > 38.0
    assert record["ssim"]["unseen_views"]["unseen_parameters"] > 0.98
    assert record["seconds"]["dataset"] > 0
    assert record["milliseconds"]["view_change"] > 0
    assert {entry["name"].split(" (")[0] for entry in record["trivial_predictors"]} >= {"mean image", "nearest member"}
    for name in ("report.md", "comparison.png", "curves.png"):
        assert (folder / "report" / name).stat().st_size > 1000
