"""A page says what the emulated field adds to it, and holds as many modes as are asked for."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner, Result

from surrogate import Surrogate
from surrogate.explore.exporting.commands import export
from surrogate.model.form import without_gaussians
from tests.support.emulated import some_field_model


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run of an emulated field alone."""
    folder, model = tmp_path_factory.mktemp("runs") / "blob", some_field_model()
    Surrogate(**without_gaussians(model), field=model).save(folder)
    return folder


def exported(run: Path, *options: Any) -> Result:
    return CliRunner().invoke(export, [str(run), "-o", str(run / "page.html"), *map(str, options)])


def test_modes_are_counted_and_weighed(run: Path) -> None:
    whole = exported(run)
    assert "a page of 1 emulated field (1 mode, which add 0.0 MB), which opens in a browser" in whole.output
    assert "0.1 MB" in whole.output
    assert (run / "page.html").read_bytes().startswith(b"<!doctype html>")


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (("--field-modes", -1), "--field-modes must be 0 or more, got -1"),
        (("--field-modes", 0), "hold neither: explore the run"),
        (
            ("--field-modes", 2, "-o", "picture.png"),
            "--field-modes is of a page, a .html file or a .site, got picture.png",
        ),
    ],
)
def test_what_makes_no_page_is_said(run: Path, options: tuple[Any, ...], words: str) -> None:
    result = exported(run, *options)
    assert result.exit_code == 1
    assert words in result.output
