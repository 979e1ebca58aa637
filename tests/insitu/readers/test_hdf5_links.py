"""Links in HDF5 files: none is followed, and an error that asks for an array names them."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest

from insitu.readers.files import read_field
from insitu.readers.hdf5_links import links

VALUES = np.random.default_rng(0).random((4, 5, 6))
LINKS: dict[str, tuple[Any, str]] = {
    "external": (h5py.ExternalLink("other.h5", "/rho"), "rho to other.h5 /rho"),
    "absolute": (h5py.ExternalLink("/etc/passwd", "rho"), "rho to /etc/passwd rho"),
    "soft": (h5py.SoftLink("/group/p"), "rho to /group/p"),
    "broken": (h5py.SoftLink("/nowhere"), "rho to /nowhere"),
    "circular": (h5py.SoftLink("/rho"), "rho to /rho"),
}


@pytest.mark.parametrize("kind", LINKS)
def test_links_are_named_and_not_followed(tmp_path: Path, kind: str) -> None:
    with h5py.File(tmp_path / "other.h5", "w") as file:
        file["rho"] = VALUES
    link, named = LINKS[kind]
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file["group/p"] = 2 * VALUES
        file["rho"] = link
        file.attrs["spacing"] = (1.0, 1.0, 1.0)
        assert [name for name, _ in links(file)] == ["rho"]
    message = (
        rf"a\.h5: there is no array 'rho' of numbers; .*attributes: spacing; links, which are not followed: {named}$"
    )
    with pytest.raises(ValueError, match=message):
        read_field(tmp_path / "a.h5", array="rho")
    assert np.array_equal(read_field(tmp_path / "a.h5", array="p").values, 2 * VALUES)
    assert np.array_equal(read_field(tmp_path / "a.h5").values, 2 * VALUES)
