"""The records that exported pictures keep of how they were made."""

from __future__ import annotations

import json
import tempfile
from os import PathLike
from pathlib import Path
from typing import Any

from catalogs.files.images import exr_text
from catalogs.files.png import text_of

KEY = "gs-surrogate"  # of the iTXt chunk and of the string attribute that hold the record
EXR_MAGIC = b"\x76\x2f\x31\x01"
LONGEST = 1 << 20  # characters of a record


def record_of(source: str | PathLike[str] | bytes) -> dict[str, Any]:
    """The record that a PNG or EXR file keeps, by its path or its bytes.

    Raises ValueError where it is damaged or longer than 2^20 characters, or no such file, or keeps none; OSError where it can't be
    read.
    """
    named, data = ("these bytes", source) if isinstance(source, bytes) else (str(source), Path(source).read_bytes())
    try:
        text = _exr_record(data) if data.startswith(EXR_MAGIC) else text_of(data, KEY)
        if text is not None and len(text) > LONGEST:
            raise ValueError(f"it has {len(text)} characters, more than {LONGEST}")
        record = None if text is None else json.loads(text)
    except (ValueError, RecursionError) as error:
        raise ValueError(f"no record can be read from {named}: {error}") from error
    if not isinstance(record, dict):
        raise ValueError(f"{named} keeps no record of how it was made")
    return record


def _exr_record(data: bytes) -> str | None:
    with tempfile.TemporaryDirectory(prefix="gs-surrogate-") as folder:  # OpenImageIO reads only files in Python
        path = Path(folder) / "picture.exr"
        path.write_bytes(data)
        return exr_text(path, KEY)
