import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from catalogs.files import durable
from surrogate.storage import records
from surrogate.storage.records import Provenance, Record, read_json

RECORD = Record(
    "size",
    2,
    {"seed": 3, "settings": {"gaussians": 10, "held_still": ("colors",)}},
    {"megabytes": 1.5, "by_part": {"colors": None}},
    Provenance("0123abcd", "4567", {"processor": "a processor", "cores": 2}, "2026-11-22T12:00:00+00:00", 7.5),
)


def load(path: Path, **key: Any) -> Record | None:
    return Record.load(path, "size", 2, key)


def test_what_is_kept_is_found_again(tmp_path: Path) -> None:
    path = tmp_path / "a" / "b" / "size.json"
    RECORD.save(path)
    found = load(path)
    assert found is not None
    assert (found.values, found.provenance) == (RECORD.values, RECORD.provenance)
    assert found.agrees(RECORD.key)
    assert found.agrees(found.key)
    assert RECORD.agrees(found.key)


@pytest.mark.parametrize("key", [{"seed": 3}, {"seed": 3, "settings": {"gaussians": 10, "held_still": ["colors"]}}])
def test_a_key_may_be_asked_for_in_part(tmp_path: Path, key: dict) -> None:
    RECORD.save(tmp_path / "size.json")
    assert load(tmp_path / "size.json", **key) is not None


@pytest.mark.parametrize("key", [{"seed": 4}, {"code": None}, {"settings": {"gaussians": 10}}])
def test_of_another_key_there_is_none(tmp_path: Path, key: dict) -> None:
    RECORD.save(tmp_path / "size.json")
    assert load(tmp_path / "size.json", **key) is None


def test_of_another_kind_or_version_there_is_none(tmp_path: Path) -> None:
    RECORD.save(tmp_path / "size.json")
    assert Record.load(tmp_path / "size.json", "length", 2) is None
    assert Record.load(tmp_path / "size.json", "size", 3) is None
    assert load(tmp_path / "nothing.json") is None
    assert load(tmp_path) is None


@pytest.mark.parametrize("content", ["", "{", "[]", "null", "3", "{}", "[" * 100_000, '{"version": 2}', "\xff"])
def test_damaged_files_count_as_nothing(tmp_path: Path, content: str) -> None:
    (tmp_path / "size.json").write_text(content, encoding="latin-1")
    assert load(tmp_path / "size.json") is None


@pytest.mark.parametrize(
    "change",
    [
        {"key": []},
        {"values": None},
        {"version": True},
        {"provenance": None},
        {"provenance": {"commit": 3}},
        {"provenance": {"machine": "mine"}},
        {"provenance": {"processor_seconds": "long"}},
        {"provenance": {"colour": "red"}},
        {"more": 1},
    ],
)
def test_records_of_wrong_types_count_as_nothing(tmp_path: Path, change: dict) -> None:
    path = tmp_path / "size.json"
    RECORD.save(path)
    path.write_text(json.dumps(json.loads(path.read_text()) | change))
    assert load(path) is None


def test_a_file_larger_than_any_record_is_not_read(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    RECORD.save(tmp_path / "size.json")
    monkeypatch.setattr(records, "MOST_BYTES", 100)
    assert read_json(tmp_path / "size.json") is None


def test_numbers_that_are_none_are_not_kept(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="JSON"):
        replace(RECORD, values={"megabytes": float("nan")}).save(tmp_path / "size.json")
    assert not list(tmp_path.iterdir())


def test_a_failed_write_leaves_what_was_there(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    RECORD.save(tmp_path / "size.json")

    def fail(*_: object) -> None:
        raise OSError("disk full")

    monkeypatch.setattr("catalogs.files.durable.rename", fail)
    with pytest.raises(OSError, match="disk full"):
        replace(RECORD, values={}).save(tmp_path / "size.json")
    assert (load(tmp_path / "size.json") or RECORD).values == RECORD.values
    assert [path.name for path in tmp_path.iterdir()] == ["size.json"]


def test_what_a_killed_writer_left_is_removed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    left = durable.partial_name(tmp_path / "size.json")
    monkeypatch.setattr(durable, "_start_time", lambda process: "another process's")
    left.write_bytes(b"{")
    RECORD.save(tmp_path / "size.json")
    assert [path.name for path in tmp_path.iterdir()] == ["size.json"]


def test_provenance_says_which_code_made_it() -> None:
    found = Provenance.now(2.0)
    assert found.code
    assert found.processor_seconds == 2.0
    assert "processor" in found.machine


def test_a_measurement_is_kept_where_it_can_be(tmp_path: Path) -> None:
    Record.keep(tmp_path / "size.json", "size", 2, {"seed": 3}, {"megabytes": 1.5}, 0.0)
    found = load(tmp_path / "size.json", seed=3)
    assert found is not None
    assert found.values == {"megabytes": 1.5}
    assert (found.provenance.processor_seconds or 0.0) > 0.0
    (tmp_path / "in the way").write_text("")
    Record.keep(tmp_path / "in the way" / "size.json", "size", 2, {}, {}, 0.0)
    Record.keep(None, "size", 2, {}, {}, 0.0)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["in the way", "size.json"]
