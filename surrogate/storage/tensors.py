"""A safetensors file whose header is checked before anything else of it is read, https://github.com/huggingface/safetensors."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from typing import Any, BinaryIO

import safetensors
import safetensors.torch
from torch import Tensor

from catalogs.vocabulary.words import joined_names

BYTES = {"F32": 4, "F16": 2, "U16": 2, "U8": 1}  # of one number, by the types that models are stored in
MOST_BYTES = 4_000_000_000  # of a file: 10 million Gaussians have some 2.5 GB
MOST_HEADER_BYTES = 1_000_000  # a model has some fifty tensors, of 100 bytes each in the header
MOST_COLUMNS = 1_000_000  # of a tensor beside its rows: one without rows needs no bytes, however wide it says it is


def read_tensors(file: BinaryIO, size: int) -> bytes:
    """The contents of a file of `size` bytes, once its header says that its tensors need all of them.

    Raises ValueError naming the tensor, or saying what is wrong with the header.
    """
    start = file.read(8)
    length = int.from_bytes(start, "little")
    if len(start) < 8 or length > min(MOST_HEADER_BYTES, size - 8):
        raise ValueError("its header is cut off or too long")
    header = file.read(length)
    needed = _needed(_parsed(header))
    if needed != size - 8 - length:
        raise ValueError(f"its header describes {needed:,} bytes of tensors, and {size - 8 - length:,} are there")
    content = start + header + file.read(needed)
    if len(content) != size:
        raise ValueError("it became shorter while it was read")
    return content


def tensors_of(content: bytes) -> dict[str, Tensor]:
    """The tensors of a file's contents, each in memory of its own.

    In the file they begin at any address, and some processors' matrix products depend on it.
    """
    try:
        return {name: tensor.clone() for name, tensor in safetensors.torch.load(content).items()}
    except (safetensors.SafetensorError, KeyError, TypeError, RuntimeError) as error:
        raise ValueError(f"its header can't be read: {error}") from error


def _parsed(header: bytes) -> Mapping[str, Any]:
    try:
        values = json.loads(header)
    except (ValueError, RecursionError) as error:
        raise ValueError(f"its header is not JSON: {error}") from error
    if not isinstance(values, dict):
        raise ValueError("its header is not a JSON object")
    return {name: value for name, value in values.items() if name != "__metadata__"}


def _needed(header: Mapping[str, Any]) -> int:
    """The number of bytes that the tensors of a header need."""
    total = 0
    for name, entry in header.items():
        form, shape = (entry.get("dtype"), entry.get("shape")) if isinstance(entry, dict) else (None, None)
        if not isinstance(form, str) or form not in BYTES:
            raise ValueError(f"tensor {name!r} must be of a type among {joined_names(sorted(BYTES))}, got {form!r}")
        if not isinstance(shape, list) or not all(type(side) is int and side >= 0 for side in shape):
            raise ValueError(f"tensor {name!r} must have a shape of whole numbers, got {shape!r}")
        if math.prod(shape[1:]) > MOST_COLUMNS or (shape and shape[0] > MOST_BYTES):
            raise ValueError(f"tensor {name!r} can't be of shape {shape}")
        total += BYTES[form] * math.prod(shape)
    return total
