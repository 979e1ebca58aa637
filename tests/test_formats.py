"""The whole way of a stored ensemble in each format: files, catalog, surrogate, report; and the fields are those of the writer."""

from __future__ import annotations

import csv
import json
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from scipy.interpolate import RegularGridInterpolator

from catalogs.store.catalog import Catalog
from catalogs.tools.check import check
from insitu.cli import main as insitu
from surrogate.cli import main as surrogate
from tests.support.format_writers import ORIGIN, PLACES, PRINTED, WIDTHS, WRITERS, axes, values

pytestmark = pytest.mark.usefixtures("prepared_workers")

SPLITS = ("train", "train", "train", "validation", "test", "train")
SCENE = """
name = "formats"
[source]
kind = "files"
path = "runs.csv"
[[appearance]]
kind = "volume"
name = "dvr"
[appearance.transfer_function]
color_points = [[0.0, 0.1, 0.3, 0.8], [1.0, 0.8, 0.1, 0.1]]
opacity_points = [[0.1, 0.0], [1.0, 0.8]]
opacity_unit_distance = 0.3
[views]
frequency = 1
width = 16
height = 16
[render]
target_decibels = 30.0
"""
TRAINING = ["gaussians=60", "validation_interval=20"]


def run(program: object, *words: object) -> str:
    result = CliRunner().invoke(program, [str(word) for word in words])  # type: ignore[arg-type]
    assert result.exit_code == 0, result.output
    return str(result.output)


def write_ensemble(folder: Path, form: str) -> Path:
    """A table of files, one for each member."""
    rows = []
    for width, split in zip(WIDTHS, SPLITS, strict=True):
        (folder / f"run{width:g}").mkdir()
        path = WRITERS[form](folder / f"run{width:g}", width)
        rows.append((path.relative_to(folder), width, split))
    with (folder / "runs.csv").open("w", newline="") as stream:
        csv.writer(stream).writerows([("path", "a", "split"), *rows])
    return folder / "runs.csv"


def check_fields(catalog: Catalog, form: str) -> None:
    """Every member's summary has the writer's field: its range, and its values at points everywhere in the box."""
    along = axes(PLACES.get(form, ORIGIN))
    for member in catalog.members:
        truth = PRINTED.get(form, np.asarray)(values(member.parameters["a"]))
        summary = member.summary()
        np.testing.assert_allclose((summary.minimum, summary.maximum), (truth.min(), truth.max()), rtol=1e-6)
        expected = RegularGridInterpolator(along[::-1], truth)(summary.even_points[:, ::-1].clip(*limits(along)))
        assert len(expected) > 100
        np.testing.assert_allclose(summary.even_values, expected, atol=2e-6)


def limits(along: tuple[np.ndarray, ...]) -> tuple[list[float], list[float]]:
    """The box of the samples in (z, y, x), within which single precision may round points."""
    return [a[0] for a in along[::-1]], [a[-1] for a in along[::-1]]


@pytest.mark.slow
@pytest.mark.usefixtures("undrawn")
@pytest.mark.parametrize("form", WRITERS)
def test_from_files_to_a_report(form: str, tmp_path: Path) -> None:
    scene, path, training = tmp_path / "scene.toml", tmp_path / "a.cdb", tmp_path / "run"
    scene.write_text(SCENE)
    run(
        insitu,
        "ensemble",
        write_ensemble(tmp_path, form),
        "--catalog",
        path,
        "--array",
        "f",
        "--scene",
        scene,
        "--workers",
        1,
    )
    catalog = Catalog.open(path)
    assert [member.split for member in catalog.members] == list(SPLITS)
    assert [dict(member.parameters) for member in catalog.members] == [{"a": width} for width in WIDTHS]
    assert check(path) == []
    check_fields(catalog, form)
    run(surrogate, "train", path, "--output", training, "--steps", 60, *TRAINING)
    run(surrogate, "evaluate", training)
    report = json.loads(next(training.rglob("report.json")).read_text())
    assert report["validation"]["psnr"] > 10
