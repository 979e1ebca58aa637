"""Ensembles of many files: a table with a path and parameters a row, or a pattern of paths that name the parameters.

A table is CSV (commas, semicolons or tabs) with a header:

    path, Re, nu [m^2/s], split, name
    run1/dump_0010.vti, 100, 0.01, train, first

`path` (or `file`) is relative to the table's folder; every other column but `split` and `name` is a parameter, its unit in
brackets.  A pattern names parameters in braces, `run_{Re}/dump_{time}.vti`, where `*` stands for anything; or it is a regular
expression with named groups, `run_(?P<Re>\\d+)/.*`.
"""

from __future__ import annotations

import codecs
import csv
import io
import math
import os
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from catalogs.vocabulary.numbers import text
from catalogs.vocabulary.parameters import SPLITS, Parameter, ParameterSpace
from catalogs.vocabulary.words import joined_names, named_values, shortened
from insitu.readers.attributes import SPLIT_WORDS
from insitu.readers.folders import files_below
from insitu.readers.fortran_numbers import printed_number

PATH_COLUMNS = ("path", "file", "filename", "filepath")
HEADER = re.compile(r"\s*(?P<name>.*?)\s*(?:\[(?P<unit>[^\]]*)\])?\s*")
NUMBER = r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?"
DECIMAL_COMMA = re.compile(r"[-+]?\d*,\d+(?:[eE][-+]?\d+)?")
BRACES = re.compile(r"\{(\w*)\}|\*\*|\*")
MARKS = (
    (codecs.BOM_UTF8, "utf-8-sig"),
    (codecs.BOM_UTF32_LE, "utf-32"),  # which begins as UTF-16 does
    (codecs.BOM_UTF32_BE, "utf-32"),
    (codecs.BOM_UTF16_LE, "utf-16"),
    (codecs.BOM_UTF16_BE, "utf-16"),
)
NAMED_GROUP = "(?P<"
LARGEST_TABLE = 1 << 28  # bytes

Bounds = Mapping[str, tuple[float, float]]


@dataclass(frozen=True)
class TableRow:
    """A member: its file, its parameters by name, what the table says of it besides ("" where nothing), and the index of its state
    in a file that holds several.
    """

    path: Path
    parameters: Mapping[str, float]
    split: str = ""
    name: str = ""
    index: tuple[int, ...] = ()


@dataclass(frozen=True)
class MemberTable:
    """Members with files of their own; `units` by parameter, where they are known.

    `unread` are files of which not even the states could be read, each with the reason.
    """

    rows: tuple[TableRow, ...]
    units: Mapping[str, str]
    unread: tuple[tuple[TableRow, str], ...] = ()

    @property
    def names(self) -> tuple[str, ...]:
        """The parameters, in the table's order."""
        return tuple(self.rows[0].parameters)

    def only(self, names: Sequence[str]) -> MemberTable:
        """The same members with some of their parameters, all where none is named; raises ValueError for others."""
        unknown = [name for name in names if name not in self.names]
        if unknown:
            raise ValueError(f"--parameters {joined_names(unknown)} are none of {joined_names(self.names)}")
        rows = [replace(row, parameters={n: row.parameters[n] for n in names or self.names}) for row in self.rows]
        return MemberTable(distinct(rows), self.units)


def is_pattern(text: str) -> bool:
    """True if `text` is a pattern of paths, not one path."""
    return NAMED_GROUP in text or bool(re.search(r"\{\w*\}|\*", text))


def read_table(
    path: str | os.PathLike[str], parameters: Sequence[str] = (), *, more_in_files: bool = False
) -> MemberTable:
    """The members of a CSV table; `parameters` names the columns that are, by default all but path, split and name.

    `more_in_files`: the files state further parameters, so that rows may be alike, and parameters need not be columns.

    Raises FileNotFoundError naming all files that are absent at once, ValueError naming the table, its line and the column.
    """
    path = Path(path)
    if not path.is_file():
        raise FileNotFoundError(f"there is no table {path}")
    try:
        if path.stat().st_size > LARGEST_TABLE:
            raise ValueError(f"it has {path.stat().st_size} bytes, more than a table of members")
        table = _parsed(_text(path.read_bytes()), path.parent, parameters, more_in_files)
    except (ValueError, csv.Error) as error:
        raise ValueError(f"{path}: {error}") from None
    absent = [str(row.path) for row in table.rows if not (row.path.is_file() or row.path.is_dir())]
    if absent:
        raise FileNotFoundError(f"{path} names {len(absent)} files that are absent: {shortened(absent, 10)}")
    return table


