"""Whether a Cinema database is what it says: every rule of specification D, and every image, one by one.

Table and members are gone through side by side, a row and a member at a time: of a catalog nothing stays in memory but the members'
names.
"""

from __future__ import annotations

import io
from bisect import bisect_left
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from itertools import groupby, islice, zip_longest
from pathlib import Path

import numpy as np

from catalogs.files import cinema, durable
from catalogs.store.catalog import Catalog, CatalogError, Member
from catalogs.store.description import DESCRIPTION
from catalogs.store.journal import key_of
from catalogs.store.members import read_record
from catalogs.store.table import MEMBERS, TABLE, derived_rows, member_names, stray_names
from catalogs.tools.damage import Wanted, file_problem, images_of, rows_problem, summary_problem

Progress = Callable[[int, int], None]
READERS, AT_ONCE, AHEAD = 2, 16, 4  # threads, files that one takes, and how often so many wait
PIECE = 1 << 16  # bytes of a table that are read at once
REPAIR = "`catalogs check --repair` rebuilds the table"
ROWS_REPAIR = "`catalogs check --repair` writes it anew"
TAKE_OUT = "take the folder of one of them out of members/, then `catalogs check --repair` rebuilds the table"


@dataclass(frozen=True)
class Finding:
    """One thing that is wrong: where (file, row, column) and what; and the member that only rendering it again can mend."""

    place: str
    problem: str
    member: str = ""

    def __str__(self) -> str:
        return f"{self.place}: {self.problem}"


@dataclass(frozen=True)
class _File:
    """A file that must be there: what says so; of a member's image also the member and what it must hold."""

    name: str
    place: str
    member: str = ""
    wanted: Wanted | None = None


def check(path: Path, *, decode: bool = True, progress: Progress = lambda done, total: None) -> list[Finding]:
    """Everything that is wrong with the Cinema database at `path`, whoever made it; empty where nothing is.

    The table is held to specification D (see `catalogs.files.cinema`); every image is decoded whole, once, or only
    looked for without
    `decode`; where a `catalog.json` stands beside the table, members, rows, image sizes and summaries must agree with it
    too.  URLs are not fetched, and nothing is written.
    """
    if not path.is_dir():
        return [Finding(str(path), "is no folder")]
    findings = [] if path.suffix == ".cdb" else [Finding(str(path), "a Cinema database's folder ends with .cdb")]
    total = _count(path)
    with ThreadPoolExecutor(READERS) as pool:
        examined = _examined(pool, path, decode, _Check(path, findings).files())
        for done, (file, problem) in enumerate(examined, start=1):
            progress(done, max(done, total))
            if problem:
                findings.append(Finding(file.place, f"{file.name} {problem}", file.member))
    return findings


def _count(path: Path) -> int:
    """How many files the table names, as far as lines tell."""
    try:
        with durable.opened(path / TABLE) as stream:
            columns = stream.readline(PIECE).count(b"FILE")
            return columns * sum(piece.count(b"\n") for piece in iter(lambda: stream.read(PIECE), b""))
    except OSError:
        return 0


def _examined(
    pool: ThreadPoolExecutor, root: Path, decode: bool, files: Iterable[_File]
) -> Iterator[tuple[_File, str | None]]:
    """The files and what is wrong with each, in their order; few wait at a time, however many there are."""

    def examine(some: Sequence[_File]) -> list[tuple[_File, str | None]]:
        return [(file, file_problem(root, file.name, file.wanted, decode=decode)) for file in some]

    waiting: deque[Future[list[tuple[_File, str | None]]]] = deque()
    given = iter(files)
    while some := list(islice(given, AT_ONCE)):
        waiting.append(pool.submit(examine, some))
        if len(waiting) > AHEAD:
            yield from waiting.popleft().result()
    for examined in waiting:
        yield from examined.result()


