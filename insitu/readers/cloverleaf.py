"""CloverLeaf's legacy VTK files, one for each chunk of the mesh (a rank's part of it) and step: `clover.00001.00040.vtk`.

The code prints a number a line with four digits (its `visit.f90`): coordinates of an even mesh come out uneven, and are taken for
what they were.  Chunks are joined, never resampled.  VTK's own reader is not used: it reads all seven arrays in fifteen times the
time of one, and takes an array that is cut short for whole.
"""

from __future__ import annotations

import math
import os
import re
import warnings
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from catalogs.vocabulary.words import joined_names
from insitu.fields.field import Field
from insitu.readers.arrays import LabelledArray, check_room
from insitu.readers.fortran_numbers import respelled
from insitu.readers.gzip_files import unpacked
from insitu.readers.printed_axis import PrintedAxis, field_on_axes, joined_axis
from insitu.readers.reader import Reader, Sampling, StoredState, chosen_array

NAME = re.compile(r"(?P<stem>.+)\.(?P<chunk>\d+)\.(?P<step>\d+)(?P<ending>\.vtk(\.gz)?)")
LINE = 1 << 10  # bytes: longer lines are none of CloverLeaf's
BLOCK = 1 << 20
KINDS: dict[str, type[np.floating[Any]]] = {"double": np.float64, "float": np.float32}
HEAD = ("# vtk DataFile", "", "ASCII", "DATASET RECTILINEAR_GRID")


@dataclass(frozen=True)
class Section:
    """An array of a chunk: its name, on how many cells or points it is, and the byte where its numbers begin."""

    name: str
    on_cells: bool
    count: int
    kind: type[np.floating[Any]]
    begins: int


@dataclass(frozen=True, eq=False)
class Chunk:
    """A file's part of the mesh: the coordinates of its points along x, y and z."""

    path: Path
    axes: tuple[PrintedAxis, PrintedAxis, PrintedAxis]


def recognizes(path: Path) -> bool:
    """True if the name is `clover.<chunk>.<step>.vtk`."""
    match = NAME.fullmatch(path.name)
    return match is not None and match["stem"] == "clover" and path.is_file()


def files(path: Path) -> list[Path]:
    """The files of all chunks of a step."""
    own = NAME.fullmatch(path.name)
    if own is None:
        return [path]
    ending = f".{own['step']}{own['ending']}"
    chunks = [match for name in os.listdir(path.parent) if name.endswith(ending) and (match := NAME.fullmatch(name))]
    same = [match for match in chunks if match["stem"] == own["stem"]]
    return [path.with_name(match.string) for match in sorted(same, key=lambda match: int(match["chunk"]))] or [path]


def records(path: Path, sampling: Sampling) -> list[StoredState]:
    """The one state in a step's files, which do not know their time."""
    step = _step(path)
    return [StoredState((), {} if step < 0 else {"step": float(step)})]


def read(path: Path, array: str | None, index: tuple[int, ...], sampling: Sampling) -> Field | LabelledArray:
    """A field on the cells, or the points, of all chunks of a step."""
    parts = files(path)
    _check_complete(path, parts)
    chunks, sections = [], []
    for part in parts:
        try:
            with unpacked(part) as inner, inner.open("rb") as file:
                axes = _axes(file, inner.stat().st_size)
                sections.append(_section(file, axes, array))
            chunks.append(Chunk(part, axes))
        except (ValueError, OSError, EOFError) as error:
            raise ValueError(f"{part.name}: {error}") from None
    if len({(section.name, section.on_cells) for section in sections}) > 1:
        raise ValueError(
            f"the chunks hold different arrays: {joined_names(sorted({section.name for section in sections}))}"
        )
    whole, places = _joined(chunks)
    on_cells = sections[0].on_cells
    shape = tuple(len(axis) - on_cells for axis in reversed(whole))
    check_room(8 * math.prod(shape), f"{sections[0].name!r} of {len(parts)} chunks")
    values = np.empty(shape, dtype=sections[0].kind)  # [nz, ny, nx]
    for chunk, section, (x, y, z) in zip(chunks, sections, places, strict=True):
        nx, ny, nz = (len(axis) - on_cells for axis in chunk.axes)
        with unpacked(chunk.path) as inner:
            values[z : z + nz, y : y + ny, x : x + nx] = _values(inner, chunk.path.name, section).reshape(nz, ny, nx)
    return field_on_axes(values, whole, on_cells, sections[0].name)


