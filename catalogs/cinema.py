"""The table of a Cinema database, specification D (Cinema Science, "Spec D", v1.0): `data.csv` in a `*.cdb` folder.

The rules kept here: RFC 4180; one header row; unique labels; columns that name files come last and start with
FILE; every column has one type; no empty FILE cell.  A float is written with the fewest digits that read back as the same
double, and always with a point or an exponent, so that a column of floats is never taken for integers.
"""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Iterable, Sequence
from pathlib import PurePosixPath

Cell = str | int | float

NEWLINE = "\r\n"  # RFC 4180, section 2.1


class TableError(ValueError):
    """A table breaks a rule of the specification; the message says which rule and where."""


def format_cell(value: Cell) -> str:
    """The text of a cell before quoting."""
    if isinstance(value, bool):
        raise TableError(f"a truth value ({value}) has no place in a table: write it as a word")
    if isinstance(value, float):
        return repr(float(value))
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
    try:
        rows = list(csv.reader(io.StringIO(text, newline=""), strict=True))
    except csv.Error as error:
        raise TableError(f"not RFC 4180: {error}") from error
    if not rows or not rows[0]:
        raise TableError("the table is empty: a header row must name its columns")
    for number, row in enumerate(rows[1:], start=2):
        if len(row) != len(rows[0]):
            raise TableError(f"row {number} has {len(row)} cells, the header {len(rows[0])}")
    return rows[0], rows[1:]


def is_file_column(label: str) -> bool:
    """Whether a client takes the column for file names: labels that start with FILE."""
    return label.upper().startswith("FILE")


def header_problems(header: Sequence[str]) -> list[str]:
    """Every rule that the labels break, as sentences."""
    problems = [f"column {i + 1} has no label" for i, label in enumerate(header) if not label.strip()]
    problems += [
        f"label {label!r} occurs more than once" for label in sorted({x for x in header if header.count(x) > 1})
    ]
    files = [is_file_column(label) for label in header]
    if not any(files):
        problems.append("no column starts with FILE, so the table names no data")
    elif files != sorted(files):
        problems.append("FILE columns must be the last ones")
    problems += [
        f"label {label!r} contains 'file': clients match it case-insensitively and would take its cells for paths"
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


def column_problems(header: Sequence[str], rows: Sequence[Sequence[str]]) -> list[str]:
    """Every rule that the cells break, as sentences with row numbers (the header is row 1)."""
    problems = []
    for index, label in enumerate(header):
        cells = [row[index] for row in rows]
        if is_file_column(label):
            problems += [
                f"row {number}, column {label}: {problem}"
                for number, cell in enumerate(cells, start=2)
                if (problem := path_problem(cell))
            ]
            continue
        kinds = {cell_type(cell) for cell in cells}
        if len(kinds) > 1:
            first = cell_type(cells[0])
            number = next(n for n, cell in enumerate(cells, start=2) if cell_type(cell) is not first)
            names = sorted(kind.__name__ for kind in kinds)
            problems.append(
                f"row {number}, column {label}: a column has one type, this one mixes {' and '.join(names)}"
            )
        elif kinds == {float}:
            problems += [
                f"row {number}, column {label}: {cell} is no number that a client can place"
                for number, cell in enumerate(cells, start=2)
                if not math.isfinite(float(cell))
            ]
    return problems


def path_problem(cell: str) -> str | None:
    """Why a FILE cell is not a path inside the database, or None."""
    if not cell:
        return "a FILE cell must not be empty"
    path = PurePosixPath(cell)
    if path.is_absolute() or "\\" in cell or ".." in path.parts or "\x00" in cell:
        return f"{cell!r} leaves the database: paths are relative, with '/', without '..'"
    return None
