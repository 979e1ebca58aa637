"""Folders that count as one file."""

from __future__ import annotations

from pathlib import Path

import pytest

from insitu.readers.folders import files_below, is_folder_file


def made(base: Path, *names: str) -> None:
    for name in names:
        path = base / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.touch()


@pytest.mark.parametrize(
    ("names", "whole"),
    [
        (["a.zarr/.zarray"], "a.zarr"),
        (["plt10/Header", "plt10/Level_0/Cell_H"], "plt10"),
        (["out.bp/md.idx", "out.bp/md.0", "out.bp/data.0"], "out.bp"),
    ],
)
def test_what_lies_in_a_folder_tells(tmp_path: Path, names: list[str], whole: str) -> None:
    made(tmp_path, *names, "deep/b.npy", ".hidden/c.npy", "d10.npy", "d9.npy")
    assert is_folder_file(tmp_path / whole)
    assert not is_folder_file(tmp_path / "deep")
    assert not is_folder_file(tmp_path / "d9.npy")
    below = [path.relative_to(tmp_path).as_posix() for path in files_below(tmp_path)]
    assert sorted(below) == sorted(["d9.npy", "d10.npy", "deep/b.npy", whole])
    assert below.index("d9.npy") < below.index("d10.npy")
    assert {path.name for path in files_below(tmp_path, deep=False)} == {"d9.npy", "d10.npy", whole}