# ---- the chunks of a step --------------------------------------------------------------------------------------------


def _step(path: Path) -> int:
    """The step in a file's name, -1 where it has none."""
    match = NAME.fullmatch(path.name)
    return -1 if match is None else int(match["step"])


def _most_chunks(path: Path) -> int:
    """The number of files of the step with the most of them, in the same run."""
    own = NAME.fullmatch(path.name)
    if own is None:
        return 0
    others = (match for name in os.listdir(path.parent) if (match := NAME.fullmatch(name)))
    steps = Counter(o["step"] for o in others if (o["stem"], o["ending"]) == (own["stem"], own["ending"]))
    return max(steps.values(), default=0)


def _blocks(path: Path) -> int:
    """The number of chunks that the run's list of files, `clover.visit`, says; 0 where there is none."""
    own = NAME.fullmatch(path.name)
    listed = path.with_name(f"{own['stem']}.visit") if own else path
    if not (own and listed.is_file()):
        return 0
    with listed.open("rb") as file:
        match = re.fullmatch(rb"!NBLOCKS\s+(\d{1,9})\s*", file.readline(LINE))
    return int(match[1]) if match else 0


def _check_complete(path: Path, parts: Sequence[Path]) -> None:
    """Raise ValueError where a chunk is missing, as far as numbers of chunks, other steps and `clover.visit` tell."""
    numbers = {int(match["chunk"]) for part in parts if (match := NAME.fullmatch(part.name))}
    most = max(_most_chunks(path), _blocks(path))
    missing = sorted(set(range(1, 1 + max(most, *numbers, 0))) - numbers) if numbers else []
    if missing:
        raise ValueError(
            f"chunk {missing[0]} of step {_step(path)} is missing, of {max(most, *numbers)} or more: wait for it, or move "
            "the files of another run elsewhere"
        )


def _joined(chunks: Sequence[Chunk]) -> tuple[list[PrintedAxis], list[tuple[int, ...]]]:
    """The axes of the whole mesh, and at which index along x, y and z each chunk begins; ValueError where they don't fill it."""
    axes, begins = [], []
    for number, letter in enumerate("xyz"):
        try:
            axis, begin = joined_axis([chunk.axes[number] for chunk in chunks])
        except ValueError as error:
            raise ValueError(f"the {len(chunks)} chunks make no mesh along {letter}: {error}") from None
        axes.append(axis)
        begins.append(begin)
    places: list[tuple[int, ...]] = list(zip(*begins, strict=True))
    cells = sum(math.prod(len(axis) - 1 for axis in chunk.axes) for chunk in chunks)
    if len(set(places)) < len(places) or cells != math.prod(len(axis) - 1 for axis in axes):
        raise ValueError(
            f"the {len(chunks)} chunks do not fill one box: do they come from runs on other numbers of ranks?"
        )
    return axes, places


# ---- one file --------------------------------------------------------------------------------------------------------


def _axes(file: BinaryIO, size: int) -> tuple[PrintedAxis, PrintedAxis, PrintedAxis]:
    """The coordinates in a file's head; raises ValueError where it is another file, or claims more than it can hold."""
    for expected in HEAD:
        line = _line(file)
        if not line.startswith(expected):
            raise ValueError(f"it is not a file of CloverLeaf: got {line[:40]!r} in place of {expected!r}")
    counts = _numbers(_line(file), "DIMENSIONS", 3)
    if min(counts) < 2 or 2 * sum(counts) > size or 2 * math.prod(n - 1 for n in counts) > size:
        raise ValueError(
            f"it claims {counts} points, more than its {size} bytes can hold, or fewer than 2 along an axis"
        )
    axes = []
    for letter, count in zip("XYZ", counts, strict=True):
        word, words, kind = (*_line(file).split(), "", "", "")[:3]
        if (word, words) != (f"{letter}_COORDINATES", str(count)) or kind not in KINDS:
            raise ValueError(f"{letter}_COORDINATES {count} double must follow, got {' '.join((word, words, kind))!r}")
        axes.append(PrintedAxis.of([_line(file).strip() for _ in range(count)]))
    x, y, z = axes
    return x, y, z


