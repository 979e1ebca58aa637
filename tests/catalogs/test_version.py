"""One version for all packages and commands."""

from __future__ import annotations

import importlib
import shutil
import subprocess
from importlib.metadata import version as installed
from pathlib import Path

import pytest
from click.testing import CliRunner

from catalogs import version

EXPECTED = installed("gs-surrogate")


@pytest.mark.parametrize("package", ["catalogs", "insitu", "surrogate"])
def test_each_command_says_its_version_and_commit(package: str, monkeypatch: pytest.MonkeyPatch) -> None:
    main = importlib.import_module(f"{package}.cli").main
    monkeypatch.setattr(version, "commit", lambda: "1a2b3c4d5e6f")
    result = CliRunner().invoke(main, ["--version"], prog_name=package)
    assert (result.exit_code, result.output) == (0, f"{package} {EXPECTED} (commit 1a2b3c4d5e6f)\n")
    monkeypatch.setattr(version, "commit", lambda: version.UNKNOWN)
    assert CliRunner().invoke(main, ["--version"], prog_name=package).output == f"{package} {EXPECTED}\n"
    assert "--version" in CliRunner().invoke(main, ["--help"]).output


@pytest.mark.parametrize("package", ["catalogs", "insitu", "render", "surrogate"])
def test_each_package_says_its_version(package: str) -> None:
    assert importlib.import_module(package).__version__ == EXPECTED


@pytest.mark.skipif(shutil.which("git") is None, reason="needs git")
def test_a_commit_is_that_of_this_project(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Not that of a repository in which somebody keeps an environment."""
    module = tmp_path / "site-packages" / "catalogs" / "version.py"
    module.parent.mkdir(parents=True)
    module.write_text("")

    def git(*arguments: str) -> str:
        identity = ("-c", "user.name=a", "-c", "user.email=a@b")
        command = ["git", *identity, *arguments]
        return subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=True, timeout=60).stdout

    monkeypatch.setattr(version, "HERE", module)
    git("init", "-q")
    git("commit", "-q", "--allow-empty", "-m", "theirs")
    assert version.commit() == version.UNKNOWN
    git("add", str(module))
    git("commit", "-q", "-m", "ours")
    assert version.commit() == git("rev-parse", "--short=12", "HEAD").strip()
    module.write_text("# changed")
    assert version.commit().endswith("+dirty")


def test_without_git_the_commit_is_unknown(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PATH", "")
    assert version.commit() == version.UNKNOWN
    assert version.described() == EXPECTED
