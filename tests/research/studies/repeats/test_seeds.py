import json
import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from catalogs.files import durable
from research.studies.repeats import seeds
from research.studies.repeats.seeds import load, load_scores, save, scores_path
from tests.research.support.scores import scores_of


def test_what_is_kept_is_found_again(tmp_path: Path) -> None:
    scores = scores_of(3, 31.25, varied=28.0)
    save(tmp_path, scores)
    found = load(tmp_path, 3)
    assert found is not None
    assert replace(found, variations=tuple(found.variations)) == scores
    assert scores_path(tmp_path, 3) == tmp_path / "seeds" / "3.json"
    assert load(tmp_path, 4) is None


@pytest.mark.parametrize("content", ["", "{", "[]", "{}", "null", "3", '{"version": 1, "evaluation": 3}'])
def test_damaged_files_count_as_nothing(tmp_path: Path, content: str) -> None:
    save(tmp_path, scores_of(0, 30.0))
    scores_path(tmp_path, 0).write_text(content)
    assert load(tmp_path, 0) is None
    assert load_scores(tmp_path, base="base") == []


@pytest.mark.parametrize("name", ["VERSION", "EVALUATION"])
def test_what_another_version_wrote_counts_as_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str
) -> None:
    save(tmp_path, scores_of(0, 30.0))
    assert load_scores(tmp_path)
    monkeypatch.setattr(seeds, name, getattr(seeds, name) + 1)
    assert load(tmp_path, 0) is None
    assert load_scores(tmp_path) == []


def test_a_file_in_the_folder_of_another_seed_counts_as_nothing(tmp_path: Path) -> None:
    save(tmp_path, scores_of(0, 30.0))
    scores_path(tmp_path, 0).rename(scores_path(tmp_path, 1))
    assert load(tmp_path, 1) is None


def test_only_what_differs_in_the_seed_alone_stands_beside(tmp_path: Path) -> None:
    for seed in (10, 2, 0):
        save(tmp_path, scores_of(seed, 30.0))
    save(tmp_path, scores_of(1, 30.0, base="other settings"))
    (tmp_path / "seeds" / "notes").mkdir()
    (tmp_path / "seeds" / "seeds.md").write_text("a page")
    assert [scores.seed for scores in load_scores(tmp_path, base="base")] == [0, 2, 10]
    assert load_scores(tmp_path / "nowhere", base="base") == []


def test_numbers_that_are_none_are_not_kept(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="JSON"):
        save(tmp_path, scores_of(0, float("nan")))
    assert not list(tmp_path.rglob("*.json"))


def test_a_failed_write_leaves_what_was_there(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    save(tmp_path, scores_of(0, 30.0))

    def fail(*_: object) -> None:
        raise OSError("disk full")

    monkeypatch.setattr("catalogs.files.durable.rename", fail)
    with pytest.raises(OSError, match="disk full"):
        save(tmp_path, scores_of(0, 40.0))
    assert (
        json.loads(scores_path(tmp_path, 0).read_text())["values"]["cells"]["psnr"]["seen_views"]["seen_parameters"]
        == 30.0
    )


def broken(*place: str, value: object) -> Any:
    """Something that puts `value` at a place of a record."""

    def change(record: Any) -> None:
        for key in place[:-1]:
            record = record[key]
        record[place[-1]] = value

    return change


@pytest.mark.parametrize(
    "change",
    [
        broken("values", "cells", value={}),
        broken("values", "cells", value=None),
        broken("values", "cells", "psnr", "seen_views", "seen_parameters", value=float("nan")),
        broken("values", "cells", "ssim", "seen_views", "seen_parameters", value="high"),
        broken("values", "cells", "images", value={}),
        broken("values", "variations", value=None),
        broken("values", "variations", value=[{"kind": "isovalue"}]),
        broken("values", "gaussians", value="many"),
        broken("values", "seconds", value=float("inf")),
        broken("provenance", "machine", value={}),
        broken("provenance", "commit", value=None),
        broken("key", "seed", value=True),
    ],
)
def test_scores_that_no_table_could_be_made_of_count_as_nothing(tmp_path: Path, change: Any) -> None:
    """A report would fail on them after everything is measured."""
    save(tmp_path, scores_of(1, 30.0, varied=20.0))
    path = scores_path(tmp_path, 1)
    record = json.loads(path.read_text())
    change(record)
    path.write_text(json.dumps(record))
    assert load(tmp_path, 1) is None


def test_an_endless_file_counts_as_nothing(tmp_path: Path) -> None:
    save(tmp_path, scores_of(0, 30.0))
    scores_path(tmp_path, 0).write_text("[" * 100_000)
    assert load(tmp_path, 0) is None


@pytest.mark.parametrize("name", ["04", "٤", "4 (copy)", "+4"])
def test_no_seed_is_counted_twice(tmp_path: Path, name: str) -> None:
    for seed in (0, 4):
        save(tmp_path, scores_of(seed, 30.0))
    shutil.copy(scores_path(tmp_path, 4), tmp_path / "seeds" / f"{name}.json")
    assert [scores.seed for scores in load_scores(tmp_path, base="base")] == [0, 4]


def test_what_a_killed_writer_left_is_removed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    save(tmp_path, scores_of(0, 30.0))
    left = durable.partial_name(scores_path(tmp_path, 0))
    monkeypatch.setattr(durable, "_start_time", lambda process: "another process's")
    left.write_bytes(b"{")
    save(tmp_path, scores_of(0, 31.0))
    assert [path.name for path in scores_path(tmp_path, 0).parent.iterdir()] == ["0.json"]
