"""Arrays go from process to process by one copy into memory that has no name."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from insitu.background import segments
from insitu.background.segments import new_memory, pack, unpack

BIG = np.arange(24**3, dtype=np.float64).reshape(24, 24, 24)
ARRAYS: dict[str, Any] = {
    "rows": BIG,
    "columns": np.asfortranarray(BIG),
    "without its border": BIG[1:-1, 1:-1, 1:-1],
    "backwards": BIG[::-1, :, ::-2],
    "of big end first": BIG.astype(">f4"),
    "truth": BIG > 9.0,
    "half": BIG.astype(np.float16),
    "small": np.ones(3),
    "empty": np.zeros((0, 3)),
    "a record": np.zeros(4096, [("x", "f8"), ("y", "i2")]),
    "words": np.array(["a", "b"] * 4000),
    "objects": np.array([{"a": 1}, None], dtype=object),
}


@pytest.mark.parametrize("name", ARRAYS)
def test_arrays_come_out_as_they_went_in(name: str) -> None:
    memory, array = new_memory(), ARRAYS[name]
    found = unpack(pack({"values": [array], "spacing": (1.0, 2.0)}, memory), memory)
    assert found["spacing"] == (1.0, 2.0)
    assert found["values"][0].dtype == array.dtype
    assert np.array_equal(found["values"][0], array)
    os.close(memory)


def test_memory_is_used_again(monkeypatch: pytest.MonkeyPatch) -> None:
    memory = new_memory()
    first = pack([BIG, BIG], memory)
    assert os.fstat(memory).st_size == BIG.nbytes, "the same array lies there once"
    assert len(first) < 1000
    monkeypatch.setattr(segments, "AT_ONCE", 1000)
    monkeypatch.setattr(segments, "PART", 1000)
    assert np.array_equal(unpack(pack(BIG.T, memory), memory), BIG.T)
    assert np.array_equal(unpack(pack([-BIG[:20], BIG], memory), memory)[1], BIG)
    os.close(memory)


def test_what_is_given_may_only_be_read() -> None:
    memory = new_memory()
    found = unpack(pack(BIG, memory), memory)
    with pytest.raises(ValueError, match="read-only"):
        found[0, 0, 0] = 1.0
    os.close(memory)


def test_without_named_memory_there_is_a_file_without_a_name(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delattr(os, "memfd_create", raising=False)
    monkeypatch.setenv("TMPDIR", str(tmp_path))
    memory = new_memory()
    assert np.array_equal(unpack(pack(BIG, memory), memory), BIG)
    assert list(tmp_path.iterdir()) == []
    os.close(memory)
