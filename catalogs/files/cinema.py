"""The table of a Cinema database, specification D: `data.csv` in a `*.cdb` folder.

The rules (https://cinemasciencewebsite.readthedocs.io/en/latest/specD.html; "Dietrich" specification, version 1.0):

- RFC 4180: commas, cells quoted where needed, no stray quotes; rows may end with LF, as most such tables do;
- one header row of unique, non-empty labels, none of which reads as a number; at least one row below it;
- columns of file names start with FILE and come last; a cell is a POSIX path (here: inside the database) or a URL;
- every column has one type, integers, floats or words, set by its first cell that is not empty; empty cells and, except for
  integers, NaN mean an unknown value.

Stricter than the specification, because viewers fail otherwise: a FILE cell is never empty, no other label contains "file",
and nothing is padded with blanks.  A float is written with the fewest digits that read back as the same double.  It always has a
point, so that a column of floats is never read as integers.
"""

from __future__ import annotations

import csv
import io
import itertools
import math
import re
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path, PurePosixPath

import numpy as np

from catalogs.files import durable

Cell = str | int | float

NEWLINE = "\r\n"  # RFC 4180, section 2.1
CELL = re.compile(r'(?:"([^"]*+(?:""[^"]*+)*+)"|([^",\r\n]*+))(,|\r\n|\n|\Z)')  # RFC 4180, section 2
PIECE = 1 << 16  # characters of a table's file per read
LONGEST_CELL = 1 << 20  # characters, in a table that is read in pieces
TYPE_NAMES = {int: "integers", float: "floats", str: "words"}
NO_ROW = "the table has no row: specification D wants at least one"
FILE = re.compile(r"(fi)(le)", re.IGNORECASE)
URL = re.compile(r"[a-zA-Z][a-zA-Z0-9+.-]*://")


class TableError(ValueError):
    """A table breaks a rule of the specification; the message names the rule and the place."""


def format_cell(value: Cell) -> str:
    """The text of a cell before quoting; raises TableError for truth values, NaN and infinities."""
    if isinstance(value, bool | np.bool_):
        raise TableError(f"truth value ({value}) in a table: write it as a word")
    if isinstance(value, float | np.floating):
        if not math.isfinite(value):
            raise TableError(f"{value} in a table: every value must be finite")
        mantissa, exponent, power = repr(float(value)).partition("e")
        return f"{mantissa}{'' if '.' in mantissa else '.0'}{exponent}{power}"
    return str(value)


def format_rows(rows: Iterable[Sequence[Cell]]) -> str:
    """Rows as RFC 4180 text, each ended by CR LF."""
    stream = io.StringIO()
    writer = csv.writer(stream, lineterminator=NEWLINE)
    for row in rows:
        writer.writerow([format_cell(value) for value in row])
    return stream.getvalue()


def rows_of(path: Path) -> Iterator[list[str]]:
    """Header and rows of a table's file, read in pieces; raises OSError, UnicodeDecodeError, and TableError as `read_rows` does."""
    with durable.opened(path) as stream:
        text = io.TextIOWrapper(stream, encoding="utf-8", newline="")
        yield from read_rows(iter(lambda: text.read(PIECE), ""))


def parse(text: str) -> tuple[list[str], list[list[str]]]:
    """Header and rows of a table; raises TableError where it breaks RFC 4180 or rows differ in length."""
    rows = read_rows([text])
    return next(rows), list(rows)


def read_rows(chunks: Iterable[str]) -> Iterator[list[str]]:
    """The header and then each row of a table given in pieces, in the memory of a piece and a row.

    Raises TableError where it breaks RFC 4180, and for a row of another length than the header.  In a table of several pieces a
    cell may have a million characters at most.
    """
    header: list[str] = []
    for number, row in enumerate(_records(chunks), start=1):
        if number == 1:
            header = row
            if header == [""]:
                break
        elif len(row) != len(header):
            raise TableError(f"row {number} has {len(row)} cells, the header {len(header)}")
        yield row
    if header in ([], [""]):
        raise TableError("the table is empty: a header row must name its columns")


def _records(chunks: Iterable[str]) -> Iterator[list[str]]:
    row: list[str] = []
    number, line, text, place = 1, 1, "", 0
    pieces = iter(chunks)
    following: str | None = next(pieces, "")
    if following and following.startswith("\ufeff"):
        raise TableError("it begins with a byte order mark, which viewers read as part of the first label")
    while following is not None:
        line += text.count("\n", 0, place)
        text, place = text[place:] + following, 0
        following = next(pieces, None)
        while place < len(text):
            cell = CELL.match(text, place)
            if following is not None and (cell is None or not cell[3]) and len(text) - place <= LONGEST_CELL:
                break  # the cell may go on in the next piece
            if cell is None or (following is not None and not cell[3]):
                around = text[place : place + 30]
                where = f"row {number}, line {line + text.count(chr(10), 0, place)}"
                raise TableError(f"{where}: not valid CSV (RFC 4180): unexpected quote or newline near {around!r}")
            quoted, plain, end = cell.groups()
            row.append(plain if quoted is None else quoted.replace('""', '"'))
            place = cell.end()
            if end != ",":
                yield row
                row, number = [], number + 1
    if row:  # the last cell was empty and no line end followed
        yield [*row, ""]


