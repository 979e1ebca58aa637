"""All images of a member in one HDF5 file, which pycinema's reader opens as one image with a channel per appearance.

    channels/<appearance>    [V, H, W, 4], a deflated chunk per view: uint8 with straight alpha, or float32, premultiplied
    originals/<number>       bytes of an image file that encoding its pixels again does not reproduce
    meta                     empty; pycinema requires it

The block that HDF5 leaves to users (H5Pset_userblock) holds an index: the place of each image's chunk, and length and checksum of
its original file.  Images are read by the index alone, in pieces of bounded size; HDF5's links, filters and sizes are never
followed.  Only `catalogs check` opens an untrusted file with the HDF5 library, to compare places, and reads no data with it.
"""

from __future__ import annotations

import functools
import sys
import tempfile
import zlib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from catalogs.files import deflate, durable
from catalogs.files.durable import Stamp
from catalogs.files.images import MOST_CHANNELS, encode_png, read_stored, write_exr

PACK = "pictures.h5"
MAGIC = b"catalogs pack 1\n"
HEAD = np.dtype(
    [("magic", "S16"), ("count", "<u4"), ("height", "<u4"), ("width", "<u4"), ("bytes", "<u4"), ("crc", "<u4")]
)
ENTRY = np.dtype([("offset", "<u8"), ("length", "<u8"), ("size", "<u8"), ("crc", "<u4"), ("original", "<u8")])
SMALLEST_BLOCK = 512  # HDF5 wants a power of two from there
SLACK = 1024  # bytes by which deflating may lengthen an image, beside 1/1000
CACHED_INDEXES = 16
LEVEL = 1  # of zlib; higher levels don't shrink rendered images


class PackError(ValueError):
    """A pack is absent, damaged, or of another member; the message names it."""


@dataclass(frozen=True, eq=False)
class Pack:
    """The images of one member, numbered view by view, appearance by appearance.

    Attributes
    ----------
    path : the file.
    height, width : of each image, pixels.
    dtype : "uint8", stored with straight alpha, or "float32", premultiplied.
    entries : (N,) records: offset and length of an image's deflated pixels; size and checksum of its original file.
    """

    path: Path
    height: int
    width: int
    dtype: str
    entries: NDArray[Any]  # [N] of ENTRY

    def __repr__(self) -> str:
        return f"<Pack {self.path}: {len(self.entries)} images of {self.width}x{self.height}, {self.dtype}>"

    def pixels(self, number: int) -> NDArray[Any]:
        """An image as stored, (H, W, 4); raises PackError where it is damaged."""
        entry = self.entries[number]
        raw = self.height * self.width * MOST_CHANNELS * np.dtype(self.dtype).itemsize
        inflater = deflate.decompressobj()
        try:
            data = inflater.decompress(self._piece(int(entry["offset"]), int(entry["length"])), raw + 1)
        except deflate.DeflateError as error:
            raise PackError(f"{self.path} is damaged: image {number}: {error}") from error
        if len(data) != raw or not inflater.eof or inflater.unused_data:
            raise PackError(f"{self.path} is damaged: image {number} does not fill {self.width}x{self.height} pixels")
        values = np.frombuffer(data, self.dtype)
        values = values if sys.byteorder == "little" else values.byteswap()
        return values.reshape(self.height, self.width, MOST_CHANNELS)

    def file(self, number: int) -> tuple[bytes, bool]:
        """The image's file, PNG or EXR, and True where its bytes equal the original's, False where only the pixels do."""
        entry = self.entries[number]
        original, size = int(entry["original"]), int(entry["size"])
        data = self._piece(original, size) if original else encoded(self.pixels(number))
        return data, len(data) == entry["size"] and deflate.crc32(data) == entry["crc"]

    def _piece(self, offset: int, length: int) -> bytes:
        with durable.opened(self.path) as stream:
            stream.seek(offset)
            data = stream.read(length)
        if len(data) != length:
            raise PackError(f"{self.path} is truncated: it should reach to byte {offset + length}")
        return data


