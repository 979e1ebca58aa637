"""A pack gives back the pixels and files that were put in, takes bounded memory, and follows nothing that leads elsewhere."""

from __future__ import annotations

import os
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from PIL import Image

from catalogs.files.images import read_stored, write_image
from catalogs.files.packed import ENTRY, HEAD, MAGIC, Pack, PackError, encoded, open_pack, pack_problem, write_pack
from tests.catalogs.conftest import picture
from tests.support.damage import damaged, memory_at_most

SHOWN = ("dvr", "iso")
VIEWS = 3


def files(folder: Path, suffix: str = ".png") -> list[Path]:
    """The pictures of a member of two appearances and three views."""
    made = []
    for number in range(len(SHOWN) * VIEWS):
        path = folder / f"{number}{suffix}"
        rgba = picture(number)
        write_image(path, rgba if suffix == ".png" else rgba.astype(np.float32) / np.float32(255.0))
        made.append(path)
    return made


@pytest.fixture
def pack(tmp_path: Path) -> Pack:
    write_pack(tmp_path / "pictures.h5", SHOWN, files(tmp_path))
    return opened(tmp_path / "pictures.h5")


def opened(path: Path) -> Pack:
    return open_pack(path, len(SHOWN) * VIEWS, 12, 16)


def written_by(text: str) -> Callable[[Path], object]:
    """Another program's file of the same picture: other bytes than ours."""

    def write(path: Path) -> None:
        if text == "another level":
            Image.open(path).save(path, compress_level=9)
        else:
            data = path.read_bytes()
            path.write_bytes(
                data[:-12] + b"\0\0\0\4tEXtab\0c" + zlib.crc32(b"tEXtab\0c").to_bytes(4, "big") + data[-12:]
            )

    return write


@pytest.mark.parametrize("suffix", [".png", ".exr"])
def test_pixels_and_files_come_back_as_they_were(tmp_path: Path, suffix: str) -> None:
    given = files(tmp_path, suffix)
    write_pack(tmp_path / "pictures.h5", SHOWN, given)
    pack = opened(tmp_path / "pictures.h5")
    for number, file in enumerate(given):
        np.testing.assert_array_equal(pack.pixels(number), read_stored(file))
        assert pack.pixels(number).dtype == read_stored(file).dtype
        assert pack.entries[number]["size"] == file.stat().st_size
        assert pack.file(number) == (file.read_bytes(), True)
    assert not pack.entries["original"].any()
    assert pack_problem(pack, SHOWN) is None


@pytest.mark.parametrize("how", ["another level", "a text"])
def test_files_that_others_wrote_come_back_byte_by_byte(tmp_path: Path, how: str) -> None:
    given = files(tmp_path)
    written_by(how)(given[4])
    assert given[4].read_bytes() != encoded(read_stored(given[4]))
    write_pack(tmp_path / "pictures.h5", SHOWN, given)
    pack = opened(tmp_path / "pictures.h5")
    assert [bool(kept) for kept in pack.entries["original"]] == [False] * 4 + [True, False]
    assert [pack.file(number) for number in range(6)] == [(file.read_bytes(), True) for file in given]
    np.testing.assert_array_equal(pack.pixels(4), read_stored(given[4]))
    assert pack_problem(pack, SHOWN) is None