def is_file_column(label: str) -> bool:
    """True for labels of file names, which start with FILE."""
    return label.startswith("FILE")


def header_problems(header: Sequence[str]) -> list[str]:
    """A sentence for every rule that the labels break."""
    problems = []
    for number, label in enumerate(header, start=1):
        if not label.strip():
            problems.append(f"column {number} has no label")
        elif label != label.strip():
            problems.append(f"label {label!r} is padded with blanks, which viewers read as part of it")
        elif reads_as_number(label):
            problems.append(f"label {label!r} would be read as a number: a label must be a word")
    repeated = sorted({label for label in header if header.count(label) > 1})
    problems += [f"label {label!r} occurs more than once" for label in repeated]
    files = [is_file_column(label) for label in header]
    if files != sorted(files):
        problems.append("FILE columns must be the last ones")
    problems += [
        f"label {label!r} contains 'file': viewers ignore case and would read its cells as paths"
        for label, file in zip(header, files, strict=True)
        if not file and "file" in label.lower()
    ]
    return problems


def parameter_labels(names: Sequence[str], others: Sequence[str]) -> list[str]:
    """Labels of parameters' columns beside `others`: the names, but "parameter_theta" for one that a rule or a column forbids."""
    labels: list[str] = []
    for name in names:
        used, label, stem = {*others, *labels, *names}, name, "parameter_" + FILE.sub(r"\1_\2", name.strip())
        for number in itertools.count(2):
            if label not in {*others, *labels} and not is_file_column(label) and not header_problems([label]):
                break
            label = stem if stem not in used else f"{stem}_{number}"
        labels.append(label)
    return labels


def cell_type(text: str) -> type[int] | type[float] | type[str]:
    """Type of a cell as viewers read it: int, float or str."""
    for kind in (int, float):
        try:
            kind(text)
        except ValueError:
            continue
        return kind
    return str


def reads_as_number(text: str) -> bool:
    """True for words that viewers would read as numbers ("007", "1e5", "nan")."""
    return cell_type(text) is not str


def column_problems(header: Sequence[str], rows: Iterable[Sequence[str]]) -> list[str]:
    """A sentence with row number for every rule that the cells break (the header is row 1)."""
    columns, problems, number = Columns(header), [], 1
    for number, row in enumerate(rows, start=2):
        problems += columns.problems(number, row)
    return problems if number > 1 else [NO_ROW]


class Columns:
    """Rules for the cells of a table's columns, applied row by row."""

    def __init__(self, header: Sequence[str]) -> None:
        self._labels = list(header)
        self._types: list[type | None] = [None] * len(self._labels)  # of the first cell that is not empty

    def problems(self, number: int, row: Sequence[str]) -> list[str]:
        """A sentence for every rule that the next row, with this number, breaks."""
        sentences = []
        for index, (label, cell) in enumerate(zip(self._labels, row, strict=True)):
            problem = path_problem(cell) if is_file_column(label) else self._type_problem(index, cell)
            if problem:
                sentences.append(f"row {number}, column {label}: {problem}")
        return sentences

    def _type_problem(self, index: int, cell: str) -> str | None:
        if not cell:
            return None
        kind = cell_type(cell)
        first = self._types[index] = self._types[index] or kind
        if cell != cell.strip():
            return f"{cell!r} is padded with blanks"
        if kind is float and first is not int and math.isnan(float(cell)):
            return None
        if kind is not first:
            return f"{cell!r} is among {TYPE_NAMES[first]}: a column has one type"
        if kind is float and math.isinf(float(cell)):
            return "infinite value: Cinema viewers cannot show it"
        return None


def path_problem(cell: str) -> str | None:
    """The problem of a FILE cell that is neither a URL nor a path inside the database, or None."""
    if not cell:
        return "a FILE cell must not be empty"
    if is_url(cell):
        return None
    path = PurePosixPath(cell)
    if path.is_absolute() or "\\" in cell or ".." in path.parts or not cell.isprintable() or cell != cell.strip():
        return f"{cell!r} leaves the database: paths are relative, with '/', without '..'"
    return None


def is_url(cell: str) -> bool:
    """True for a FILE cell that is a URL: allowed by the specification, never fetched here."""
    return URL.match(cell) is not None
