"""The report of machine and installation: complete, harmless, and calm about whatever is broken."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest
from click.testing import CliRunner

from catalogs import doctor
from catalogs.doctor import Finding, Package, Probe

PROJECT = Path(__file__).resolve().parents[2]
NAMES = ["gs-surrogate", "Python", "system", "processor", "cores", "memory", "disk", "compilers"]
PROBED = ["kernels", "OpenGL", "GPU", "MPI", "MP4 films"]


def reported(place: Path, half: str = "surrogate", **variables: str) -> tuple[dict[str, dict[str, str]], str]:
    """The findings by name that `doctor --json` prints in folder `place`, and all that it printed."""
    program = f"from {half}.cli import main; main()"
    command = [sys.executable, "-B", "-c", program, "doctor", "--json"]
    environment = {**os.environ, "PYTHONPATH": str(PROJECT), **variables}
    ended = subprocess.run(command, cwd=place, env=environment, capture_output=True, text=True, timeout=120)
    assert (ended.returncode, ended.stderr) == (0, "")
    return {finding["name"]: finding for finding in json.loads(ended.stdout)["findings"]}, ended.stdout


@pytest.mark.parametrize("half", ["surrogate", "insitu"])
def test_it_reports_this_machine_and_writes_nothing(tmp_path: Path, half: str) -> None:
    findings, text = reported(tmp_path, half, HOME=str(tmp_path), XDG_CACHE_HOME=str(tmp_path))
    assert list(tmp_path.iterdir()) == []
    assert list(findings) == [*NAMES, *PROBED, "variables"]
    for name, value in [
        ("kernels", r"\w+ of .*baseline"),
        ("OpenGL", r"(EGL|OSMesa); .+; .+; \d.*"),
        ("GPU", ".*torch"),
    ]:
        assert re.match(value, findings[name]["value"]), findings[name]
        assert findings[name]["remedy"] == ""
    project = tomllib.loads((PROJECT / "pyproject.toml").read_text())["project"]
    extras = {**project["optional-dependencies"], "": project["dependencies"]}
    named = {re.split(r"[\[>=]", text)[0] for extra in extras.keys() - {"test", "all"} for text in extras[extra]}
    assert {package["name"] for package in json.loads(text)["packages"]} == named - {"gs-surrogate"}


def test_broken_settings_are_named_with_a_remedy(tmp_path: Path) -> None:
    variables = {"GS_SURROGATE_INSTRUCTION_SET": "avx1024", "OMP_NUM_THREADS": "many", "PATH": ""}
    findings = reported(tmp_path, **variables)[0]
    assert "'avx1024' of GS_SURROGATE_INSTRUCTION_SET is none of" in findings["kernels"]["value"]
    assert "OMP_NUM_THREADS many" in findings["cores"]["value"]
    assert findings["kernels"]["remedy"]
    assert findings["cores"]["remedy"]
    assert findings["compilers"]["value"] == "c++ not installed, nvcc not installed"
    assert "OMP_NUM_THREADS=many" in findings["variables"]["value"]


@pytest.mark.parametrize(
    ("program", "value", "fine"),
    [
        ("print('first'); print('last')", "last", True),
        ("raise ValueError('no such card')", "ValueError: no such card", False),
        ("import os, signal; os.kill(os.getpid(), signal.SIGSEGV)", "crashed (SIGSEGV)", False),
        ("import os, signal; os.kill(os.getpid(), 40)", "crashed (signal 40)", False),
        ("import time; time.sleep(60)", "no answer within 2 s", False),
        ("import sys; sys.stdout.buffer.write(b'\\xff')", "�", True),
        ("import sys; sys.exit(3)", "status 3", False),
    ],
)
def test_a_probe_that_fails_crashes_or_hangs_is_a_finding(program: str, value: str, fine: bool) -> None:
    assert doctor.run(Probe("card", program, "vtk", "mend it"), seconds=2.0) == Finding(
        "card", value, "" if fine else "mend it"
    )


def test_what_is_not_installed_is_not_examined() -> None:
    probe = Probe("card", "raise SystemExit('ran')", "vtk", "mend it")
    assert doctor.run(probe, present=False) == Finding("card", "unknown: vtk is not installed")


@pytest.mark.parametrize(
    ("version", "least", "old"),
    [
        ("9.3.1", "9.4", True),
        ("9.4", "9.4", False),
        ("10.0", "9.4", False),
        ("2.13.0+cpu", "2.6", False),
        ("2024.9", "2024.10", True),
        ("1.0rc1", "", False),
        (None, "9.4", False),
    ],
)
def test_versions_are_compared_by_number(version: str | None, least: str, old: bool) -> None:
    assert Package("vtk", "insitu", version, least).too_old() == old


def test_remedies_are_below_what_they_mend() -> None:
    listed = [
        Package("click", "", "8.1", "8.1"),
        Package("vtk", "insitu", "9.3", "9.4"),
        Package("av", "video", None, "12"),
    ]
    assert list(doctor.lines([Finding("disk", "full", "make room"), Finding("GPU", "none")], listed)) == [
        "disk      full",
        "          -> make room",
        "GPU       none",
        "packages  click 8.1",
        "[insitu]  vtk 9.3",
        "[video]   av not installed",
        "          -> pip install 'vtk>=9.4'",
        "          -> where you need what is not installed: pip install 'gs-surrogate[EXTRA]'",
    ]


def test_it_works_where_nothing_is_known(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """No metadata of the project, no psutil, no affinity, and a current folder that somebody deleted."""
    gone = tmp_path / "gone"
    gone.mkdir()
    monkeypatch.chdir(gone)
    gone.rmdir()
    monkeypatch.setattr(doctor, "DISTRIBUTION", "not-installed-anywhere")
    monkeypatch.setitem(sys.modules, "psutil", None)
    monkeypatch.delattr(os, "sched_getaffinity", raising=False)
    monkeypatch.setattr(doctor, "PROBES", doctor.PROBES[:1])
    ended = CliRunner().invoke(doctor.doctor, [])
    assert ended.exit_code == 0, ended.exception
    assert "-> pip install not-installed-anywhere" in ended.output
    assert "-> change to a folder that exists" in ended.output
    assert re.search(r"^memory +unknown: ", ended.output, re.MULTILINE)


def test_a_driver_that_torch_cannot_use_is_noticed(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(doctor.shutil, "which", lambda name: f"/usr/bin/{name}")
    assert doctor._with_driver(Finding("GPU", "none (torch was built without CUDA)")).remedy
    assert not doctor._with_driver(Finding("GPU", "NVIDIA H100 80 GB (torch was built for CUDA 12.8)")).remedy
