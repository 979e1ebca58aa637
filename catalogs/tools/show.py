"""What is in a Cinema database, as a table for people, a line at a time: of a member only its line is kept, and that on disk."""

from __future__ import annotations

import io
import json
import tempfile
from array import array
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path

import numpy as np

from catalogs.files import cinema, durable
from catalogs.store.catalog import Catalog, CatalogError
from catalogs.store.members import Member, read_record
from catalogs.store.notebook.facts import Tally, megabytes
from catalogs.store.summary import FieldSummary
from catalogs.store.table import MEMBERS, TABLE, member_names

UNKNOWN = "-"
IN_MEMORY = 1 << 20  # bytes of lines, of which more go to a temporary file
PIECE = 1 << 16  # characters of a table read at once
LONGEST = 40  # characters of a range's end


def describe(path: Path) -> str:
    """The lines of `described`."""
    return "\n".join(described(path))


def described(path: Path) -> Iterator[str]:
    """What is in the Cinema database at `path`, line by line: a catalog by its members, any other by the columns of its table.

    Raises CatalogError where `path` is neither, or is damaged.
    """
    if (path / "catalog.json").exists() or not (path / TABLE).is_file():
        yield from _catalog_lines(Catalog.open(path))
    else:
        yield from _table_lines(path)


def _catalog_lines(catalog: Catalog) -> Iterator[str]:
    tally, names = Tally(catalog.plan), member_names(catalog.path)

    def rows() -> Iterator[list[str]]:
        yield _heading(catalog)
        for name in names:
            member = read_record(catalog.path / MEMBERS / name, catalog.plan)
            tally.add(member)
            yield _row(catalog, member)

    with _Aligned(rows()) as table:
        stored = [*tally.facts(), ("on disk", f"{megabytes(catalog.path):,.1f} MB")]
        unfinished = catalog.unfinished()
        if unfinished:
            being = ", ".join(path.name[1:].split("~")[0] for path in unfinished)
            stored.append(
                ("unfinished", f"{being}: being written now, or left by a run that died (the next one cleans up)")
            )
        stored += [("missing", str(member)) for member in catalog.missing]
        yield f"Catalog {catalog.path}"
        yield from (f"  {name:<11} {fact}" for name, fact in stored)
        if names:
            yield ""
            yield from table.lines()


def _heading(catalog: Catalog) -> list[str]:
    fields = catalog.plan.fields or ("",)
    several = len(fields) > 1
    columns = [f"{field} {what}" if several else what for field in fields for what in ("minimum", "maximum", "clipped")]
    return ["member", "split", *catalog.plan.space.names, "views", *columns]


def _row(catalog: Catalog, member: Member) -> list[str]:
    fields, kept = catalog.plan.fields or ("",), member.summaries()
    only = next(iter(kept.values()), None)
    ranges = [cell for field in fields for cell in _range_cells(kept.get(field) if len(fields) > 1 else only)]
    values = [f"{member.parameters[name]:g}" for name in catalog.plan.space.names]
    return [member.name, member.split, *values, str(len(member.cameras)), *ranges]


def _range_cells(summary: FieldSummary | None) -> list[str]:
    if summary is None:
        return [UNKNOWN] * 3
    return [f"{summary.minimum:.5g}", f"{summary.maximum:.5g}", f"{100 * summary.clipped_fraction:.2f} %"]


class _Aligned:
    """Rows of equal length, kept until the widths of all are known."""

    def __init__(self, rows: Iterable[Sequence[str]]) -> None:
        self._kept = tempfile.SpooledTemporaryFile(IN_MEMORY, mode="w+", encoding="utf-8", newline="\n")  # noqa: SIM115
        self._widths: list[int] = []
        for row in rows:
            self._widths = [
                max(len(cell), width) for cell, width in zip(row, self._widths or [0] * len(row), strict=True)
            ]
            self._kept.write(json.dumps(row) + "\n")

    def __enter__(self) -> _Aligned:
        return self

    def __exit__(self, *_: object) -> None:
        self._kept.close()

    def lines(self) -> Iterator[str]:
        """The rows in columns."""
        self._kept.seek(0)
        for line in self._kept:
            cells = zip(json.loads(line), self._widths, strict=True)
            yield "  " + "  ".join(cell.ljust(width) for cell, width in cells).rstrip()


class _Column:
    """Type, range and number of values of a table's column, whose cells are seen one after the other."""

    def __init__(self, label: str) -> None:
        self._label = label
        self._kind: type | None = None
        self._hashes = array("q")
        self._words: tuple[str, str] | None = None
        self._numbers: tuple[float, float] | None = None
        self._mixed = False  # of which `catalogs check` tells

    def add(self, cell: str) -> None:
        """Take in a cell."""
        if not cell:
            return
        self._kind = self._kind or cinema.cell_type(cell)
        self._hashes.append(hash(cell))
        low, high = self._words or (cell, cell)
        self._words = min(low, cell), max(high, cell)
        if self._kind is str or self._mixed:
            return
        try:
            number = float(cell)
        except ValueError:
            self._mixed = True
            return
        least, most = self._numbers or (number, number)
        self._numbers = min(least, number), max(most, number)

    def row(self) -> list[str]:
        """The column as a row: label, type, how many values, from, to."""
        name = {int: "integers", float: "floats", str: "words"}[self._kind or str]
        kind = "files" if cinema.is_file_column(self._label) else name
        ends: Sequence[str] = self._words or [UNKNOWN] * 2
        if self._numbers is not None and not self._mixed:
            ends = [f"{number:g}" for number in self._numbers]
        shown = [end if len(end) <= LONGEST else f"{end[: LONGEST - 3]}..." for end in ends]
        return [self._label, kind, str(len(np.unique(self._hashes))), *shown]


def _table_lines(path: Path) -> Iterator[str]:
    count = -1
    columns: list[_Column] = []
    try:
        with durable.opened(path / TABLE) as stream:
            text = io.TextIOWrapper(stream, encoding="utf-8", newline="")
            for count, row in enumerate(cinema.read_rows(iter(lambda: text.read(PIECE), ""))):
                if count == 0:
                    columns = [_Column(label) for label in row]
                    continue
                for column, cell in zip(columns, row, strict=True):
                    column.add(cell)
    except (UnicodeDecodeError, cinema.TableError) as error:
        raise CatalogError(f"{path / TABLE}: {error}") from error
    yield f"Cinema database {path}"
    yield f"  {count:,} rows, {megabytes(path):,.1f} MB on disk, not made by gs-surrogate"
    yield ""
    with _Aligned([["column", "type", "values", "from", "to"], *(column.row() for column in columns)]) as table:
        yield from table.lines()
