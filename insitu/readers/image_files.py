"""NRRD and MetaImage, of which VTK's readers leave parts out: the order of bytes in packed data, text, lists of files, turned axes.

Source: teem's definition of the NRRD format; ITK's of MetaImage, "MetaIO".
"""

from __future__ import annotations

import bz2
import gzip
import io
import math
import re
import warnings
import zlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

from insitu.readers.arrays import check_room
from insitu.readers.named_files import require_named

NRRD = {".nrrd", ".nhdr"}
META = {".mha", ".mhd"}
LONGEST = 1 << 16  # bytes of a header
SHEARED = 1e-4  # cosine between axes that count as orthogonal
CHARACTERS = 32  # of a number in text, at most

_C_NAMES = {
    "i1": "signed char|int8|int8_t",
    "u1": "uchar|unsigned char|uint8|uint8_t",
    "i2": "short|short int|signed short|signed short int|int16|int16_t",
    "u2": "ushort|unsigned short|unsigned short int|uint16|uint16_t",
    "i4": "int|signed int|int32|int32_t",
    "u4": "uint|unsigned int|uint32|uint32_t",
    "i8": "longlong|long long|long long int|signed long long|signed long long int|int64|int64_t",
    "u8": "ulonglong|unsigned long long|unsigned long long int|uint64|uint64_t",
    "f4": "float",
    "f8": "double",
}
NRRD_TYPES = {name: kind for kind, names in _C_NAMES.items() for name in names.split("|")}
META_TYPES = {"CHAR": "i1", "UCHAR": "u1", "SHORT": "i2", "USHORT": "u2", "INT": "i4", "UINT": "u4", "LONG": "i4"}
META_TYPES |= {"ULONG": "u4", "LONG_LONG": "i8", "ULONG_LONG": "u8", "FLOAT": "f4", "DOUBLE": "f8"}
ENCODINGS = {
    "gzip": "gzip",
    "gz": "gzip",
    "bzip2": "bzip2",
    "bz2": "bzip2",
    "raw": "raw",
    "txt": "text",
    "text": "text",
}
ENCODINGS |= {"ascii": "text"}


@dataclass(frozen=True)
class _Header:
    """An image as its header says: counts along its own axes, the fastest first; the step along each of these [3, 3]; its files.

    `start` is where the values begin in each file, -1 that they end it.
    """

    name: str
    kind: np.dtype[Any]
    counts: tuple[int, ...]
    components: int
    steps: NDArray[np.float64]
    origin: NDArray[np.float64]
    encoding: str
    files: tuple[Path, ...]
    start: int = 0
    lines: int = 0


def read_image(path: Path) -> Any:
    """The vtkImageData of a file; raises ValueError where it is cut short, longer than it says, sheared, or of another kind."""
    from vtkmodules.util.numpy_support import numpy_to_vtk
    from vtkmodules.vtkCommonDataModel import vtkImageData

    with path.open("rb") as file:
        head = file.read(LONGEST)
    try:
        header = _nrrd(path, head) if path.suffix.lower() in NRRD else _meta(path, head)
    except (KeyError, IndexError) as error:
        raise ValueError(f"its header lacks {error}") from None
    if len(header.counts) != 3 or min(header.counts) < 1:
        raise ValueError(f"it must have three axes of space, got sizes {list(header.counts)}")
    values = _values(header).reshape(*header.counts[::-1], header.components)  # [z, y, x, components]
    values, spacing, origin = _upright(values, header)
    image = vtkImageData()
    image.SetDimensions(*values.shape[2::-1])
    image.SetSpacing(*spacing)
    image.SetOrigin(*origin)
    array = numpy_to_vtk(np.ascontiguousarray(values).reshape(-1, header.components), deep=True)
    array.SetName(header.name)
    image.GetPointData().SetScalars(array)
    return image