def encoded(pixels: NDArray[Any]) -> bytes:
    """The file of stored pixels (H, W, 4): PNG for uint8, EXR for float32."""
    if pixels.dtype == np.uint8:
        return encode_png(pixels)
    with tempfile.TemporaryDirectory() as folder:  # OpenImageIO writes to files
        path = Path(folder) / "image.exr"
        write_exr(path, pixels)
        return path.read_bytes()


def write_pack(path: Path, appearances: Sequence[str], files: Sequence[Path]) -> None:
    """Write the image files of a member, in the order of their numbers, as one new file; not synced.

    Raises ImageError for a damaged image, PackError where images differ in size or type, OSError where the disk refuses.
    """
    import h5py

    views = len(files) // len(appearances)
    entries, checksums = np.zeros(len(files), ENTRY), []
    block = SMALLEST_BLOCK
    while block < HEAD.itemsize + entries.nbytes:
        block *= 2
    first = read_stored(files[0])
    little = first.dtype.newbyteorder("<")
    with h5py.File(path, "w", userblock_size=block) as pack:
        pack.create_group("meta")
        channels = pack.create_group("channels")
        for number, file in enumerate(files):
            data, pixels = durable.read(file), read_stored(file)
            if (pixels.shape, pixels.dtype) != (first.shape, first.dtype) or pixels.shape[2] != MOST_CHANNELS:
                raise PackError(
                    f"{file} is {pixels.shape} of {pixels.dtype}, {files[0]} {first.shape} of {first.dtype}"
                )
            appearance, view = appearances[number // views], number % views
            if view == 0:
                shape, chunk = (views, *pixels.shape), (1, *pixels.shape)
                dataset = channels.create_dataset(appearance, shape, little, chunks=chunk, compression="gzip")
            raw = pixels.astype(little, copy=False).tobytes()
            checksums.append(_checksum(pixels))
            dataset.id.write_direct_chunk((view, 0, 0, 0), zlib.compress(raw, LEVEL))
            place = dataset.id.get_chunk_info_by_coord((view, 0, 0, 0))
            entries[number] = place.byte_offset, place.size, len(data), deflate.crc32(data), 0
            if encoded(pixels) != data:
                if len(data) > _most(len(raw)):
                    raise PackError(f"{file} can't be packed: it has {len(data)} bytes, its pixels {len(raw)}")
                original = pack.create_dataset(f"originals/{number}", data=np.frombuffer(data, np.uint8))
                entries[number]["original"] = original.id.get_offset()
    height, width, _ = first.shape
    kind = first.dtype.itemsize
    head = np.array((MAGIC, len(files), height, width, kind, deflate.crc32(entries.tobytes())), HEAD)
    with open(path, "r+b") as stream:
        stream.write(head.tobytes() + entries.tobytes())
    _verify(path, entries, checksums, (height, width))


def _verify(path: Path, entries: NDArray[Any], checksums: Sequence[int], size: tuple[int, int]) -> None:
    """Raise PackError unless the index leads to the same pixels and original files."""
    pack = open_pack(path, len(entries), *size)
    for number, checksum in enumerate(checksums):
        same_file = entries[number]["original"] == 0 or pack.file(number)[1]
        if _checksum(pack.pixels(number)) != checksum or not same_file:
            raise PackError(f"{path}: image {number} changed in writing: the disk or this version of HDF5 is faulty")


def open_pack(path: Path, count: int, height: int, width: int) -> Pack:
    """The pack at `path`, which must hold `count` images of this size; reads only the index, which is cached.

    Raises PackError naming a file that is absent, not a pack, or of another member.
    """
    try:
        return _opened(path, durable.stamp(path), count, height, width)
    except OSError as error:
        raise PackError(f"{path} can't be read: {error.strerror or error}") from error


@functools.lru_cache(maxsize=CACHED_INDEXES)
def _opened(path: Path, stamp: Stamp, count: int, height: int, width: int) -> Pack:
    with durable.opened(path) as stream:
        data = stream.read(HEAD.itemsize + count * ENTRY.itemsize)
    if len(data) < HEAD.itemsize or not data.startswith(MAGIC.rstrip(b"\n")):
        raise PackError(f"{path} is not a pack of images")
    head = np.frombuffer(data, HEAD, 1)[0]
    claimed = tuple(int(head[name]) for name in ("count", "height", "width"))
    if claimed != (count, height, width) or head["bytes"] not in (1, 4):
        raise PackError(
            f"{path} claims {claimed[0]} images of {claimed[2]}x{claimed[1]}; its member has {count} of {width}x{height}"
        )
    body = data[HEAD.itemsize :]
    if len(body) != count * ENTRY.itemsize or deflate.crc32(body) != head["crc"]:
        raise PackError(f"{path} is damaged: its index has a wrong checksum")
    entries = np.frombuffer(body, ENTRY)
    dtype = "uint8" if head["bytes"] == 1 else "float32"
    raw = height * width * MOST_CHANNELS * int(head["bytes"])
    most = np.uint64(_most(raw))
    originals = entries[entries["original"] > 0]
    for offsets, lengths in ((entries["offset"], entries["length"]), (originals["original"], originals["size"])):
        if (offsets > stamp.size).any() or (lengths > stamp.size - np.minimum(offsets, stamp.size)).any():
            raise PackError(f"{path} is damaged or truncated: its index leads beyond its {stamp.size} bytes")
    if (entries["length"] > most).any() or (originals["size"] > most).any():
        raise PackError(f"{path} is damaged: an image claims more bytes than its pixels can take")
    return Pack(path, height, width, dtype, entries)


def _checksum(pixels: NDArray[Any]) -> int:
    return deflate.crc32(pixels.tobytes())


def _most(raw: int) -> int:
    """The largest file of an image with `raw` bytes of pixels."""
    return raw + raw // 1000 + SLACK


def pack_problem(pack: Pack, appearances: Sequence[str]) -> str | None:
    """The problem of a pack with a valid index, in its images or for other HDF5 readers; or None."""
    for number in range(len(pack.entries)):
        try:
            pack.pixels(number)
        except (PackError, OSError) as error:
            return str(error)
    return next(_structure_problems(pack, appearances), None)


def _structure_problems(pack: Pack, appearances: Sequence[str]) -> Iterator[str]:
    """Differences between the index and what other HDF5 readers would read; reads no data."""
    import h5py

    views = len(pack.entries) // len(appearances)
    shape = (views, pack.height, pack.width, MOST_CHANNELS)
    try:
        with h5py.File(pack.path, "r", locking=False) as file:
            yield from _foreign_links(file, {"channels", "meta", "originals"})
            yield from _foreign_links(file["channels"], set(appearances))
            for number, appearance in enumerate(appearances):
                data = file["channels"][appearance]
                if not isinstance(data, h5py.Dataset) or data.is_virtual or data.external:
                    yield f"its channel {appearance} is not stored in it"
                elif (data.shape, data.chunks, data.dtype) != (shape, (1, *shape[1:]), np.dtype(pack.dtype)):
                    yield f"its channel {appearance} is {data.shape} of {data.dtype}, not {shape} of {pack.dtype}"
                elif data.compression != "gzip" or data.id.get_create_plist().get_nfilters() != 1:
                    yield f"its channel {appearance} is not deflated"
                else:
                    yield from _displaced(data, pack.entries[number * views : (number + 1) * views])
    except (OSError, KeyError, RuntimeError, ValueError, TypeError) as error:
        yield f"it is not an HDF5 file that others can read: {error}"


def _foreign_links(group: Any, names: set[str]) -> Iterator[str]:
    """Entries of a group beside `names`, and links to other places."""
    import h5py

    for name in group:
        if name not in names or not isinstance(group.get(name, getlink=True), h5py.HardLink):
            yield f"it holds {group.name.rstrip('/')}/{name}, which does not belong to a pack or is a link"


def _displaced(data: Any, entries: NDArray[Any]) -> Iterator[str]:
    for view, entry in enumerate(entries):
        place = data.id.get_chunk_info_by_coord((view, 0, 0, 0))
        if (place.byte_offset, place.size) != (entry["offset"], entry["length"]):
            yield f"view {view} of its channel {data.name.rsplit('/')[-1]} is elsewhere than its index says"
