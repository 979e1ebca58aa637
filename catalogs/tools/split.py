"""A catalog split into several, for clients that can't take its table: shards under an index.

    x.cdb/data.csv                  the index: a row for each shard, with the ranges of its parameters, and its table as FILE
          shards/<shard>.cdb/       a whole catalog of some of the members, which clients and every command open by itself

No client follows the index from table to table: pycinema, cinemasci and Cinema:Explorer read one `data.csv`.  It says which shard
to open.  This program's own reader needs neither, since it never reads the table of a catalog: the catalog that was split stays
what training and browsing open.  `catalogs merge` makes one catalog of shards again.
"""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from catalogs.files import cinema, durable
from catalogs.store.catalog import Catalog, CatalogError
from catalogs.store.description import DESCRIPTION
from catalogs.store.members import read_record
from catalogs.store.table import MEMBERS, TABLE, member_names
from catalogs.tools.transfer import add_members, place_pictures

Progress = Callable[[int, int], None]
SHARDS = "shards"
ROWS = 100_000
COUNTED = ("shard", "members", "rows")


@dataclass(frozen=True)
class Shard:
    """Some members of a catalog: how their catalog is called, how many rows they have, and from where to where parameters reach."""

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
    """Write the catalog `source` into the new Cinema database `destination` as shards of at most so many rows.

    Members go by their parameters, the first one first, so that shards cover ranges of it; a member with more rows has a shard of
    its own.  Pictures are hard links where the file system has those, else copies.  The index is written when all shards are
    whole; the same command goes on after an interruption.

    Raises CatalogError where there is no member, where the destination holds other things or was split from other members, and for
    parameters that are called like a column of the index.
    """
    given, target = Catalog.open(source), Path(destination)
    if target.suffix != ".cdb":
        raise CatalogError(f"a Cinema database is a folder whose name ends with .cdb, got {target}")
    if (target / DESCRIPTION).exists():
        raise CatalogError(f"{target} is a catalog already: choose another folder for the shards of {given.path}")
    shards = _shards(given, rows)
    header = [*COUNTED, *(f"{name} {end}" for name in given.plan.space.names for end in ("from", "to")), "FILE"]
    if problems := cinema.header_problems(header):
        raise CatalogError(f"the index of {given.path} would break Cinema specification D: {'; '.join(problems)}")
    _refuse_others(target, shards)
    durable.make_folder(target / SHARDS)
    durable.remove_abandoned(target)
    total = sum(len(shard.members) for shard in shards)
    done = 0
    for shard in shards:
        made = Catalog.create(_path(target, shard), given.plan)
        there = set(member_names(made.path))
        wanted = [(given, name) for name in shard.members if name not in there]
        before = done + len(shard.members) - len(wanted)
        add_members(made, wanted, place_pictures, lambda count, _, before=before: progress(before + count, total))  # type: ignore[misc]
        done += len(shard.members)
    durable.replace(target / TABLE, cinema.format_rows([header, *map(_row, shards)]).encode())
    return shards


def _shards(catalog: Catalog, most: int) -> list[Shard]:
    """The members in shards of at most so many rows, by their parameters."""
    if most < 1:
        raise CatalogError(f"a shard needs a row at least, got {most}")
    known = []
    for name in member_names(catalog.path):
        member = read_record(catalog.path / MEMBERS / name, catalog.plan)
        known.append((tuple(member.parameters.values()), name, len(member.cameras) * len(member.appearances)))
    if not known:
        raise CatalogError(f"{catalog.path} has no members to split")
    lots: list[list[tuple[tuple[float, ...], str, int]]] = []
    held = math.inf
    for entry in sorted(known):
        if held + entry[2] > most:
            lots.append([])
            held = 0
        lots[-1].append(entry)
        held += entry[2]
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
    """Raise CatalogError where the destination holds anything that these shards would not."""
    planned = {_path(target, shard): set(shard.members) for shard in shards}
    found = [*(target / SHARDS).glob("[!.]*"), *(p for p in target.glob("[!.]*") if p.name not in (SHARDS, TABLE))]
    for path in found:
        if path not in planned or not planned[path].issuperset(member_names(path)):
            raise CatalogError(f"{path} is no shard of this catalog as it is split now: choose a new folder")
