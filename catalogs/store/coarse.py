"""Coarse fields: each member's fields with at most 64³ samples, in at most 0.3 MB a field.

The file beside a member's images is a numpy archive of plain arrays; for a field `codes`, `range`, `spacing`, `origin`, `bits` and
`whole`.  For several fields those of the second are called "1/codes" and so on, and `fields` holds all names.

A sample's code has `bits` bits: 0 in a hole, else from 1 on evenly over the `range` of the field's values.  Stored are the codes'
differences along x, y and z, modulo 2**bits, with alternating signs 0, -1, 1, -2 ..., as planes of their high and low bytes.
"""

from __future__ import annotations

import io
import math
import zipfile
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from catalogs.files import durable
from catalogs.files.digests import digest_of
from catalogs.store.summary import DAMAGED, FIELDS

MOST_SAMPLES = 64**3
MOST_BITS = 16
MOST_BYTES = 299_000  # of the compressed codes; the other arrays take the rest of 0.3 MB
MOST_FIELDS = 256
LEVEL = 4  # of zlib: higher ones take three times as long for 4 % less

Triple = tuple[float, float, float]


@dataclass(frozen=True, eq=False)
class CoarseField:
    """One field of a member with few samples.

    Attributes
    ----------
    values : (Z, Y, X), in the field's unit, NaN in holes; float32, or float64 where float32 would move them by more than half a
        step of their codes.
    spacing, origin : (x, y, z), world units; sample [k, j, i] lies at ``origin + spacing * (i, j, k)``.  First and last samples
        lie on the box of the field.
    whole : True for the field's own samples, False for averages around each.
    bits : of the codes in the file; they are at most half a step, 1 / (2**bits - 2) of the range, from the values.
    """

    values: NDArray[np.floating]  # [Z, Y, X]
    spacing: Triple
    origin: Triple
    whole: bool
    bits: int = MOST_BITS

    def __post_init__(self) -> None:
        if self.values.ndim != 3 or not 0 < self.values.size <= MOST_SAMPLES or self.values.dtype not in ("f4", "f8"):
            raise ValueError(
                f"a coarse field has (z, y, x) values of float32 or float64, at most {MOST_SAMPLES:,}, got "
                f"{self.values.shape} of {self.values.dtype}"
            )
        if not np.isfinite((self.spacing, self.origin)).all() or not min(self.spacing) > 0:
            raise ValueError(f"a coarse field needs a place, got spacing {self.spacing} and origin {self.origin}")
        if not 2 <= self.bits <= MOST_BITS:
            raise ValueError(f"a coarse field has codes of 2 to {MOST_BITS} bits, got {self.bits}")

    @property
    def holes(self) -> NDArray[np.bool_] | None:
        """The samples without a value, (Z, Y, X); None where all have one."""
        holes = np.isnan(self.values)
        return holes if holes.any() else None

    def __repr__(self) -> str:
        nz, ny, nx = self.values.shape
        of = "the field's own" if self.whole else "averages"
        return f"<CoarseField of {nx} x {ny} x {nz} samples, {of}, {self.bits} bits>"


def save_coarse_fields(path: Path, coarse: Mapping[str, CoarseField]) -> str:
    """Write a member's coarse fields as one archive (see `coarse_bytes`), into a folder nobody reads yet; returns its digest."""
    data = coarse_bytes(coarse)
    durable.write(path, data)
    return digest_of(data)