def _values(header: _Header) -> NDArray[Any]:
    size = math.prod(header.counts) * header.components
    check_room(size * header.kind.itemsize, "it")
    if size % len(header.files):
        raise ValueError(f"its {len(header.files)} files can't hold {size} values in equal parts")
    return np.concatenate([_part(header, path, size // len(header.files)) for path in header.files])


def _part(header: _Header, path: Path, count: int) -> NDArray[Any]:
    """The values in one of the files of an image."""
    require_named(path)
    claimed = count * header.kind.itemsize
    with path.open("rb") as file:
        for _ in range(header.lines):
            file.readline()
        if header.encoding == "raw":
            begin = path.stat().st_size - claimed if header.start < 0 else file.tell() + header.start
            length = path.stat().st_size - begin
            if begin >= 0 and length == claimed:
                file.seek(begin)
                return _native(file.read(), header.kind)
        else:
            file.seek(header.start, io.SEEK_CUR)
            if header.encoding == "text":
                return _numbers(file.read(count * CHARACTERS + 1), count, header.kind)
            data = _unpacked(file, header.encoding, claimed)
            if len(data) == claimed:
                return _native(data, header.kind)
            length = len(data)
    reason = "was it cut short, or is it being written?" if length < claimed else "do they belong together?"
    raise ValueError(f"{path.name} has {max(0, length)} bytes of values, its header claims {claimed}: {reason}")


def _unpacked(file: IO[bytes], encoding: str, claimed: int) -> bytes:
    """The values and at most one byte more."""
    try:
        if encoding == "zlib":
            unpacking = zlib.decompressobj(wbits=47)
            data = unpacking.decompress(file.read(), claimed + 1)
            if not unpacking.eof and len(data) == claimed:
                raise EOFError("their end is missing")
            return data
        opened = gzip.GzipFile(fileobj=file) if encoding == "gzip" else bz2.BZ2File(file)
        return opened.read(claimed + 1)
    except (OSError, EOFError, zlib.error) as error:
        raise ValueError(f"its packed values are damaged: {error}") from None


def _native(data: bytes, kind: np.dtype[Any]) -> NDArray[Any]:
    return np.frombuffer(data, kind).astype(kind.newbyteorder("="), copy=False)


def _numbers(text: bytes, count: int, kind: np.dtype[Any]) -> NDArray[Any]:
    words = text.split()
    if len(words) != count:
        raise ValueError(f"it has {len(words)} numbers, its header claims {count}: was it cut short?")
    return np.array(words).astype(kind.newbyteorder("="))


def _upright(values: NDArray[Any], header: _Header) -> tuple[NDArray[Any], NDArray[np.float64], NDArray[np.float64]]:
    """Values along the axes of space, spacing and origin.  Turned axes stay the image's own, which a warning says.

    Raises ValueError where axes are not orthogonal.
    """
    steps, origin = header.steps, header.origin.copy()
    spacing = np.linalg.norm(steps, axis=1)
    if not np.isfinite(steps).all() or not np.isfinite(origin).all() or spacing.min() <= 0:
        raise ValueError("its spacing, directions and origin must be finite numbers, and no step zero")
    cosines = steps / spacing[:, None]
    if np.abs(cosines @ cosines.T - np.eye(3)).max() > SHEARED:
        raise ValueError("its axes are not at right angles: resample it on a regular grid")
    along = np.abs(cosines).argmax(axis=1)  # the axis of space of each of its own
    if np.abs(np.abs(cosines).max(axis=1) - 1).max() > SHEARED:
        warnings.warn("its axes are turned against those of space: it is shown along its own", stacklevel=2)
        return values, spacing, origin
    for own, axis in enumerate(along):
        if steps[own, axis] < 0:
            values = np.flip(values, 2 - own)
            origin[axis] += steps[own, axis] * (header.counts[own] - 1)
    order = [int(np.flatnonzero(along == axis)[0]) for axis in range(3)]
    return values.transpose([2 - order[2], 2 - order[1], 2 - order[0], 3]), spacing[order], origin


# ---- NRRD -------------------------------------------------------------------------------------------------------------


def _nrrd(path: Path, head: bytes) -> _Header:
    match = re.search(rb"\r?\n\r?\n", head)
    end = match.end() if match else len(head)
    lines = head[:end].decode("latin-1").splitlines()
    if not lines or not lines[0].startswith("NRRD"):
        raise ValueError("it does not begin as a NRRD file does")
    said: dict[str, str] = {}
    for number, line in enumerate(lines):
        key, colon, value = line.partition(":")
        if colon and not line.startswith("#") and not value.startswith("="):
            said[key.strip().lower().replace(" ", "")] = value.strip()
            if value.strip().startswith("LIST"):
                said["listed"] = "\n".join(filter(None, map(str.strip, lines[number + 1 :])))
                break
    kind = NRRD_TYPES.get(said["type"].lower())
    encoding = ENCODINGS.get(said["encoding"].lower())
    if kind is None or encoding is None:
        raise ValueError(f"values of type {said['type']!r} in encoding {said['encoding']!r} are not read")
    order = ">" if said.get("endian", "little").lower() == "big" else "<"
    counts = tuple(map(int, said["sizes"].split()))
    kinds = said.get("kinds", "").lower().split() or ["domain"] * len(counts)
    directions = re.findall(r"none|\([^)]*\)", said.get("spacedirections", ""))
    is_vector = len(counts) == 4 and (kinds[0] not in ("domain", "space") or directions[:1] == ["none"])
    own = slice(int(is_vector), None)
    steps = _directions(directions[own]) if directions else np.diag(_spacings(said, len(counts), own))
    origin = _floats(said.get("spaceorigin", said.get("axismins", "") if not directions else "")) or [0.0] * 3
    files = _files(path, said.get("datafile", ""), said.get("listed", ""))
    start, skipped = int(said.get("byteskip", 0)), int(said.get("lineskip", 0))
    name = "ImageFile" if encoding == "raw" else "ImageScalars"
    header = _Header(
        name,
        np.dtype(order + kind),
        counts[own],
        counts[0] if is_vector else 1,
        steps,
        np.array(origin[-3:]),
        encoding,
        files,
    )
    if not files:
        return replace(header, files=(path,), start=end + start if start >= 0 else -1, lines=skipped)
    return replace(header, start=start, lines=skipped)


def _spacings(said: Mapping[str, str], count: int, own: slice) -> list[float]:
    """Spacing along the axes of space: stated, else by the least and the greatest place on each, else 1."""
    stated = _floats(said.get("spacings", ""))
    low, high = _floats(said.get("axismins", "")), _floats(said.get("axismaxs", ""))
    if not stated and len(low) == len(high) == count:
        cells = [word.startswith("c") for word in said.get("centers", said.get("centerings", "")).split()] or [
            False
        ] * count
        sizes = map(int, said["sizes"].split())
        stated = [(b - a) / max(1, n - (not c)) for a, b, n, c in zip(low, high, sizes, cells, strict=True)]
    return [step if math.isfinite(step) else 1.0 for step in (stated or [1.0] * count)[own]]


def _directions(vectors: Sequence[str]) -> NDArray[np.float64]:
    directions = [_floats(vector) for vector in vectors]
    if len(directions) != 3 or any(len(vector) != 3 for vector in directions):
        raise ValueError(f"its space directions must be three vectors of three numbers, got {list(vectors)}")
    return np.array(directions)


def _floats(text: str) -> list[float]:
    return [float(word) for word in re.split(r"[\s,()]+", text) if word]


def _files(path: Path, said: str, listed: str) -> tuple[Path, ...]:
    """The files that a header names: one, a list below it, or a printed pattern with its first and last number and its step."""
    if said.split()[:1] == ["LIST"]:
        return tuple(path.parent / name for name in listed.splitlines() if name)
    words = said.split()
    if len(words) >= 4 and re.search(r"%\d*d", words[0]):
        first, last, step = map(int, words[1:4])
        numbers = range(first, last + (1 if step > 0 else -1), step)
        return tuple(path.parent / re.sub(r"%\d*d", lambda form, n=n: form[0] % n, words[0]) for n in numbers)  # type: ignore[misc]
    return (path.parent / said,) if said else ()


# ---- MetaImage --------------------------------------------------------------------------------------------------------


def _meta(path: Path, head: bytes) -> _Header:
    said: dict[str, str] = {}
    end = 0
    for line in head.split(b"\n"):
        end += len(line) + 1
        key, equals, value = (part.decode("latin-1").strip() for part in line.partition(b"="))
        if not equals:
            break
        said[key] = value
        if key == "ElementDataFile":
            break
    name = said["ElementDataFile"]
    kind = META_TYPES.get(said["ElementType"].removeprefix("MET_").removesuffix("_ARRAY"))
    if kind is None:
        raise ValueError(f"values of type {said['ElementType']!r} are not read")

    def true(*keys: str) -> bool:
        return any(said.get(key, "").lower() in ("true", "1", "yes") for key in keys)

    order = ">" if true("BinaryDataByteOrderMSB", "ElementByteOrderMSB") else "<"
    encoding = "zlib" if true("CompressedData") else "raw" if true("BinaryData") or "BinaryData" not in said else "text"
    spacing = _floats(said.get("ElementSpacing", said.get("ElementSize", ""))) or [1.0] * 3
    turned = _floats(next((said[k] for k in ("TransformMatrix", "Rotation", "Orientation") if k in said), ""))
    origin = _floats(next((said[k] for k in ("Offset", "Position", "Origin") if k in said), "")) or [0.0] * 3
    counts = tuple(map(int, said["DimSize"].split()))
    if len(counts) != 3 or len(spacing) != 3 or len(origin) != 3 or len(turned) not in (0, 9):
        raise ValueError(f"it must have three axes of space, got DimSize {said['DimSize']!r}")
    steps = np.array(turned or np.eye(3)).reshape(3, 3) * np.array(spacing)[:, None]
    local = name.upper() == "LOCAL"
    listed = "\n".join(line.strip() for line in head[end:].decode("latin-1").splitlines())
    return _Header(
        "MetaImage",
        np.dtype(order + kind),
        counts,
        int(said.get("ElementNumberOfChannels", 1)),
        steps,
        np.array(origin),
        encoding,
        (path,) if local else _files(path, name, listed),
        end if local else int(said.get("HeaderSize", 0)),
    )
