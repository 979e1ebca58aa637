"""What is in a Cinema database, as a table for people."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from catalogs import cinema, durable
from catalogs.catalog import Catalog, CatalogError
from catalogs.members import Member
from catalogs.notebook.facts import facts, megabytes
from catalogs.summary import FieldSummary
from catalogs.table import TABLE

UNKNOWN = "-"


def describe(path: Path) -> str:
    """What is in the Cinema database at `path`: a catalog by its members, any other by the columns of its table.

    Raises CatalogError where `path` is neither, or is damaged.
    """
    if (path / "catalog.json").exists() or not (path / TABLE).is_file():
        return _describe_catalog(Catalog.open(path))
    return _describe_table(path)


def _describe_catalog(catalog: Catalog) -> str:
    members = catalog.members
    stored = [*facts(catalog.plan, members), ("on disk", f"{megabytes(catalog.path):,.1f} MB")]
    unfinished = catalog.unfinished()
    if unfinished:
        names = ", ".join(path.name[1:].split("~")[0] for path in unfinished)
        stored.append(
            ("unfinished", f"{names}: being written now, or left by a run that died (the next one cleans up)")
        )
    stored += [("missing", str(member)) for member in catalog.missing]
    lines = [f"Catalog {catalog.path}", *(f"  {name:<11} {fact}" for name, fact in stored)]
    return "\n".join([*lines, "", *_member_table(catalog, members)] if members else lines)


def _member_table(catalog: Catalog, members: Sequence[Member]) -> list[str]:
    names, shown = catalog.plan.space.names, catalog.plan.fields or ("",)
    several = len(shown) > 1
    columns = [f"{field} {what}" if several else what for field in shown for what in ("minimum", "maximum", "clipped")]
    rows = [["member", "split", *names, "views", *columns]]
    for member in members:
        kept = member.summaries()
        only = next(iter(kept.values()), None)
        ranges = [cell for field in shown for cell in _range_cells(kept.get(field) if several else only)]
        values = [f"{member.parameters[name]:g}" for name in names]
        rows.append([member.name, member.split, *values, str(len(member.cameras)), *ranges])
    return _aligned(rows)


def _range_cells(summary: FieldSummary | None) -> list[str]:
    if summary is None:
        return [UNKNOWN] * 3
    return [f"{summary.minimum:.5g}", f"{summary.maximum:.5g}", f"{100 * summary.clipped_fraction:.2f} %"]


def _describe_table(path: Path) -> str:
    try:
        header, cells = cinema.parse(durable.read(path / TABLE).decode("utf-8"))
    except (UnicodeDecodeError, cinema.TableError) as error:
        raise CatalogError(f"{path / TABLE}: {error}") from error
    rows = [["column", "type", "values", "from", "to"]]
    for index, label in enumerate(header):
        column = [row[index] for row in cells if row[index]]
        kind = cinema.cell_type(column[0]) if column else str
        rows.append([label, _type_name(label, kind), str(len(set(column))), *_range(column, kind)])
    title = (
        f"Cinema database {path}\n  {len(cells):,} rows, {megabytes(path):,.1f} MB on disk, not made by gs-surrogate\n"
    )
    return "\n".join([title, *_aligned(rows)])


def _type_name(label: str, kind: type) -> str:
    return "files" if cinema.is_file_column(label) else {int: "integers", float: "floats", str: "words"}[kind]


def _range(column: Sequence[str], kind: type) -> list[str]:
    if not column:
        return [UNKNOWN] * 2
    try:
        numbers = [float(cell) for cell in column] if kind is not str else []
    except ValueError:
        numbers = []  # a mixed column, of which `catalogs check` tells
    ends = (f"{min(numbers):g}", f"{max(numbers):g}") if numbers else (min(column), max(column))
    return [end if len(end) <= 40 else f"{end[:37]}..." for end in ends]


def _aligned(rows: Sequence[Sequence[str]]) -> list[str]:
    widths = [max(len(row[i]) for row in rows) for i in range(len(rows[0]))]
    return ["  " + "  ".join(cell.ljust(w) for cell, w in zip(row, widths, strict=True)).rstrip() for row in rows]
