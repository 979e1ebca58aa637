"""Sizes of images' files are the disk's, and the same where they are packed."""

from __future__ import annotations

from pathlib import Path

import pytest

from catalogs.store.catalog import Catalog
from catalogs.store.pictures import picture_sizes
from catalogs.tools.packing import pack


def test_sizes_are_the_files_in_order_also_packed(catalog: Catalog, tmp_path: Path) -> None:
    pack(catalog.path, tmp_path / "packed.cdb")
    packed = Catalog.open(tmp_path / "packed.cdb")
    for member in catalog.members:
        names = [*reversed(member.appearances)]
        held = [
            catalog.image_path(member, name, v).stat().st_size for name in names for v in range(len(member.cameras))
        ]
        assert picture_sizes(member, catalog.plan, names) == held
        assert picture_sizes(packed.member(member.name), packed.plan, names) == held
    catalog.image_path(member, names[0], 0).unlink()
    with pytest.raises(FileNotFoundError):
        picture_sizes(member, catalog.plan, names)