def coarse_bytes(coarse: Mapping[str, CoarseField]) -> bytes:
    """The file of a member's coarse fields, by name ("" for a single one).

    Raises ValueError for a field without a single finite value, and for infinite values.
    """
    if not 0 < len(coarse) <= MOST_FIELDS:
        raise ValueError(f"a member has 1 to {MOST_FIELDS} coarse fields, got {len(coarse)}")
    names: dict[str, Any] = {} if list(coarse) == [""] else {FIELDS: np.array(list(coarse), dtype=np.str_)}
    arrays = [_arrays(field, field.bits) for field in coarse.values()]
    while True:
        prefixed = {_prefix(n) + name: array for n, one in enumerate(arrays) for name, array in one.items()}
        data, sizes = _archive({**names, **prefixed})
        excess = [sizes[_prefix(number) + "codes"] - MOST_BYTES for number in range(len(arrays))]
        if max(excess) <= 0:
            return data
        for number, (field, over) in enumerate(zip(coarse.values(), excess, strict=True)):
            if over > 0:  # each bit less saves an eighth of a byte for a sample
                arrays[number] = _arrays(field, int(arrays[number]["bits"]) + -8 * over // field.values.size)


def load_coarse_fields(path: Path) -> dict[str, CoarseField]:
    """The coarse fields in a file, at least one, by name; "" for a single one.

    Takes at most some 4 MB for a field, whatever the file says.  Raises ValueError naming a file that is absent or damaged.
    """
    with _opened(path) as (archive, prefixes):
        return {name: _field(archive, prefix) for name, prefix in prefixes.items()}


def coarse_names(path: Path) -> tuple[str, ...]:
    """The names of the fields in a file; reads no more of it.  Raises as `load_coarse_fields`."""
    with _opened(path) as (_, prefixes):
        return tuple(prefixes)


def are_whole(path: Path) -> bool:
    """True if all coarse fields in a file are the fields' own samples; reads no more of it.  Raises as `load_coarse_fields`."""
    with _opened(path) as (archive, prefixes):
        return all(bool(_read(archive, prefix + "whole", ())) for prefix in prefixes.values())


@contextmanager
def _opened(path: Path) -> Iterator[tuple[zipfile.ZipFile, dict[str, str]]]:
    """The archive, and how the arrays of each field begin; errors name the file."""
    try:
        with durable.opened(path) as stream, zipfile.ZipFile(stream) as archive:
            listed = FIELDS + ".npy" in archive.NameToInfo
            names = [str(name) for name in _read(archive, FIELDS).ravel()] if listed else [""]
            if not 0 < len(names) <= MOST_FIELDS or len(set(names)) < len(names):
                raise ValueError(f"it has {len(names)} fields")
            yield archive, {name: _prefix(number) for number, name in enumerate(names)}
    except durable.SpecialFileError as error:
        raise ValueError(str(error)) from None
    except (*DAMAGED, NotImplementedError) as error:
        raise ValueError(f"{path} is not a file of coarse fields: {error}") from error


def encoded(values: NDArray[np.floating], bits: int) -> tuple[NDArray[np.uint16], tuple[float, float]]:
    """Codes of finite values and NaN, and the range (low, high) that they span.

    Raises ValueError where no value is finite, or one is infinite.
    """
    finite = ~np.isnan(values)
    if not finite.any() or np.isinf(values).any():
        raise ValueError("a coarse field needs finite values, and NaN in holes")
    low, high = (
        float(np.min(values, where=finite, initial=np.inf)),
        float(np.max(values, where=finite, initial=-np.inf)),
    )
    scale = _scale(low, high)
    span = high * scale - low * scale
    share = (np.where(finite, values, low).astype(np.float64) * scale - low * scale) / (span or 1.0)
    codes = np.rint(share * (2**bits - 2)).astype(np.uint16) + np.uint16(1)
    codes[~finite] = 0
    return codes, (low, high)


def decoded(codes: NDArray[np.uint16], bits: int, ends: tuple[float, float]) -> NDArray[np.floating]:
    """The values of codes, NaN in holes: float32 where that moves none by more than half a step, else float64."""
    (low, high), steps = ends, 2**bits - 2
    scale = _scale(low, high)
    span = high * scale - low * scale
    values = (low * scale + (codes.astype(np.float64) - 1.0) / steps * span) / scale
    values[codes == 0] = np.nan
    with np.errstate(over="ignore", invalid="ignore"):
        single = values.astype(np.float32)
        moved = np.abs(single - values) * scale  # NaN in holes
    return values if (moved > 0.5 * span / steps).any() else single


def _scale(low: float, high: float) -> float:
    """A factor that keeps the difference of two numbers finite."""
    return 1.0 if math.isfinite(high - low) else 0.25


def _arrays(field: CoarseField, bits: int) -> dict[str, NDArray[Any]]:
    """The arrays of a field in the file."""
    codes, ends = encoded(field.values, bits)
    numbers = _differences(codes, bits)
    return {
        "codes": np.stack([numbers >> 8, numbers & 255]).astype(np.uint8),  # [2, Z, Y, X]
        "range": np.array(ends),
        "spacing": np.array(field.spacing),
        "origin": np.array(field.origin),
        "bits": np.array(bits),
        "whole": np.array(field.whole),
    }


def _field(archive: zipfile.ZipFile, prefix: str) -> CoarseField:
    """A field of an archive; raises one of `DAMAGED` where it is none."""
    place = {name: _read(archive, prefix + name, (3,)) for name in ("spacing", "origin")}
    bits, ends = int(_read(archive, prefix + "bits", ())), _read(archive, prefix + "range", (2,))
    planes = _read(archive, prefix + "codes")
    if planes.dtype != np.uint8 or planes.ndim != 4 or planes.shape[0] != 2 or not 2 <= bits <= MOST_BITS:
        raise ValueError(f"its codes are {planes.shape} of {planes.dtype}, of {bits} bits")
    low, high = map(float, ends)
    if not np.isfinite(ends).all() or low > high or not planes.size:
        raise ValueError(f"it has {planes.size} codes over a range of {low} to {high}")
    codes = _sums(planes[0].astype(np.uint16) << 8 | planes[1], bits)
    (sx, sy, sz), (ox, oy, oz) = (place[name].astype(np.float64).tolist() for name in ("spacing", "origin"))
    whole = bool(_read(archive, prefix + "whole", ()))
    return CoarseField(decoded(codes, bits, (low, high)), (sx, sy, sz), (ox, oy, oz), whole, bits)


def _differences(codes: NDArray[np.uint16], bits: int) -> NDArray[np.uint16]:
    """Differences of codes along the three axes, small where the field is smooth; `_sums` is the inverse."""
    for axis in range(3):
        codes = np.diff(codes, axis=axis, prepend=np.uint16(0))
    codes = codes & np.uint16(2**bits - 1)
    negative = codes >> (bits - 1) > 0
    return np.where(negative, ~(codes << 1), codes << 1) & np.uint16(2**bits - 1)


def _sums(differences: NDArray[np.uint16], bits: int) -> NDArray[np.uint16]:
    half = differences >> 1
    codes = np.where(differences & 1, ~half, half).astype(np.uint16)
    for axis in range(3):
        codes = np.cumsum(codes, axis=axis, dtype=np.uint16)
    return codes & np.uint16(2**bits - 1)


def _archive(arrays: Mapping[str, NDArray[Any]]) -> tuple[bytes, dict[str, int]]:
    """A numpy archive, the same for the same arrays, and the size of each in it."""
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w") as archive:
        for name, array in arrays.items():
            plain = io.BytesIO()
            np.lib.format.write_array(plain, array, allow_pickle=False)
            archive.writestr(zipfile.ZipInfo(name + ".npy"), plain.getvalue(), zipfile.ZIP_DEFLATED, LEVEL)
    return stream.getvalue(), {name: archive.getinfo(name + ".npy").compress_size for name in arrays}


def _read(archive: zipfile.ZipFile, name: str, shape: tuple[int, ...] | None = None) -> NDArray[Any]:
    """An array of bounded size, of this shape where given."""
    entry = archive.getinfo(name + ".npy")
    if entry.file_size > 2 * MOST_SAMPLES + 4096:
        raise ValueError(f"{name} has {entry.file_size:,} bytes")
    with archive.open(entry) as stream:
        array: NDArray[Any] = np.load(io.BytesIO(stream.read(entry.file_size)), allow_pickle=False)
    if shape is not None and (array.shape != shape or array.dtype.kind not in "fiub"):
        raise ValueError(f"{name} is {array.shape} of {array.dtype}")
    return array


def _prefix(number: int) -> str:
    return f"{number}/" if number else ""
