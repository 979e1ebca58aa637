"""The benchmark of budgets trains as the command does, once for each number of Gaussians."""

from __future__ import annotations

import re
from pathlib import Path

import click
import pytest

from research.benchmarks.training.budgets import main, row
from tests.support.blobs import Blobs, stored

MEMBERS = [("train", p / 4) for p in range(5)] + [("validation", 0.4), ("test", 0.6)]


@pytest.mark.slow
def test_rows_have_the_gaussians_that_were_chosen_and_a_multiple(tmp_path: Path, capsys) -> None:
    catalog = stored(tmp_path / "blobs.cdb", Blobs(count=4, size=16), members=MEMBERS)
    main([str(catalog.path), "--minutes", "0.25", "--times", "0.5"])
    chosen, half = re.findall(
        r"([\d,]+) Gaussians +([\d,]+) steps +validation ([\d.]+) dB +([\d.]+) of 0.25", capsys.readouterr().out
    )
    assert int(half[0].replace(",", "")) == int(chosen[0].replace(",", "")) // 2
    for _, steps, decibels, minutes in (chosen, half):
        assert int(steps.replace(",", "")) > 20
        assert 20.0 < float(decibels) < 70.0
        assert float(minutes) > 0.02


def test_a_catalog_that_is_not_there_is_named(tmp_path: Path) -> None:
    with pytest.raises(click.ClickException, match=r"nothing\.cdb"):
        row(tmp_path / "nothing.cdb", 1.0, None, None)
