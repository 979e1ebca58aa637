"""Scenes are trained for some minutes and scored, once each."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

from research.benchmarks.training.curves.__main__ import main
from research.benchmarks.training.curves.measured import KIND, load, save
from surrogate.storage.records import Record
from tests.research.support.curves import MADE, point
from tests.support.again import rendered, scene_file


def test_what_is_kept_is_read_again_by_minutes(tmp_path: Path) -> None:
    points = [point(2.0, 31.0, isovalue=25.0), point(0.5, 30.0)]
    for one in points:
        save(tmp_path, one)
    assert load(tmp_path) == points[::-1]
    assert load(tmp_path)[1].unseen == {"base": 31.0, "isovalue": 25.0}
    assert point(1.0, None).unseen == {}


def test_what_is_no_point_is_left_out(tmp_path: Path) -> None:
    save(tmp_path, point(2.0, 31.0))
    Record(KIND, 0, {"minutes": 4.0}, {}, MADE).save(tmp_path / "curve" / "4.json")
    (tmp_path / "curve" / "8.json").write_text("{")
    assert [one.minutes for one in load(tmp_path)] == [2.0]


@pytest.mark.slow
def test_a_scene_is_trained_once_and_scored_on_its_test_images(tmp_path: Path, capsys, monkeypatch) -> None:
    scene = scene_file(tmp_path)
    rendered(scene, tmp_path / "runs")
    command = ["curves", scene, "--minutes", 0.25, "--runs", tmp_path / "runs", "--records", tmp_path / "records"]
    monkeypatch.setattr(sys, "argv", [*map(str, command)])
    main()
    [found] = load(tmp_path / "records" / "again")
    assert f"base {found.unseen['base']:.2f} dB" in capsys.readouterr().out
    assert found.unseen["base"] > 15.0
    assert found.gaussians > 0
    main()
    assert capsys.readouterr().out == ""
