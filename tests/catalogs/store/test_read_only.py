"""A catalog in a read-only folder: it is read, and what it refuses to write is named."""

from __future__ import annotations

import os
import shutil
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest

from catalogs.store.catalog import Catalog
from catalogs.tools.check import check
from tests.catalogs.conftest import add_member, make_plan, picture
from tests.support.catalog_files import tree


def as_nobody(work: Callable[[], None]) -> str:
    """The error that `work` raises in a child that owns nothing, or "": root would be allowed everything."""
    receive, send = os.pipe()
    child = os.fork()
    if child == 0:
        said = b""
        try:
            if os.geteuid() == 0:
                os.seteuid(65534)
            work()
        except BaseException as error:
            said = f"{type(error).__name__}: {error}".encode()
        os.write(send, said)
        os._exit(0)
    os.close(send)
    os.waitpid(child, 0)
    with os.fdopen(receive, "rb") as stream:
        return stream.read().decode()


@pytest.fixture
def read_only() -> Iterator[Catalog]:
    """A catalog in a folder that everyone may read and nobody write."""
    folder = Path(tempfile.mkdtemp())
    made = Catalog.create(folder / "small.cdb", make_plan())
    add_member(made, "first", 120.0, seed=1)
    for path in [folder, *folder.rglob("*")]:
        path.chmod(0o555 if path.is_dir() else 0o444)
    yield made
    for path in [folder, *folder.rglob("*")]:
        path.chmod(0o755 if path.is_dir() else 0o644)
    shutil.rmtree(folder)


def test_a_read_only_folder_is_named_and_nothing_changes(read_only: Catalog) -> None:
    before = tree(read_only.path)
    said = as_nobody(lambda: add_member(read_only, "second", 150.0))
    assert said.startswith("PermissionError")
    assert str(read_only.path) in said
    said = as_nobody(lambda: Catalog.create(read_only.path.parent / "new.cdb", make_plan()) and None)
    assert said.startswith("PermissionError")
    assert "new.cdb" in said
    assert tree(read_only.path.parent) == {f"small.cdb/{name}": data for name, data in before.items()}


def test_a_read_only_catalog_is_read(read_only: Catalog) -> None:
    def read() -> None:
        again = Catalog.create(read_only.path, make_plan())
        assert np.array_equal(again.image("first", "iso", 7), picture(1107))
        assert check(again.path) == []

    assert as_nobody(read) == ""
