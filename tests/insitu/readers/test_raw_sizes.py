"""Raw numbers have no check but their size: a file is as long as its header claims, or refused."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from insitu.readers.files import read_data
from tests.support.xcompact3d_files import write_snapshot

VALUES = np.random.default_rng(0).random((4, 5, 6)).astype(np.float32)
AXES = [np.arange(6.0), np.arange(5.0), np.arange(4.0)]


def npy(folder: Path) -> Path:
    np.save(folder / "a.npy", VALUES)
    return folder / "a.npy"


def npz(folder: Path) -> Path:
    np.savez(folder / "a.npz", f=VALUES)
    return folder / "a.npz"


def xdmf(folder: Path) -> Path:
    return write_snapshot(folder, 10, {"ux": VALUES}, AXES, kind="<f4")


@pytest.mark.parametrize("write", [npy, npz, xdmf])
@pytest.mark.parametrize("change", [-480, -4, -1, 1, 4, 480, 4800])
def test_a_file_of_another_size_is_refused_with_both(tmp_path: Path, write: object, change: int) -> None:
    path = write(tmp_path)  # type: ignore[operator]
    assert np.array_equal(read_data(path).values, VALUES)
    raw = path.with_name("ux-0010.bin") if path.suffix == ".xdmf" else path
    data = raw.read_bytes() if path.suffix != ".npz" else npy(tmp_path).read_bytes()
    claimed, changed = len(data), data[:change] if change < 0 else data + bytes(change)
    if path.suffix == ".npz":
        import zipfile

        with zipfile.ZipFile(path, "w") as file:
            file.writestr("f.npy", changed)
    else:
        raw.write_bytes(changed)
    with pytest.raises(ValueError, match=rf"claims? {claimed} bytes, .*has {len(changed)}: ") as caught:
        read_data(path)
    assert str(path) in str(caught.value)


def test_arrays_may_share_a_file(tmp_path: Path) -> None:
    path = write_snapshot(tmp_path, 10, {"ux": VALUES, "pp": -VALUES}, AXES, kind="<f4")
    ux, pp = (tmp_path / f"{name}-0010.bin" for name in ("ux", "pp"))
    ux.write_bytes(ux.read_bytes() + pp.read_bytes())
    before, after = path.read_text().replace("pp-0010.bin", "ux-0010.bin").rsplit('Seek="0"', 1)
    path.write_text(f'{before}Seek="{VALUES.nbytes}"{after}')
    assert np.array_equal(read_data(path, array="ux").values, VALUES)
    assert np.array_equal(read_data(path, array="pp").values, -VALUES)
    ux.write_bytes(ux.read_bytes() + bytes(4))
    with pytest.raises(ValueError, match=r"its arrays claim 960 bytes, ux-0010\.bin has 964"):
        read_data(path, array="ux")


def test_two_arrays_in_one_numpy_file_are_refused(tmp_path: Path) -> None:
    with (tmp_path / "a.npy").open("wb") as file:
        np.save(file, VALUES)
        np.save(file, -VALUES)
    with pytest.raises(ValueError, match=r"a\.npy: it claims 608 bytes, and has 1216"):
        read_data(tmp_path / "a.npy")