class _Check:
    """Goes once through a database's table and members; what is wrong with them goes to `findings`."""

    def __init__(self, path: Path, findings: list[Finding]) -> None:
        self._path, self._findings = path, findings
        self._catalog: Catalog | None = None
        if (path / DESCRIPTION).exists():
            try:
                self._catalog = Catalog.open(path)
            except CatalogError as error:
                self._find(DESCRIPTION, str(error))
        self._names = member_names(path) if self._catalog else []  # sorted
        self._seen = bytearray(len(self._names))  # 1 for those that were looked at
        self._keys = np.zeros(len(self._names), np.uint64)  # a part of each one's parameters' key
        self._table_is_whole = True
        self._strangers: set[str] = set()  # files that are no member's

    def files(self) -> Iterator[_File]:
        """Every file that table or members name, once."""
        if self._catalog is None:
            yield from self._strange_files(*self._table())
            return
        for name in stray_names(self._path):
            self._find(f"{MEMBERS}/{name}", "is no member: it holds no member.json", name)
        header, rows = self._table()
        listed = header == self._catalog.plan.header
        if listed:
            yield from self._listed(self._catalog, header, rows)
        else:
            if header:
                labels = self._catalog.plan.header
                self._find(TABLE, f"has the columns {header}, the catalog makes {labels}: {REPAIR}")
            yield from self._strange_files(header, rows)
        for number, name in enumerate(self._names):
            if not self._seen[number]:
                if listed and self._table_is_whole:
                    self._find(f"member {name}", f"is stored but not in the table: {REPAIR}")
                member = self._member(self._catalog, number)
                if member is not None:
                    for file, wanted in images_of(self._catalog, member):
                        yield _File(file, "a member's image", name, wanted)
        self._find_duplicates(self._catalog)

    def _find(self, place: str, problem: str, member: str = "") -> None:
        self._findings.append(Finding(place, problem, member))

    def _table(self) -> tuple[list[str], Iterator[tuple[int, list[str]]]]:
        """Header and numbered rows of the table, empty where there is none; what is wrong with each is found as it comes."""
        rows = self._readable_rows()
        header = next(rows, [])
        for problem in cinema.header_problems(header):
            self._find(TABLE, problem)
        return header, self._checked(header, rows)

    def _readable_rows(self) -> Iterator[list[str]]:
        """Header and rows up to where the table can't be read."""
        try:
            with durable.opened(self._path / TABLE) as stream:
                text = io.TextIOWrapper(stream, encoding="utf-8", newline="")
                yield from cinema.read_rows(iter(lambda: text.read(PIECE), ""))
                return
        except FileNotFoundError:
            self._find(TABLE, "is missing: it is the one file that every Cinema database has")
        except (durable.SpecialFileError, UnicodeDecodeError, cinema.TableError) as error:
            self._find(TABLE, str(error))
        self._table_is_whole = False

    def _checked(self, header: list[str], rows: Iterator[list[str]]) -> Iterator[tuple[int, list[str]]]:
        columns, number = cinema.Columns(header), 1
        for number, row in enumerate(rows, start=2):
            for problem in columns.problems(number, row):
                self._find(TABLE, problem)
            yield number, row
        if number == 1 and self._table_is_whole:
            self._find(TABLE, cinema.NO_ROW)

    def _strange_files(self, header: list[str], rows: Iterable[tuple[int, list[str]]]) -> Iterator[_File]:
        """The files that rows name, each once, but for what lies in members' folders, which is looked at with them."""
        for number, row in rows:
            for label, cell in zip(header, row, strict=True):
                known = not cinema.is_file_column(label) or cinema.path_problem(cell) or cinema.is_url(cell)
                if known or cell in self._strangers or self._is_of_a_member(cell):
                    continue
                self._strangers.add(cell)
                yield _File(cell, f"{TABLE} row {number}, column {label}")

    def _is_of_a_member(self, name: str) -> bool:
        parts = name.split("/")
        return len(parts) > 2 and parts[0] == MEMBERS and self._number(parts[1]) is not None

    def _number(self, name: str) -> int | None:
        """Which of the stored members this is."""
        place = bisect_left(self._names, name)
        return place if place < len(self._names) and self._names[place] == name else None

    def _listed(self, catalog: Catalog, header: list[str], rows: Iterator[tuple[int, list[str]]]) -> Iterator[_File]:
        """The files of the members that the table lists, in its order.

        Tells which members it invents, and else where it first differs from what the members make.
        """
        column = header.index("member")
        unknown: dict[str, None] = {}
        differences: list[str] = []
        for name, lines in groupby(rows, key=lambda line: line[1][column]):
            number = self._number(name)
            if number is None:
                unknown[name] = None
                yield from self._strange_files(header, lines)
            elif self._seen[number]:
                differences += [f"member {name} has rows in several places"] * (not differences)
                yield from self._strange_files(header, lines)
            else:
                member = self._member(catalog, number)
                if member is None:
                    yield from self._strange_files(header, lines)
                else:
                    yield from self._member_files(catalog, member, header, lines, differences)
        for name in unknown:
            self._find(f"member {name}", f"is in the table but not stored: {REPAIR}")
        if differences and not unknown and all(self._seen):
            self._find(TABLE, f"differs from what the members make ({differences[0]}): {REPAIR}")

    def _member_files(
        self,
        catalog: Catalog,
        member: Member,
        header: list[str],
        lines: Iterable[tuple[int, list[str]]],
        differences: list[str],
    ) -> Iterator[_File]:
        """A listed member's images, and what else its rows name; the first row that is not the member's to `differences`."""
        images = dict(images_of(catalog, member))
        expected_rows = cinema.read_rows([derived_rows(member, catalog.plan).decode()])
        for line, expected in zip_longest(lines, expected_rows):
            if line is None or expected is None:
                differences += [f"it has {'fewer' if line is None else 'more'} rows of member {member.name}"]
            elif line[1] != expected:
                differences += [f"row {line[0]} and maybe others"]
            if line is not None:
                file = line[1][-1]
                if file in images:
                    yield _File(file, f"{TABLE} row {line[0]}, column {header[-1]}", member.name, images.pop(file))
                else:
                    yield from self._strange_files(header, [line])
            del differences[1:]
        for file, wanted in images.items():
            yield _File(file, "a member's image", member.name, wanted)

    def _member(self, catalog: Catalog, number: int) -> Member | None:
        """A stored member, after all that is wrong with its record, rows and summary; None where it can't be read."""
        self._seen[number] = 1
        place = f"member {self._names[number]}"
        try:
            member = read_record(catalog.path / MEMBERS / self._names[number], catalog.plan)
        except (CatalogError, OSError) as error:
            self._find(place, str(error), self._names[number])
            return None
        self._keys[number] = int(key_of(member.parameters)[:16], 16)
        if problem := summary_problem(member, catalog.plan):
            self._find(place, problem, member.name)
        if problem := rows_problem(member, catalog.plan):
            self._find(place, f"{problem}: {ROWS_REPAIR}")
        return member

    def _find_duplicates(self, catalog: Catalog) -> None:
        _, places, counts = np.unique(self._keys, return_inverse=True, return_counts=True)
        first: dict[str, str] = {}
        for number in np.flatnonzero((counts[places] > 1) & (self._keys > 0)):
            member = read_record(catalog.path / MEMBERS / self._names[number], catalog.plan)
            other = first.setdefault(key_of(member.parameters), member.name)
            if other != member.name:
                self._find(f"member {member.name}", f"has the parameters of member {other}: {TAKE_OUT}")