def _text(data: bytes) -> str:
    """The text of a table in any encoding of Unicode, or else in Latin-1, as spreadsheets save them."""
    for mark, encoding in MARKS:
        if data.startswith(mark):
            return data.decode(encoding)
    if b"\0" in data:  # UTF-16 without a mark: the other half of its first letters is zero
        halves = [data[:64][half::2].count(0) for half in (0, 1)]
        return data.decode("utf-16-be" if halves[0] > halves[1] else "utf-16-le")
    try:
        return data.decode()
    except UnicodeDecodeError:
        return data.decode("latin-1")


def _parsed(text: str, folder: Path, wanted: Sequence[str], more_in_files: bool) -> MemberTable:
    first = text.partition("\n")[0]
    delimiter = max(",;\t", key=first.count)
    lines = list(csv.reader(io.StringIO(text, None), delimiter=delimiter, skipinitialspace=True))
    if not lines:
        raise ValueError("it is empty: a header is needed, such as path,Re,time")
    heads = [HEADER.fullmatch(cell) for cell in lines[0]]
    names = [head["name"] if head else "" for head in heads]
    units = {head["name"]: head["unit"].strip() for head in heads if head and head["unit"]}
    if len(set(names)) != len(names) or not all(names):
        raise ValueError(f"its columns must have names, each another, got {joined_names(names)}")
    column = next((i for i, name in enumerate(names) if name.lower() in PATH_COLUMNS), None)
    if column is None:
        raise ValueError(f"it needs a column 'path', got {joined_names(names)}")
    other = [n for i, n in enumerate(names) if i != column and (n in wanted or n.lower() not in ("split", "name"))]
    unknown = [name for name in wanted if name not in other]
    if more_in_files:
        wanted = [name for name in wanted if name in other]
    elif unknown or not other:
        raise ValueError(
            f"there are no columns {', '.join(unknown) or 'of parameters'}: beside the path it has {joined_names(other)}"
        )
    rows = []
    if not any(map(any, lines[1:])):
        raise ValueError("it names no file")
    for line, cells in enumerate(lines[1:], start=2):
        if not any(cell.strip() for cell in cells):
            continue
        if len(cells) != len(names):
            more = ": separate them by semicolons" if delimiter == "," and len(cells) > len(names) else ""
            raise ValueError(f"line {line} has {len(cells)} cells, the header {len(names)}{more}")
        row = {name: cell.strip() for name, cell in zip(names, cells, strict=True)}
        by_lower = {name.lower(): cell for name, cell in row.items() if name not in wanted}
        values = {name: _number(row[name], f"line {line}, column {name!r}") for name in wanted or other}
        rows.append(
            TableRow(
                folder / row[names[column]],
                values,
                _split(by_lower.get("split", ""), line),
                by_lower.get("name", ""),
            )
        )
    return MemberTable(
        distinct(rows) if not more_in_files else tuple(rows), {n: units[n] for n in wanted or other if n in units}
    )


