"""The table of a Cinema database, specification D: `data.csv` in a `*.cdb` folder.

The rules (https://cinemasciencewebsite.readthedocs.io/en/latest/specD.html; "Dietrich" specification, version 1.0):

- RFC 4180: commas, cells quoted where needed, no stray quotes; rows may end with LF, as most such tables do;
- one header row of unique, non-empty labels, none of which reads as a number; at least one row below it;
- columns that name files start with FILE and come last; a cell names one by a POSIX path (here: inside the database) or a URL;
- every column has one type, integers, floats or words, set by its first cell that is not empty; empty cells and, but for integers,
  NaN mean that nothing is known.

Stricter than the specification, because clients trip over it: a FILE cell is never empty, no other label contains "file",
and nothing is padded with blanks.  A float is written with the fewest digits that read back as the same double, and always with a
point, so that a column of floats is never taken for integers.
"""

from __future__ import annotations

import csv
import io
import math
import re
from collections.abc import Iterable, Iterator, Sequence
from pathlib import PurePosixPath

import numpy as np

Cell = str | int | float

NEWLINE = "\r\n"  # RFC 4180, section 2.1
CELL = re.compile(r'(?:"([^"]*(?:""[^"]*)*)"|([^",\r\n]*))(,|\r\n|\n|\Z)')  # RFC 4180, section 2
URL = re.compile(r"[a-zA-Z][a-zA-Z0-9+.-]*://")


class TableError(ValueError):
    """A table breaks a rule of the specification; the message says which rule and where."""


def format_cell(value: Cell) -> str:
    """The text of a cell before quoting; raises TableError for truth values, NaN and infinities."""
    if isinstance(value, bool | np.bool_):
        raise TableError(f"a truth value ({value}) has no place in a table: write it as a word")
    if isinstance(value, float | np.floating):
        if not math.isfinite(value):
            raise TableError(f"{value} has no place in a table: every value is known")
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


def parse(text: str) -> tuple[list[str], list[list[str]]]:
    """Header and rows of a table; raises TableError where it is no RFC 4180 or rows differ in length."""
    if text.startswith("\ufeff"):
        raise TableError("it begins with a byte order mark, which clients take for a part of the first label")
    rows = list(_records(text))
    if not rows or rows[0] == [""]:
        raise TableError("the table is empty: a header row must name its columns")
    for number, row in enumerate(rows[1:], start=2):
        if len(row) != len(rows[0]):
            raise TableError(f"row {number} has {len(row)} cells, the header {len(rows[0])}")
    return rows[0], rows[1:]


def _records(text: str) -> Iterator[list[str]]:
    row: list[str] = []
    number, place = 1, 0
    while place < len(text):
        cell = CELL.match(text, place)
        if cell is None:
            line = text.count("\n", 0, place) + 1
            around = text[place : place + 30]
            raise TableError(f"row {number}, line {line}: no RFC 4180: a stray quote or line end near {around!r}")
        quoted, plain, end = cell.groups()
        row.append(plain if quoted is None else quoted.replace('""', '"'))
        place = cell.end()
        if end != ",":
            yield row
            row, number = [], number + 1
    if row:  # the last cell was empty and no line end followed
        yield [*row, ""]


def is_file_column(label: str) -> bool:
    """Whether a client takes the column for file names: labels that start with FILE."""
    return label.startswith("FILE")


def header_problems(header: Sequence[str]) -> list[str]:
    """Every rule that the labels break, as sentences."""
    problems = []
    for number, label in enumerate(header, start=1):
        if not label.strip():
            problems.append(f"column {number} has no label")
        elif label != label.strip():
            problems.append(f"label {label!r} is padded with blanks, which clients take for a part of it")
        elif reads_as_number(label):
            problems.append(f"label {label!r} reads as a number: a label must be a word")
    repeated = sorted({label for label in header if header.count(label) > 1})
    problems += [f"label {label!r} occurs more than once" for label in repeated]
    files = [is_file_column(label) for label in header]
    if files != sorted(files):
        problems.append("FILE columns must be the last ones")
    problems += [
        f"label {label!r} contains 'file': clients match it in any case and would take its cells for paths"
        for label, file in zip(header, files, strict=True)
        if not file and "file" in label.lower()
    ]
    return problems


def cell_type(text: str) -> type[int] | type[float] | type[str]:
    """int, float or str: what a client takes the cell for."""
    for kind in (int, float):
        try:
            kind(text)
        except ValueError:
            continue
        return kind
    return str


def reads_as_number(text: str) -> bool:
    """Whether a client could take a word for a number ("007", "1e5", "nan")."""
    return cell_type(text) is not str


def column_problems(header: Sequence[str], rows: Sequence[Sequence[str]]) -> list[str]:
    """Every rule that the cells break, as sentences with row numbers (the header is row 1)."""
    problems = [] if rows else ["the table has no row: specification D wants at least one"]
    for index, label in enumerate(header):
        cells = [row[index] for row in rows]
        found = map(path_problem, cells) if is_file_column(label) else _type_problems(cells)
        problems += [f"row {row}, column {label}: {problem}" for row, problem in enumerate(found, start=2) if problem]
    return problems


def _type_problems(cells: Iterable[str]) -> Iterator[str | None]:
    """What is wrong with each cell of a column, or None."""
    names = {int: "integers", float: "floats", str: "words"}
    first: type | None = None
    for cell in cells:
        if not cell:
            yield None
            continue
        kind = cell_type(cell)
        first = first or kind
        if cell != cell.strip():
            yield f"{cell!r} is padded with blanks"
        elif kind is float and first is not int and math.isnan(float(cell)):
            yield None
        elif kind is not first:
            yield f"{cell!r} stands among {names[first]}: a column has one type"
        elif kind is float and math.isinf(float(cell)):
            yield f"{cell} is no number that a client can place"
        else:
            yield None


def path_problem(cell: str) -> str | None:
    """Why a FILE cell is neither a URL nor a path inside the database, or None."""
    if not cell:
        return "a FILE cell must not be empty"
    if is_url(cell):
        return None
    path = PurePosixPath(cell)
    if path.is_absolute() or "\\" in cell or ".." in path.parts or not cell.isprintable() or cell != cell.strip():
        return f"{cell!r} leaves the database: paths are relative, with '/', without '..'"
    return None


def is_url(cell: str) -> bool:
    """Whether a FILE cell names something on a network: allowed by the specification, never fetched here."""
    return URL.match(cell) is not None
