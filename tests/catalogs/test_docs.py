"""`surrogate docs`: the site of a checkout, its pages where it is not built, and a sentence elsewhere."""

from __future__ import annotations

import subprocess
from pathlib import Path

import pytest
from click.testing import CliRunner

from catalogs.docs import place
from insitu.cli import main as insitu
from surrogate.cli import main as surrogate


def test_the_site_of_a_checkout_is_opened(tmp_path: Path) -> None:
    page = tmp_path / "build" / "site" / "index.html"
    page.parent.mkdir(parents=True)
    page.write_text("a page")
    (tmp_path / "pyproject.toml").write_text("")
    assert place(tmp_path) == (page.as_uri(), f"The documentation: {page}")


def test_a_checkout_without_a_site_says_how_to_build_it(tmp_path: Path) -> None:
    (tmp_path / "docs").mkdir()
    (tmp_path / "docs" / "conf.py").write_text("")
    (tmp_path / "pyproject.toml").write_text("")
    address, sentence = place(tmp_path)
    assert address == ""
    assert f"python -m sphinx {tmp_path / 'docs'}" in sentence


def test_elsewhere_a_sentence_says_where_it_is(tmp_path: Path) -> None:
    address, sentence = place(tmp_path)
    assert address == ""
    assert "folder `docs` of a checkout" in sentence


def test_the_documentation_of_another_package_is_not_taken_for_ours(tmp_path: Path) -> None:
    """Beside an installed wheel."""
    (tmp_path / "docs").mkdir()
    (tmp_path / "docs" / "conf.py").write_text("")
    assert place(tmp_path)[1].startswith("The documentation is not part of the wheel")


@pytest.mark.slow(seconds=5)
def test_an_installed_wheel_says_where_it_is(installed: Path, tmp_path: Path) -> None:
    ended = subprocess.run([installed / "surrogate", "docs"], cwd=tmp_path, capture_output=True, text=True)
    assert ended.stdout.startswith("The documentation is not part of the wheel"), ended.stderr


@pytest.mark.parametrize("group", [surrogate, insitu], ids=["surrogate", "insitu"])
def test_the_command_says_where_the_pages_are(group: object, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    done = CliRunner().invoke(group, ["docs"])  # type: ignore[arg-type]
    assert done.exit_code == 0
    assert done.output.startswith("The documentation")
