"""A run is scored under every function, and what is kept is read again."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest

from catalogs.store.catalog import Catalog
from research.benchmarks.training.functions.__main__ import main
from research.benchmarks.training.functions.departures import PEAK, TRAINED
from research.benchmarks.training.functions.measured import (
    FOLDER,
    FunctionScores,
    load,
    mean_and_worst,
    rows_table,
    unseen,
)
from research.benchmarks.training.functions.truth import FOLDER as PICTURES
from surrogate.evaluation.metrics import score
from tests.support.again import made, rendered, scene_file


def row(function: str, psnr: float) -> FunctionScores:
    return FunctionScores(function, psnr, psnr - 5.0, psnr - 3.0, 0.9, 20.0, 0.25, 24)


def test_the_mean_and_the_worst_are_of_the_functions_never_seen() -> None:
    seeds = [[row(TRAINED, 40.0), row("half", a), row("ramp", b), row(PEAK, 10.0)] for a, b in ((36, 26), (38, 26))]
    assert [one.function for one in unseen(seeds[0])] == ["half", "ramp"]
    assert mean_and_worst(seeds[0]) == (31.0, 26.0)
    text = rows_table(seeds)
    assert "| half | 37.00 ± 1.41 | 32.00 ± 1.41 | 34.00 ± 1.41 | 0.9000 | 20.00 ± 0.00 | 25 % | 24 |" in text
    assert "| **mean of the functions never seen** | **31.50 ± 0.71** |" in text
    assert "| **the worst of them** | **26.00 ± 0.00** |" in text


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("again")
    catalog = rendered(scene_file(folder), folder / "runs")
    made(catalog).save(folder / "runs" / "again" / "surrogate")
    return folder


def call(*arguments: object) -> None:
    sys.argv = ["functions", *map(str, arguments)]
    main()


@pytest.mark.slow
def test_a_run_is_scored_on_pictures_of_the_field(folder: Path, capsys, monkeypatch) -> None:
    monkeypatch.setattr(sys, "argv", [])
    run = folder / "runs" / "again"
    call(folder / "again.toml", run, "--members", 2, "--views", 1, "--records", folder / "records")
    printed = capsys.readouterr().out
    surrogate = made(Catalog.open(run / "catalog.cdb"))
    [(record, rows)] = load(folder / "records" / "again", surrogate.training["settings"])
    assert record.values["members"] == ["test-000", "test-002"]
    assert [one.images for one in rows] == [2] * 9
    [path] = (run / PICTURES).iterdir()
    pictures = Catalog.open(path)
    for one in rows:
        appearance = one.function.replace(" ", "-")
        function = next(a for a in pictures.plan.appearances if a.name == appearance).transfer_function  # type: ignore[union-attr]
        scored, instead = [], []
        for member in pictures.members:
            camera, truth = pictures.plan.cameras[0], pictures.image(member, appearance, 0)
            at_base = surrogate.at(**member.parameters).render(camera)
            drawn = (
                at_base if one.function == TRAINED else surrogate.under(function, **member.parameters).render(camera)
            )
            scored.append(score(truth, drawn, None).psnr)
            instead.append(score(truth, at_base, None).psnr)
        assert (one.psnr, one.worst) == pytest.approx((np.mean(scored), min(scored)))
        assert one.instead == pytest.approx(np.mean(instead))
        assert f"| {one.function} | {one.psnr:.2f} |" in printed
    assert next(one for one in rows if one.function == "colours").novelty == 0.0
    assert load(folder / "records" / "again", {**surrogate.training["settings"], "gaussians": 7}) == []


def test_what_can_not_be_measured_is_refused_before_anything_is_rendered(folder: Path, capsys, monkeypatch) -> None:
    monkeypatch.setattr(sys, "argv", [])
    catalog = Catalog.open(folder / "runs" / "again" / "catalog.cdb")
    plain = folder / "plain"
    plain.mkdir()
    (plain / "catalog.cdb").symlink_to(catalog.path)
    made(catalog, values=False).save(plain / "surrogate")
    twice = folder / "runs" / "again"
    for runs, records, message in (
        ([plain], [], "transfer function"),
        ([twice, twice], ["--records", folder / "kept"], "must hold another seed"),
        ([folder / "nowhere"], [], "no trained surrogate"),
    ):
        with pytest.raises(SystemExit):
            call(folder / "again.toml", *runs, *records)
        assert message in capsys.readouterr().err
        assert not any((run / PICTURES).exists() for run in runs if run != twice)
    assert not (folder / "kept").exists()
    assert FOLDER == "functions"
