"""Contents of a Cinema database as lines of text."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

from catalogs.files import cinema
from catalogs.store.catalog import Catalog, CatalogError
from catalogs.store.members import Member, read_record
from catalogs.store.notebook.facts import Tally
from catalogs.store.sizes import Sizes, bytes_of, sizes_of
from catalogs.store.summary import FieldSummary
from catalogs.store.table import MEMBERS, TABLE, member_names
from catalogs.vocabulary.numbers import texts
from catalogs.vocabulary.words import named_values

UNKNOWN = "-"
LONGEST = 40  # characters of a range's end


def describe(path: Path) -> str:
    """The lines of `described`."""
    return "\n".join(described(path))


def described(path: Path) -> Iterator[str]:
    """Contents of the Cinema database at `path`, line by line: of a catalog its members, of any other its table's columns.

    Raises CatalogError where `path` is neither, or is damaged.
    """
    if (path / "catalog.json").exists() or not (path / TABLE).is_file():
        yield from _catalog_lines(Catalog.open(path))
    else:
        yield from _table_lines(path)


def _catalog_lines(catalog: Catalog) -> Iterator[str]:
    tally, table = Tally(catalog.plan), list[list[Any]]([_heading(catalog)])
    sizes, measured = Sizes(whole=True), set[str]()
    for name in member_names(catalog.path):
        member = read_record(catalog.path / MEMBERS / name, catalog.plan)
        tally.add(member)
        sizes += sizes_of(member)
        measured.add(str(member.path))
        table.append(_row(catalog, member))
    _fill_in(table, catalog.plan.space.names)
    count = bytes_of(catalog.path, measured) + sizes.images + sizes.fields + sizes.others
    facts = [*tally.facts(), ("on disk", f"{count / 1e6:,.1f} MB")]
    if measured:
        facts.append(("of these", str(sizes)))
        facts += [("advice", sizes.advice)] if sizes.advice else []
    if unfinished := ", ".join(path.name[1:].split("~")[0] for path in catalog.unfinished()):
        facts.append(
            ("unfinished", f"{unfinished}: being written now, or left by a killed run (the next one cleans up)")
        )
    for missing in catalog.missing:
        place = f" (at {named_values(missing.parameters)})" if missing.parameters else ""
        facts.append(("missing", f"{missing}{place}"))
    yield f"Catalog {catalog.path}"
    yield from (f"  {name:<11} {fact}" for name, fact in facts)
    if len(table) > 1:
        yield ""
        yield from _aligned(table)


def _heading(catalog: Catalog) -> list[str]:
    fields = catalog.plan.fields or ("",)
    several = len(fields) > 1
    columns = [f"{field} {what}" if several else what for field in fields for what in ("minimum", "maximum", "clipped")]
    return ["member", "split", *catalog.plan.space.names, "views", *columns]


def _row(catalog: Catalog, member: Member) -> list[Any]:
    fields, summaries = catalog.plan.fields or ("",), member.summaries()
    single = next(iter(summaries.values()), None)
    ranges = [cell for field in fields for cell in _range_cells(summaries.get(field) if len(fields) > 1 else single)]
    values = [member.parameters[name] for name in catalog.plan.space.names]
    return [member.name, member.split, *values, str(len(member.cameras)), *ranges]


def _fill_in(table: Sequence[list[Any]], parameters: Sequence[str]) -> None:
    """Write the parameters' columns, behind name and split, in as many digits as tell their values apart."""
    for column in range(2, 2 + len(parameters)):
        for row, cell in zip(table[1:], texts(row[column] for row in table[1:]), strict=True):
            row[column] = cell


def _range_cells(summary: FieldSummary | None) -> list[str]:
    if summary is None:
        return [UNKNOWN] * 3
    return [f"{summary.minimum:.5g}", f"{summary.maximum:.5g}", f"{100 * summary.clipped_fraction:.2f} %"]


def _aligned(table: Sequence[Sequence[str]]) -> Iterator[str]:
    """The rows as lines, in columns."""
    widths = [max(map(len, column)) for column in zip(*table, strict=True)]
    for row in table:
        yield "  " + "  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip()


class _Column:
    """Type, range and number of different values of a table's column."""

    def __init__(self, label: str) -> None:
        self._label, self._first = label, ""
        self._cells: set[str] = set()

    def add(self, cell: str) -> None:
        """Count the column's next cell."""
        if cell:
            self._first = self._first or cell
            self._cells.add(cell)

    def row(self) -> list[str]:
        """The column as a row: label, type, number of values, from, to."""
        kind = cinema.cell_type(self._first)
        name = "files" if cinema.is_file_column(self._label) else cinema.TYPE_NAMES[kind]
        ends = [min(self._cells), max(self._cells)] if self._cells else [UNKNOWN] * 2
        with suppress(ValueError):  # of mixed columns, which `catalogs check` reports
            numbers = [] if kind is str else [float(cell) for cell in self._cells]
            ends = texts([min(numbers), max(numbers)]) if numbers else ends
        ends_text = [end if len(end) <= LONGEST else f"{end[: LONGEST - 3]}..." for end in ends]
        return [self._label, name, str(len(self._cells)), *ends_text]


def _table_lines(path: Path) -> Iterator[str]:
    count = -1
    columns: list[_Column] = []
    try:
        for count, row in enumerate(cinema.rows_of(path / TABLE)):
            if count == 0:
                columns = [_Column(label) for label in row]
                continue
            for column, cell in zip(columns, row, strict=True):
                column.add(cell)
    except (UnicodeDecodeError, cinema.TableError) as error:
        raise CatalogError(f"{path / TABLE}: {error}") from error
    yield f"Cinema database {path}"
    yield f"  {count:,} rows, {bytes_of(path) / 1e6:,.1f} MB on disk, not made by gs-surrogate"
    yield ""
    yield from _aligned([["column", "type", "values", "from", "to"], *(column.row() for column in columns)])
