"""Deflating and inflating by zlib-ng, a faster zlib, where it is installed; else by the standard library.

PNG files have the same bytes by both, for they are deflated by run lengths alone (Z_RLE); a test compares.  Searches for matches,
as at zlib's levels, end differently.  Code that searches calls `zlib` itself: equal input then gives equal files with either.
"""

from __future__ import annotations

try:
    from zlib_ng import zlib_ng as implementation
except ImportError:
    import zlib as implementation  # type: ignore[no-redef]

compressobj, crc32, decompressobj = implementation.compressobj, implementation.crc32, implementation.decompressobj
DeflateError: type[Exception] = implementation.error  # type: ignore[assignment]  # zlib-ng's stub has an instance