def test_another_encoder_is_told_from_the_same_bytes(pack: Pack, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("catalogs.files.packed.encode_png", lambda pixels: b"other bytes")
    assert pack.file(0) == (b"other bytes", False)


def test_hdf5_finds_the_same_pictures(pack: Pack) -> None:
    with h5py.File(pack.path) as file:
        assert set(file) == {"channels", "meta"}
        for number, appearance in enumerate(SHOWN):
            channel = file["channels"][appearance]
            assert channel.shape == (VIEWS, 12, 16, 4)
            for view in range(VIEWS):
                np.testing.assert_array_equal(channel[view], pack.pixels(number * VIEWS + view))


def test_equal_pictures_make_equal_files(tmp_path: Path) -> None:
    for name in "ab":
        write_pack(tmp_path / f"{name}.h5", SHOWN, files(tmp_path))
    assert (tmp_path / "a.h5").read_bytes() == (tmp_path / "b.h5").read_bytes()


def test_pictures_of_other_sizes_are_refused(tmp_path: Path) -> None:
    given = files(tmp_path)
    write_image(given[2], picture(0, 5, 6))
    with pytest.raises(PackError, match=r"2\.png"):
        write_pack(tmp_path / "pictures.h5", SHOWN, given)


def rewritten(path: Path, **changes: Any) -> None:
    """Give the index's head or its first entry other values, with a checksum that holds."""
    data = bytearray(path.read_bytes())
    head = np.frombuffer(bytes(data[: HEAD.itemsize]), HEAD).copy()
    count = len(SHOWN) * VIEWS
    entries = np.frombuffer(bytes(data[HEAD.itemsize : HEAD.itemsize + count * ENTRY.itemsize]), ENTRY).copy()
    for name, value in changes.items():
        (head if name in HEAD.names else entries)[0][name] = value
    head[0]["crc"] = zlib.crc32(entries.tobytes())
    data[: HEAD.itemsize + entries.nbytes] = head.tobytes() + entries.tobytes()
    path.write_bytes(bytes(data))


def bomb(path: Path) -> None:
    """A first picture that inflates to 64 MB."""
    deflated = zlib.compress(bytes(1 << 26), 9)
    place = path.stat().st_size
    with path.open("ab") as stream:
        stream.write(deflated)
    rewritten(path, offset=place, length=min(len(deflated), 1500))


HOSTILE: dict[str, tuple[Callable[[Path], object], str]] = {
    "more pictures": (lambda p: rewritten(p, count=2**31), "claims"),
    "larger pictures": (lambda p: rewritten(p, height=2**31 - 1, width=2**31 - 1), "claims"),
    "another type": (lambda p: rewritten(p, bytes=8), "claims"),
    "floats": (lambda p: rewritten(p, bytes=4), "does not fill"),
    "beyond the end": (lambda p: rewritten(p, offset=2**63), "beyond"),
    "around the end": (lambda p: rewritten(p, offset=2**64 - 1, length=2**64 - 1), "beyond"),
    "across the end": (lambda p: rewritten(p, offset=p.stat().st_size - 3), "beyond"),
    "too long": (lambda p: (p.write_bytes(p.read_bytes() + bytes(9999)), rewritten(p, length=9000)), "more bytes"),
    "a bomb": (bomb, "damaged"),
    "wrong place": (lambda p: rewritten(p, offset=HEAD.itemsize), "damaged"),
    "a changed index": (lambda p: p.write_bytes(p.read_bytes()[:60] + b"?" + p.read_bytes()[61:]), "checksum"),
    "another file": (lambda p: p.write_bytes(b"\x89HDF\r\n\x1a\n" + bytes(5000)), "not a pack"),
    "empty": (lambda p: p.write_bytes(b""), "not a pack"),
    "a pipe": (lambda p: (p.unlink(), os.mkfifo(p)), "named pipe"),
    "missing": (lambda p: p.unlink(), "can't be read"),
    "a long original": (lambda p: rewritten(p, original=9, size=2**40), "beyond"),
}


@pytest.mark.parametrize("case", HOSTILE)
def test_a_hostile_file_is_one_error_in_little_memory(pack: Pack, case: str) -> None:
    change, told = HOSTILE[case]
    change(pack.path)
    with memory_at_most(4 << 20), pytest.raises(PackError, match=told) as refused:
        opened(pack.path).pixels(0)
    assert str(pack.path) in str(refused.value)


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture], deadline=None)
@given(data=st.data())
def test_whatever_was_damaged_gives_the_pictures_or_one_error(pack: Pack, data: st.DataObject) -> None:
    """Of the index, and of the pixels: what it gives is right, or it says so."""
    if not hasattr(pack, "whole"):
        object.__setattr__(pack, "whole", (pack.path.read_bytes(), [pack.pixels(n).copy() for n in range(6)]))
    whole, pixels = pack.whole  # type: ignore[attr-defined]
    pack.path.write_bytes(data.draw(damaged(whole, head=data.draw(st.sampled_from([HEAD.itemsize + 240, len(whole)])))))
    try:
        with memory_at_most(4 << 20):
            read = [opened(pack.path).pixels(number) for number in range(6)]
    except PackError as error:
        if str(pack.path) not in str(error):
            pytest.fail(f"names no file: {error}")
        return
    for number in range(6):
        np.testing.assert_array_equal(read[number], pixels[number])


