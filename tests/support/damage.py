"""Files that went wrong: cut short, with other bytes in them, or lying about how much they hold."""

from __future__ import annotations

import re
import tracemalloc
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
from hypothesis import strategies as st

NUMBERS = (
    b"0",
    b"-1",
    b"1",
    b"3",
    b"7",
    b"64",
    b"65535",
    b"2147483647",
    b"4294967296",
    b"99999999999999999999",
    b"1e9",
    b"nan",
)


def damaged(data: bytes, head: int | None = None) -> st.SearchStrategy[bytes]:
    """Damaged versions of a file of these bytes; only the first `head` of them, by default all, change."""
    size = len(data) if head is None else min(head, len(data))
    digits = [match.span() for match in re.finditer(rb"\d+", data[:size])] or [(0, 0)]
    return st.one_of(
        st.integers(0, len(data) - 1).map(lambda end: data[:end]),
        st.tuples(st.integers(0, size - 1), st.integers(0, 255)).map(lambda at: _other_byte(data, *at)),
        st.tuples(st.sampled_from(digits), st.sampled_from(NUMBERS)).map(
            lambda at: data[: at[0][0]] + at[1] + data[at[0][1] :]
        ),
        st.tuples(st.integers(0, size - 1), st.integers(1, 64)).map(lambda at: data[: at[0]] + data[sum(at) :]),
        st.tuples(st.integers(0, size - 8), st.sampled_from([b"\xff" * 8, b"\x7f" + b"\xff" * 7, bytes(8)])).map(
            lambda at: data[: at[0]] + at[1] + data[at[0] + 8 :]
        ),
    )


def _other_byte(data: bytes, place: int, byte: int) -> bytes:
    return data[:place] + bytes([byte]) + data[place + 1 :]


def read_or_refused(read: Callable[[], Any], path: Path, most: int = 64 << 20) -> Any:
    """The result of `read` for a damaged file, None for one clear error: a ValueError that names the file.

    Either way it takes at most `most` bytes of memory.
    """
    found, refused = None, ""
    with memory_at_most(most):
        try:
            found = read()
        except (ValueError, FileNotFoundError) as error:
            refused = str(error)
    if refused:
        assert str(path) in refused
        assert "\n" not in refused.strip()
    return found


@contextmanager
def memory_at_most(most: int) -> Iterator[None]:
    """Fail if Python and numpy take more than `most` bytes meanwhile."""
    tracemalloc.start()
    try:
        yield
        taken = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    if taken > most:
        pytest.fail(f"{taken / 1e6:.0f} MB were taken, more than {most / 1e6:.0f}")
