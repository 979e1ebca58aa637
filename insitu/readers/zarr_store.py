"""Zarr stores from strangers, checked before any library opens them."""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import Any

# Of Zarr's codecs those that only compress: one of numpy objects would unpickle, and run, what it reads.
CODECS = (
    "adler32 astype bitround blosc bytes bz2 crc32 crc32c delta endian fixedscaleoffset fletcher32 gzip lz4 lzma packbits pcodec "
    "quantize sharding_indexed shuffle transpose vlen-bytes vlen-utf8 zfpy zlib zstd"
)


def check_store(path: Path) -> None:
    """Raise ValueError where a store leads out of its folder, or names a codec that is not known to be harmless."""
    inside = path.resolve()
    if not path.is_dir():
        raise ValueError("a Zarr store is a folder: unpack it")
    for folder, folders, files in os.walk(path):
        for name in [*folders, *files]:
            if (place := Path(folder, name)).is_symlink() and not place.resolve().is_relative_to(inside):
                raise ValueError(f"{place.relative_to(path)} is a link out of the store: only what lies in it is read")
        for name in {"zarr.json", ".zarray", ".zmetadata"}.intersection(files):
            unknown = sorted(_codecs(json.loads(Path(folder, name).read_text(encoding="utf-8"))) - set(CODECS.split()))
            if unknown:
                raise ValueError(
                    f"{Path(folder, name).relative_to(path)} uses the codecs {unknown}, which could run code or are unknown"
                )


def _codecs(record: Any) -> set[str]:
    """Names of all codecs in the metadata of an array, those of older and newer versions alike."""
    names: set[str] = set()
    if isinstance(record, dict):
        for key in ("compressor", "filters", "codecs", "index_codecs"):
            listed = record.get(key) or []
            for codec in listed if isinstance(listed, list) else [listed]:
                if isinstance(codec, dict):
                    names.add(str(codec.get("id") or codec.get("name")).removeprefix("numcodecs."))
        return names.union(*map(_codecs, record.values()))
    return names.union(*map(_codecs, record)) if isinstance(record, list) else names