def _number(text: str, what: str) -> float:
    try:
        value = printed_number(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        cure = "--parameters names the columns that are"
        if DECIMAL_COMMA.fullmatch(text.strip()):
            cure = f"write it with a point, {text.strip().replace(',', '.')}"
        raise ValueError(f"{what} must be a finite number, got {text!r}; {cure}")
    return value


def _split(text: str, line: int) -> str:
    split = SPLIT_WORDS.get(text.lower(), text.lower())
    if split and split not in SPLITS:
        raise ValueError(
            f"line {line}: split must be one of {joined_names(SPLITS)}, got {text!r}; where it is a parameter, "
            f"name all in --parameters"
        )
    return split


def match_files(pattern: str, folder: str | os.PathLike[str] = ".", *, more_in_files: bool = False) -> MemberTable:
    """The files below `folder` whose paths match a pattern, in the order of their paths.

    `more_in_files` as in `read_table`.  Raises ValueError where the pattern names no parameter or matches nothing.
    """
    rows = matching(pattern, folder, more_in_files=more_in_files)
    if not rows:
        raise ValueError(f"no file below {Path(folder).resolve()} matches the pattern {pattern!r}")
    return MemberTable(tuple(rows) if more_in_files else distinct(rows), {})


def pattern_names(pattern: str, *, more_in_files: bool = False) -> tuple[str, ...]:
    """The parameters that a pattern names, maybe none with `more_in_files`; ValueError for a wrong pattern."""
    _, expression = _split_pattern(pattern, Path())
    if not expression.groupindex and not more_in_files:
        raise ValueError(f"the pattern {pattern!r} names no parameter in braces, as run_{{Re}}/dump_{{time}}.vti does")
    return tuple(expression.groupindex)


def matching(pattern: str, folder: str | os.PathLike[str] = ".", *, more_in_files: bool = False) -> list[TableRow]:
    """The files of now that match, maybe none; raises ValueError for a wrong pattern."""
    pattern_names(pattern, more_in_files=more_in_files)
    base, expression = _split_pattern(pattern, Path(folder))
    rows = []
    for path in files_below(base):
        if match := expression.fullmatch(path.relative_to(base).as_posix()):
            values = {name: _number(text, f"{path}: {name}") for name, text in match.groupdict().items()}
            rows.append(TableRow(path, values))
    return rows


def _split_pattern(pattern: str, folder: Path) -> tuple[Path, re.Pattern[str]]:
    """The folder that all matches lie in, and the expression for what follows."""
    if NAMED_GROUP in pattern:
        try:
            return folder, re.compile(pattern)
        except re.error as error:
            raise ValueError(f"the pattern {pattern!r} is not a regular expression: {error}") from None
    parts = pattern.split("/")
    fixed = next((i for i, part in enumerate(parts[:-1]) if BRACES.search(part)), len(parts) - 1)
    base = folder / "/".join(parts[:fixed]) if parts[0] else Path("/".join(parts[:fixed]) or "/")
    names: set[str] = set()

    def group(match: re.Match[str]) -> str:
        name = match[1]
        if not name:
            return ".*" if match[0] == "**" else "[^/]*"
        if not name.isidentifier():
            raise ValueError(f"the pattern {pattern!r} names a parameter {name!r}: begin it with a letter")
        again = name in names
        names.add(name)
        return f"(?P={name})" if again else f"(?P<{name}>{NUMBER})"

    expression, end = "", 0
    rest = "/".join(parts[fixed:])
    for match in BRACES.finditer(rest):
        expression += re.escape(rest[end : match.start()]) + group(match)
        end = match.end()
    return base, re.compile(expression + re.escape(rest[end:]))


def distinct(rows: Sequence[TableRow]) -> tuple[TableRow, ...]:
    """The rows; raises ValueError where there are none, or two have the same parameters, file or name."""
    if not rows:
        raise ValueError("it names no file")
    for what, key in (
        ("parameters", lambda row: tuple(row.parameters.values())),
        ("file", lambda row: (os.path.normpath(row.path), row.index)),
        ("name", lambda row: row.name or (row.path, row.index)),
    ):
        by_key: dict[object, TableRow] = {}
        for row in rows:
            if (other := by_key.setdefault(key(row), row)) is not row:
                same = row.name if what == "name" else named_values(row.parameters)
                raise ValueError(f"{other.path} and {row.path} have the same {what}, {same}: members must differ")
    return tuple(rows)


def bounded_space(
    names: Sequence[str],
    values: NDArray[np.float64],
    units: Sequence[str],
    bounds: Bounds,
    stated: tuple[NDArray[np.float64], NDArray[np.float64]] | None = None,
) -> ParameterSpace:
    """The parameters of members with `values` [M, P].

    Bounds (low, high) are those of `bounds` by name, else `stated` (P,) by a file, else the smallest and largest value.

    Raises ValueError where others than the parameters are given, and for one that is the same in every member.
    """
    unknown = sorted(set(bounds) - set(names))
    if unknown:
        raise ValueError(f"--bounds of {joined_names(unknown)}, but the parameters are {joined_names(names)}")
    low, high = (values.min(axis=0), values.max(axis=0)) if stated is None else stated
    parameters = []
    for number, name in enumerate(names):
        least, most = bounds.get(name, (float(low[number]), float(high[number])))
        if least == most and stated is None:
            raise ValueError(
                f"parameter {name!r} is {text(least)} in every member: give --bounds {name} LOW HIGH, or name the "
                "others by --parameters"
            )
        parameters.append(Parameter(name, least, most, units[number] if units else ""))
    return ParameterSpace(tuple(parameters))
