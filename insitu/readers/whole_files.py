"""Files that VTK reads, looked at before it does: cut short, without one of their parts, or larger than the memory.

VTK takes what there is and leaves the rest of an array as its memory happens to be, or repeats the block before.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Sequence
from pathlib import Path

from insitu.readers.arrays import check_room
from insitu.readers.ensight import check_case
from insitu.readers.legacy_vtk import check_legacy
from insitu.readers.named_files import require_named
from insitu.readers.netcdf import is_classic, read_header
from insitu.readers.vtk_xml_arrays import check_arrays
from insitu.readers.xdmf_sizes import check_sizes
from insitu.readers.xml_files import LARGEST

HEADER = 1 << 16  # bytes in which a file says how large it is
TAIL = 1 << 10  # bytes in which an XML file ends
DEEPEST = 8  # files that name files
XDMF = {".xdmf", ".xmf", ".xdmf3"}
XML = re.compile(r"\.p?vt[ircsupmt]|\.vtmb|\.vthb?|\.vtp[cd]|\.pvd|\.htg")
INDEXES = re.compile(r"\.pvt[irsupt]|\.vtmb?|\.vthb?|\.vtp[cd]")
PART = re.compile(rb"<(?:\w*Piece|DataSet)\b[^>]*?\b(?:Source|file)\s*=\s*[\"']([^\"']+)[\"']")


def check_whole(path: Path, above: tuple[Path, ...] = ()) -> None:
    """Raise ValueError where a file, or one that it names, is cut short, absent, or takes more memory than there is.

    `above` are the files that led to it, none of which it may name.
    """
    above = (*above, path.resolve())
    check_room(path.stat().st_size, "it")
    suffix = path.suffix.lower()
    with path.open("rb") as file:
        head = file.read(HEADER)
    _check_room(head.decode("latin-1"))
    if suffix == ".vtk":
        check_legacy(path)
    elif suffix in XDMF:
        check_sizes(path)
    elif XML.fullmatch(suffix):
        _check_end(path)
        check_arrays(path)
    elif suffix in (".case", ".encas"):
        _check_ensight(path, head.decode("latin-1"))
    elif is_classic(path):  # Exodus
        read_header(path)
    for part in parts(path):
        require_named(part)
        if part.resolve() in above:
            raise ValueError(f"it names {part.name}, of which it is a part itself")
        if len(above) >= DEEPEST:
            raise ValueError(f"it names {part.name}, which is more than {DEEPEST} files deep")
        try:
            check_whole(part, above)
        except ValueError as error:
            raise ValueError(f"{part.name}: {error}") from None


def parts(path: Path) -> Iterator[Path]:
    """The files that one of VTK's XML files names, each once."""
    if INDEXES.fullmatch(path.suffix.lower()) and path.stat().st_size <= LARGEST:
        named = [name.decode("utf-8", "replace") for name in PART.findall(path.read_bytes())]
        twice = [name for name in dict.fromkeys(named) if named.count(name) > 1] if len(set(named)) < len(named) else []
        if twice and path.suffix.lower().startswith(".pvt"):
            raise ValueError(f"it names {twice[0]} for two of its pieces: is another one missing?")
        for name in dict.fromkeys(named):
            yield path.parent / name


def _check_end(path: Path) -> None:
    size = path.stat().st_size
    with path.open("rb") as file:
        file.seek(max(0, size - TAIL))
        tail = file.read()
    if b"</VTKFile" not in tail:
        raise ValueError("it does not end with </VTKFile>: was it cut short?")


def _check_room(head: str) -> None:
    """Raise ValueError where the extent in a header takes more memory than there is."""
    extents = re.findall(r'WholeExtent="\s*([-\d\s]+?)\s*"', head)
    for extent in (list(map(int, match.split())) for match in extents):
        if len(extent) == 6:
            check_room(
                _samples([high - low + 1 for low, high in zip(extent[::2], extent[1::2], strict=True)]), "its extent"
            )
    for match in re.findall(r"(?m)^DIMENSIONS\s+(\d+)\s+(\d+)\s+(\d+)", head):
        check_room(_samples(list(map(int, match))), "its DIMENSIONS")
    for match in re.findall(r'NumberOf(?:Points|Cells)="\s*(\d+)\s*"|(?m:^POINTS\s+(\d+))', head):
        check_room(12 * int(match[0] or match[1]), "its number of points or cells")


def _samples(counts: Sequence[int]) -> int:
    """Bytes of as many float32."""
    return 4 * int(math.prod(float(max(0, count)) for count in counts))


def _check_ensight(path: Path, text: str) -> None:
    """Raise ValueError where, of one variable's files at several times on a fixed mesh, one is shorter than the others.

    EnSight's files do not say how long they are, and VTK takes what there is.
    """
    check_case(path, text)
    names = [line.split()[-1] for line in text.splitlines() if ":" in line and "*" in line]
    if any("*" in line for line in text.splitlines() if line.strip().lower().startswith("model:")):
        return
    for name in names:
        parts = sorted(path.parent.glob(re.sub(r"\*+", "[0-9]*", name)))
        sizes = {part: part.stat().st_size for part in parts}
        for part in parts:
            longest = max(parts, key=lambda other: sizes[other])
            if sizes[part] == sizes[longest]:
                continue
            data = part.read_bytes()
            if b"\0" in data[:80] or data.count(b"\n") < longest.read_bytes().count(
                b"\n"
            ):  # numbers in text vary in length
                raise ValueError(f"{part.name} is shorter than {longest.name}: was it cut short?")
