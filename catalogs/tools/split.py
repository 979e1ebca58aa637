"""Splitting of a catalog into shards under an index, for viewers that can't open a table of that size.

    x.cdb/data.csv                  the index: a row per shard with the ranges of its parameters, and its table as FILE
          shards/<shard>.cdb/       a complete catalog of some of the members

Viewers (pycinema, cinemasci, Cinema:Explorer) read one `data.csv` and don't follow the index, which says which shard to open.
Training and browsing read the catalog that was split.  `catalogs merge` joins shards again.
"""

from __future__ import annotations

import math
import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from catalogs.files import cinema, durable
from catalogs.store.catalog import Catalog, CatalogError
from catalogs.store.description import DESCRIPTION
from catalogs.store.members import read_record
from catalogs.store.table import MEMBERS, TABLE, member_names
from catalogs.tools.transfer import Progress, add_members, link_images

SHARDS = "shards"
ROWS = 100_000
COUNTED = ("shard", "members", "rows")


@dataclass(frozen=True)
class Shard:
    """Some members of a catalog: the shard's name, their names, number of rows, and (lowest, highest) of each parameter."""

    name: str
    members: tuple[str, ...]
    rows: int
    ranges: tuple[tuple[float, float], ...]

    def __repr__(self) -> str:
        return f"<Shard {self.name}: {len(self.members)} members, {self.rows} rows>"


def split(
    source: str | os.PathLike[str],
    destination: str | os.PathLike[str],
    *,
    rows: int = ROWS,
    progress: Progress = lambda done, total: None,
) -> list[Shard]:
    """Write the catalog `source` into the new Cinema database `destination` as shards of at most `rows` rows.

    Members are sorted by their parameters, so that shards cover ranges of the first; a member with more rows has its own shard.
    Images are hard links where possible, else copies.  The index is written when all shards are complete; after an interruption
    the same command resumes.

    Raises CatalogError for a catalog without members, where the destination holds anything else or shards of other members, and
    for parameters named like a column of the index.
    """
    catalog, target = Catalog.open(source), Path(destination)
    if target.suffix != ".cdb":
        raise CatalogError(f"a Cinema database is a folder whose name ends with .cdb, got {target}")
    if (target / DESCRIPTION).exists():
        raise CatalogError(f"{target} is a catalog already: choose another folder for the shards of {catalog.path}")
    shards = _shards(catalog, rows)
    header = [*COUNTED, *(f"{name} {end}" for name in catalog.plan.parameter_labels for end in ("from", "to")), "FILE"]
    if problems := cinema.header_problems(header):
        raise CatalogError(f"the index of {catalog.path} would break Cinema specification D: {'; '.join(problems)}")
    _refuse_others(target, shards)
    durable.make_folder(target / SHARDS)
    durable.remove_abandoned(target)
    total = sum(len(shard.members) for shard in shards)
    done = 0
    for shard in shards:
        part = Catalog.create(_path(target, shard), catalog.plan)
        present = set(member_names(part.path))
        new = [(catalog, name) for name in shard.members if name not in present]
        done += len(shard.members)
        add_members(part, new, link_images, lambda count, of, done=done: progress(done - of + count, total))  # type: ignore[misc]
    durable.replace(target / TABLE, cinema.format_rows([header, *map(_row, shards)]).encode())
    return shards


def _shards(catalog: Catalog, most: int) -> list[Shard]:
    """The members, sorted by their parameters, in shards of at most `most` rows."""
    if most < 1:
        raise CatalogError(f"a shard needs at least one row, got {most}")
    entries = []
    for name in member_names(catalog.path):
        member = read_record(catalog.path / MEMBERS / name, catalog.plan)
        entries.append((tuple(member.parameters.values()), name, len(member.cameras) * len(member.appearances)))
    if not entries:
        raise CatalogError(f"{catalog.path} has no members to split")
    lots: list[list[tuple[tuple[float, ...], str, int]]] = []
    rows = math.inf
    for entry in sorted(entries):
        if rows + entry[2] > most:
            lots.append([])
            rows = 0
        lots[-1].append(entry)
        rows += entry[2]
    digits = len(str(len(lots) - 1))
    return [_shard(f"shard-{number:0{digits}d}", lot) for number, lot in enumerate(lots)]


def _shard(name: str, lot: Sequence[tuple[tuple[float, ...], str, int]]) -> Shard:
    ranges = tuple((min(values), max(values)) for values in zip(*(values for values, _, _ in lot), strict=True))
    return Shard(name, tuple(member for _, member, _ in lot), sum(rows for _, _, rows in lot), ranges)


def _row(shard: Shard) -> list[cinema.Cell]:
    ends = [end for pair in shard.ranges for end in pair]
    return [shard.name, len(shard.members), shard.rows, *ends, f"{SHARDS}/{shard.name}.cdb/{TABLE}"]


def _path(target: Path, shard: Shard) -> Path:
    return target / SHARDS / f"{shard.name}.cdb"


def _refuse_others(target: Path, shards: Sequence[Shard]) -> None:
    """Raise CatalogError where the destination holds anything but parts of these shards."""
    planned = {_path(target, shard): set(shard.members) for shard in shards}
    present = [*(target / SHARDS).glob("[!.]*"), *(p for p in target.glob("[!.]*") if p.name not in (SHARDS, TABLE))]
    for path in present:
        if path not in planned or not planned[path].issuperset(member_names(path)):
            raise CatalogError(f"{path} is not a shard of this catalog as it is split now: choose a new folder")