def _section(file: BinaryIO, axes: Sequence[PrintedAxis], array: str | None) -> Section:
    """The array that is asked for, or the only one; `file` stands behind its coordinates."""
    sections = []
    for section in _sections(file, axes):
        if section.name == array:
            return section
        sections.append(section)
    chosen = chosen_array(array, [section.name for section in sections])
    return next(section for section in sections if section.name == chosen)


def _sections(file: BinaryIO, axes: Sequence[PrintedAxis]) -> Iterator[Section]:
    """The arrays of a file, in its order, each when the one before was found whole."""
    sizes = {"CELL_DATA": math.prod(len(axis) - 1 for axis in axes), "POINT_DATA": math.prod(map(len, axes))}
    while line := _line(file, at_end=True):
        word = line.split()[0] if line.split() else ""
        if word not in sizes:
            raise ValueError(f"CELL_DATA or POINT_DATA must follow, got {line[:40]!r}")
        if _numbers(line, word, 1) != [sizes[word]]:
            raise ValueError(f"it has {sizes[word]} values of {word}, but says {line[:40]!r}")
        fields = _line(file)
        if not fields.startswith("FIELD"):
            raise ValueError(f"FIELD must follow, got {fields[:40]!r}")
        for _ in range(_numbers(fields, fields[: fields.rstrip().rfind(" ")], 1)[0]):
            name, components, count, kind = (*_line(file).split(), "", "", "", "")[:4]
            if (components, count) != ("1", str(sizes[word])) or kind not in KINDS:
                words = " ".join((name, components, count, kind))
                raise ValueError(f"an array of {sizes[word]} single values must follow, got {words[:60]!r}")
            yield Section(name, word == "CELL_DATA", sizes[word], KINDS[kind], file.tell())
            _skip_lines(file, sizes[word], name)


def _values(path: Path, name: str, section: Section) -> NDArray[Any]:
    """The numbers of an array [count], parsed a line at a time."""
    try:
        values = _parsed(path, section, lambda line: line)
    except ValueError:
        try:
            values = _parsed(path, section, respelled)  # which takes twice the time
        except ValueError as error:
            raise ValueError(f"{name}: {section.name}: {error}") from None
    if values.shape != (section.count,):
        raise ValueError(f"{name}: {section.name} must have {section.count} lines of one number, got {values.shape}")
    return values


def _parsed(path: Path, section: Section, spell: Callable[[bytes], bytes]) -> NDArray[Any]:
    with path.open("rb") as file, warnings.catch_warnings():
        file.seek(section.begins)
        warnings.simplefilter("ignore")  # of lines without numbers, which the caller counts
        values = np.loadtxt(map(spell, islice(file, section.count)), section.kind, comments=None, ndmin=1)
        after = file.readline(LINE).strip()
    if after and not after[:1].isalpha():
        raise ValueError(f"more than its {section.count} lines follow, such as {after[:40].decode('latin-1')!r}")
    return values


def _skip_lines(file: BinaryIO, count: int, name: str) -> None:
    while block := file.read(BLOCK):
        line_ends = block.count(b"\n")
        if line_ends < count:
            count -= line_ends
            continue
        ends = np.flatnonzero(np.frombuffer(block, np.uint8) == ord("\n"))
        file.seek(int(ends[count - 1]) + 1 - len(block), os.SEEK_CUR)
        return
    raise ValueError(f"it ends within {name!r}, of which {count} lines are missing: is it being written?")


def _line(file: BinaryIO, *, at_end: bool = False) -> str:
    """The next line without its end; `at_end` the file may end, which is ""."""
    line = file.readline(LINE)
    if not line and at_end:
        return ""
    if not line.endswith(b"\n"):
        raise ValueError("it ends too early, or a line is longer than any of CloverLeaf's")
    return line.decode("latin-1").rstrip("\r\n")


def _numbers(line: str, word: str, count: int) -> list[int]:
    words = line.removeprefix(word).split()
    if len(words) != count or not all(number.isdigit() and len(number) < 16 for number in words):
        raise ValueError(f"{word} must be followed by {count} whole numbers, got {line[:60]!r}")
    return [int(number) for number in words]


READER = Reader("cloverleaf", "CloverLeaf, clover.<chunk>.<step>.vtk", recognizes, records, read, files=files)