def edit(path: Path, change: Callable[[h5py.File], object]) -> None:
    with h5py.File(path, "r+") as file:
        file.create_group("originals")  # where the old pictures stay, so that their place is not written over
        change(file)


def replaced(file: h5py.File, name: str, link: object) -> None:
    file.move(name, f"originals/{name}")
    file[name] = link


def virtual(file: h5py.File) -> None:
    layout = h5py.VirtualLayout((VIEWS, 12, 16, 4), np.uint8)
    layout[:] = h5py.VirtualSource("elsewhere.h5", "channels/iso", (VIEWS, 12, 16, 4))
    file.move("channels/iso", "originals/iso")
    file.create_virtual_dataset("channels/iso", layout)


def external(file: h5py.File) -> None:
    file.move("channels/iso", "originals/iso")
    file.create_dataset("channels/iso", (VIEWS, 12, 16, 4), np.uint8, external=[("/etc/passwd", 0, 9999)])


def other_filter(file: h5py.File) -> None:
    file.move("channels/iso", "originals/iso")
    file.create_dataset("channels/iso", (VIEWS, 12, 16, 4), np.uint8, chunks=(1, 12, 16, 4), compression="lzf")


def other_pixels(file: h5py.File) -> None:
    file.move("channels/iso", "originals/iso")
    data = np.full((VIEWS, 12, 16, 4), 7, np.uint8)
    file.create_dataset("channels/iso", data=data, chunks=(1, 12, 16, 4), compression="gzip")


FOREIGN: dict[str, tuple[Callable[[h5py.File], object], str]] = {
    "external link": (lambda f: replaced(f, "channels/iso", h5py.ExternalLink("/etc/passwd", "/x")), "a link"),
    "soft link": (lambda f: replaced(f, "channels/iso", h5py.SoftLink("/channels/dvr")), "a link"),
    "external storage": (external, "not stored in it"),
    "virtual": (virtual, "not stored in it"),
    "another filter": (other_filter, "not deflated"),
    "other pixels": (other_pixels, "elsewhere"),
    "a group": (
        lambda f: (f.move("channels/iso", "originals/iso"), f.create_group("channels/iso")),
        "not stored in it",
    ),
    "nothing": (lambda f: f.move("channels", "originals/channels"), "others can read"),
    "no meta": (lambda f: replaced(f, "meta", h5py.ExternalLink("/etc/passwd", "/x")), "a link"),
    "more": (lambda f: f.create_group("channels/more"), "does not belong to a pack"),
    "another size": (
        lambda f: (
            f.move("channels/iso", "originals/iso"),
            f.create_dataset(
                "channels/iso", (2**20, 2**20, 2**20, 4), np.uint8, chunks=(1, 12, 16, 4), compression="gzip"
            ),
        ),
        "its channel iso is",
    ),
}


@pytest.mark.parametrize("case", FOREIGN)
def test_what_others_would_read_otherwise_is_told_and_never_followed(pack: Pack, case: str) -> None:
    change, told = FOREIGN[case]
    edit(pack.path, change)
    again = opened(pack.path)
    for number in range(6):
        np.testing.assert_array_equal(again.pixels(number), read_stored(pack.path.parent / f"{number}.png"))
    with memory_at_most(16 << 20):
        assert told in (pack_problem(again, SHOWN) or "")


def test_what_is_no_hdf5_for_others_is_told(pack: Pack) -> None:
    data = pack.path.read_bytes()
    place = data.index(b"\x89HDF")
    pack.path.write_bytes(data[:place] + b"other" + data[place + 5 :])
    assert "others can read" in (pack_problem(opened(pack.path), SHOWN) or "")


def test_the_index_fits_before_what_hdf5_writes(tmp_path: Path) -> None:
    given = files(tmp_path)
    write_pack(tmp_path / "many.h5", [f"a{n}" for n in range(50)], given * 50)
    pack = open_pack(tmp_path / "many.h5", 300, 12, 16)
    assert pack.path.read_bytes().startswith(MAGIC)
    for number in (0, 123, 299):
        np.testing.assert_array_equal(pack.pixels(number), read_stored(given[number % 6]))
    assert pack_problem(pack, [f"a{n}" for n in range(50)]) is None
