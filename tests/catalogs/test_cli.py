"""The `catalogs` command: what it prints, how it ends, how fast it starts."""

from __future__ import annotations

import os
import pty
import subprocess
import sys
from pathlib import Path

import pytest
from click.testing import CliRunner

from catalogs.cli import main
from catalogs.store.catalog import Catalog

PROGRAM = [sys.executable, "-c", "from catalogs.cli import main; main()"]


@pytest.mark.parametrize(
    "command",
    [[], ["check"], ["show"], ["merge"], ["pack"], ["unpack"], ["split"], ["import"], ["import", "nerf"], ["browse"]],
)
def test_help_loads_nothing_heavy(command: list[str]) -> None:
    program = f"""
import sys
from catalogs.cli import main
try:
    main({[*command, "--help"]})
except SystemExit as end:
    assert end.code == 0
assert not {{"numpy", "OpenImageIO", "scipy", "h5py"}} & set(sys.modules), sorted(sys.modules)
"""
    result = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=False)
    assert result.returncode == 0, result.stderr
    assert "Usage" in result.stdout


def test_a_good_catalog_ends_with_zero_and_one_line(catalog: Catalog) -> None:
    result = CliRunner().invoke(main, ["check", str(catalog.path)])
    assert (result.exit_code, result.stdout) == (0, f"{catalog.path}: nothing wrong\n")


def test_findings_go_to_standard_output_and_their_count_to_standard_error(catalog: Catalog) -> None:
    for image in list(catalog.path.rglob("*.png"))[:3]:
        image.unlink()
    result = subprocess.run([*PROGRAM, "check", str(catalog.path)], capture_output=True, text=True, check=False)
    assert result.returncode == 1
    assert len(result.stdout.splitlines()) == 3
    assert all(line.startswith("data.csv row") for line in result.stdout.splitlines())
    assert result.stderr == f"Error: {catalog.path}: 3 findings\n"


@pytest.mark.parametrize("command", [["check"], ["check", "--repair"], ["show"], ["browse"]])
def test_what_is_not_there_is_one_line(tmp_path: Path, command: list[str]) -> None:
    result = CliRunner().invoke(main, [*command, str(tmp_path / "nothing.cdb")])
    assert result.exit_code == 1
    assert "nothing.cdb" in result.output
    assert "Traceback" not in result.output


def test_repair_brings_the_table_back(catalog: Catalog) -> None:
    table = (catalog.path / "data.csv").read_bytes()
    (catalog.path / "data.csv").unlink()
    assert CliRunner().invoke(main, ["check", str(catalog.path)]).exit_code == 1
    assert CliRunner().invoke(main, ["check", "--repair", str(catalog.path)]).exit_code == 0
    assert (catalog.path / "data.csv").read_bytes() == table


def test_a_terminal_sees_progress_with_rate_and_time_left(catalog: Catalog) -> None:
    ours, theirs = pty.openpty()
    subprocess.run([*PROGRAM, "check", str(catalog.path)], stdout=subprocess.DEVNULL, stderr=theirs, check=True)
    os.close(theirs)
    seen = os.read(ours, 10_000).decode()
    os.close(ours)
    assert "checking  48 / 48 images" in seen
    assert "/s  0:00 left" in seen
