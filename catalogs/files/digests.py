"""Digests, by which damage shows that leaves a file valid, such as an image in another's place.

A digest is 16 hexadecimal digits: BLAKE2b (RFC 7693) with 8 bytes, which `b2sum --length 64 FILE` prints too.
"""

from __future__ import annotations

import hashlib
import json
from pathlib import Path
from typing import Any

from catalogs.files import durable

DIGEST_BYTES = 8
LENGTH = 2 * DIGEST_BYTES  # characters
SEAL = ',\n "digest": "'  # begins a sealed text's last line


def digest_of(data: bytes) -> str:
    """The digest of some bytes."""
    return hashlib.blake2b(data, digest_size=DIGEST_BYTES).hexdigest()


def digest_of_file(path: Path) -> str:
    """The digest of a regular file, read in pieces; raises OSError as `durable.opened` does."""
    running = hashlib.blake2b(digest_size=DIGEST_BYTES)
    with durable.opened(path) as stream:
        while piece := stream.read(durable.BLOCK):
            running.update(piece)
    return running.hexdigest()


def digest_of_json(values: Any) -> str:
    """The digest of JSON values, whatever the order of their keys and the blanks in their file."""
    return digest_of(json.dumps(values, sort_keys=True).encode())


def sealed(record: dict[str, Any]) -> bytes:
    """A JSON file of these values, with the digest of all text before it as the last key, `digest`."""
    text = json.dumps(record, indent=1, allow_nan=False).removesuffix("\n}")
    return f'{text}{SEAL}{digest_of(text.encode())}"\n}}'.encode()


def is_sealed(data: bytes) -> bool:
    """True for a file as `sealed` made it; reads no JSON."""
    text, _, last = data.rpartition(SEAL.encode())
    return last == f'{digest_of(text)}"\n}}'.encode()
