"""Validation of a Cinema database: every rule of specification D, and every image.

Table and members are read side by side, a row and a member at a time, so that large catalogs need little memory.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from itertools import groupby, islice, zip_longest
from pathlib import Path

from catalogs.files import cinema, durable
from catalogs.files.packed import PACK
from catalogs.store.catalog import Catalog, CatalogError, Member
from catalogs.store.description import DESCRIPTION, RESTORE
from catalogs.store.digests import Digests
from catalogs.store.journal import key_of
from catalogs.store.members import RECORD, ROWS, own_name, read_member
from catalogs.store.missing import MISSING, reports
from catalogs.store.plan import ACCEPT
from catalogs.store.table import MEMBERS, TABLE, derived_rows, member_names, parameters_in, stray_names
from catalogs.tools.damage import (
    FOREIGN,
    ExpectedImage,
    fields_problem,
    file_problem,
    images_of,
    is_foreign,
    rows_problem,
)
from catalogs.vocabulary.words import named_values

Progress = Callable[[int, int], None]
NumberedRow = tuple[int, list[str]]
READERS, AT_ONCE, AHEAD = 2, 16, 4  # threads, files per task, and waiting tasks
MEMBER_IMAGE = "a member's image"
REPAIR = "`catalogs check --repair` rebuilds the table"
FORGOTTEN = "`catalogs check --repair` lists it as missing"
RENAMED = "`catalogs check --repair` renames the folder"
DAMAGED_REPORT = "is damaged: delete it, or render the member again"
ROWS_REPAIR = "`catalogs check --repair` rewrites it"
TAKE_OUT = "take the folder of one of them out of members/, then `catalogs check --repair` rebuilds the table"


@dataclass(frozen=True)
class Finding:
    """One problem: its place (file, row, column), and the member that must be rendered again to solve it, or ""."""

    place: str
    problem: str
    member: str = ""

    def __str__(self) -> str:
        return f"{self.place}: {self.problem}"


@dataclass(frozen=True)
class _File:
    """A file that must exist: the place that names it and, for a member's image, the member and the expected image."""

    name: str
    place: str
    member: str = ""
    image: ExpectedImage | None = None


def check(
    path: Path,
    *,
    decode: bool = True,
    progress: Progress = lambda done, total: None,
    note: Callable[[str], None] = lambda text: None,
) -> list[Finding]:
    """All problems of the Cinema database at `path`, whichever program made it.

    The table is validated against specification D (see `catalogs.files.cinema`).  Every image is compared with the digest in its
    member's record, or decoded once where there is none; without `decode` it only has to exist.  Where a `catalog.json` is beside
    the table, members, rows, image sizes and summaries must agree with it.  URLs are not fetched, and nothing is written.  `note`
    is called with what is not a problem.
    """
    if not path.is_dir():
        return [Finding(str(path), "is not a folder")]
    findings = [] if path.suffix == ".cdb" else [Finding(str(path), "a Cinema database's folder ends with .cdb")]
    total = _count(path)
    running = _Check(path, findings)
    with ThreadPoolExecutor(READERS) as pool:
        examined = _examined(pool, path, decode, running.files())
        for done, (file, problem) in enumerate(examined, start=1):
            progress(done, max(done, total))
            if problem:
                findings.append(Finding(file.place, f"{file.name} {problem}", file.member))
    if running.without_digests:
        note(
            f"{running.without_digests} members are from an earlier version and have no digests: an image in another's place "
            "would not show; `catalogs check --accept` adds digests"
        )
    return findings


def _count(path: Path) -> int:
    """Number of files in the table, estimated from its lines."""
    try:
        with durable.opened(path / TABLE) as stream:
            columns = stream.readline(cinema.PIECE).count(b"FILE")
            return columns * sum(piece.count(b"\n") for piece in iter(lambda: stream.read(cinema.PIECE), b""))
    except OSError:
        return 0


def _examined(
    pool: ThreadPoolExecutor, root: Path, decode: bool, files: Iterable[_File]
) -> Iterator[tuple[_File, str | None]]:
    """The files and the problem of each, in order; at most `AHEAD` tasks wait."""

    def examine(some: Sequence[_File]) -> list[tuple[_File, str | None]]:
        return [(file, file_problem(root, file.name, file.image, decode=decode)) for file in some]

    waiting: deque[Future[list[tuple[_File, str | None]]]] = deque()
    remaining = iter(files)
    while some := list(islice(remaining, AT_ONCE)):
        waiting.append(pool.submit(examine, some))
        if len(waiting) > AHEAD:
            yield from waiting.popleft().result()
    for examined in waiting:
        yield from examined.result()


class _Check:
    """One pass over a database's table and members; problems other than those of files are appended to `findings`."""

    def __init__(self, path: Path, findings: list[Finding]) -> None:
        self._path, self._findings = path, findings
        self._catalog: Catalog | None = None
        if (path / DESCRIPTION).exists():
            try:
                self._catalog = Catalog.open(path)
            except CatalogError as error:
                self._add(DESCRIPTION, str(error))
        elif count := len(member_names(path)):
            self._add(DESCRIPTION, f"is missing, but there are {count} members: {RESTORE}")
        self.without_digests = 0  # members
        self._native, self._foreign = 0, list[str]()  # members of this plan, and of another
        self._examined = dict.fromkeys(member_names(path) if self._catalog else (), False)  # by name, sorted
        self._names: dict[str, str] = {}  # members by the keys of their parameters
        self._table_is_readable = True
        self._difference = ""  # the first one between the table and the members' rows
        self._other_cells: set[str] = set()  # files outside the members' folders

    def files(self) -> Iterator[_File]:
        """Every file that table or members name, once."""
        header, rows = self._table()
        if self._catalog is None:
            yield from self._other_files(header, rows)
            return
        for name in stray_names(self._path):
            self._add(f"{MEMBERS}/{name}", "is not a member: it lacks member.json", name)
        for name, report in reports(self._path):
            if report is None:
                self._add(f"{MISSING}/{name}.json", DAMAGED_REPORT)
        labels = self._catalog.plan.header
        listed = header == labels
        if listed:
            yield from self._listed(self._catalog, header, rows)
        else:
            if header:
                self._add(TABLE, f"has the columns {header}, the catalog makes {labels}: {REPAIR}")
            yield from self._other_files(header, rows)
        for name in [name for name, examined in self._examined.items() if not examined]:
            if listed and self._table_is_readable:
                self._add(f"member {name}", f"is stored but not in the table: {REPAIR}")
            member = self._member(self._catalog, name)
            if member is not None:
                yield from (_File(file, MEMBER_IMAGE, name, image) for file, image in images_of(self._catalog, *member))
        self._judge_foreign()

    def _add(self, place: str, problem: str, member: str = "") -> None:
        self._findings.append(Finding(place, problem, member))

    def _table(self) -> tuple[list[str], Iterator[NumberedRow]]:
        """Header and numbered rows of the table, empty where it is missing; rows are checked as they are read."""
        rows = self._readable_rows()
        header = next(rows, [])
        for problem in cinema.header_problems(header):
            self._add(TABLE, problem)
        return header, self._checked(header, rows)

    def _readable_rows(self) -> Iterator[list[str]]:
        """Header and rows up to the first place that can't be read."""
        try:
            yield from cinema.rows_of(self._path / TABLE)
            return
        except FileNotFoundError:
            self._add(TABLE, "is missing: it is the one file that every Cinema database has")
        except (durable.SpecialFileError, UnicodeDecodeError, cinema.TableError) as error:
            self._add(TABLE, str(error))
        self._table_is_readable = False

    def _checked(self, header: list[str], rows: Iterator[list[str]]) -> Iterator[NumberedRow]:
        columns, number = cinema.Columns(header), 1
        for number, row in enumerate(rows, start=2):
            for problem in columns.problems(number, row):
                self._add(TABLE, problem)
            yield number, row
        if number == 1 and self._table_is_readable:
            self._add(TABLE, cinema.NO_ROW)

    def _other_files(self, header: list[str], rows: Iterable[NumberedRow]) -> Iterator[_File]:
        """Files that rows name outside the members' folders, each once."""
        for number, row in rows:
            for label, cell in zip(header, row, strict=True):
                if not cinema.is_file_column(label) or cinema.path_problem(cell) or cinema.is_url(cell):
                    continue
                root, *below = cell.split("/")
                of_member = root == MEMBERS and len(below) > 1 and below[0] in self._examined
                if not of_member and cell not in self._other_cells:
                    self._other_cells.add(cell)
                    yield _File(cell, f"{TABLE} row {number}, column {label}")

    def _listed(self, catalog: Catalog, header: list[str], rows: Iterator[NumberedRow]) -> Iterator[_File]:
        """The files of the members in the table, in its order; finds unknown members and the first differing row."""
        column = header.index("member")
        unknown: dict[str, None] = {}
        for name, lines in groupby(rows, key=lambda line: line[1][column]):
            member = None
            if name not in self._examined:
                unknown[name] = None
            elif self._examined[name]:
                self._differs(f"member {name} has rows in several places")
            else:
                member = self._member(catalog, name)
            if member is None:
                yield from self._other_files(header, lines)
            else:
                yield from self._member_files(catalog, *member, header, lines)
        for name in unknown:
            self._add(f"member {name}", f"is in the table but not stored: {FORGOTTEN}")
        if self._difference and not unknown and all(self._examined.values()):
            self._add(TABLE, f"differs from what the members make ({self._difference}): {REPAIR}")

    def _member_files(
        self, catalog: Catalog, member: Member, digests: Digests, header: list[str], lines: Iterable[NumberedRow]
    ) -> Iterator[_File]:
        """A listed member's images, and other files that its rows name."""
        images = dict(images_of(catalog, member, digests))
        expected_rows = cinema.read_rows([derived_rows(member, catalog.plan).decode()])
        for line, expected in zip_longest(lines, expected_rows):
            if line is None:
                self._differs(f"it has fewer rows of member {member.name}")
                continue
            number, row = line
            if expected is None:
                self._differs(f"it has more rows of member {member.name}")
            elif row != expected and not is_foreign(digests, catalog.plan):
                self._differs(f"row {number} and maybe others")
            if row[-1] in images:
                place = f"{TABLE} row {number}, column {header[-1]}"
                yield _File(row[-1], place, member.name, images.pop(row[-1]))
            else:
                yield from self._other_files(header, [line])
        yield from (_File(file, MEMBER_IMAGE, member.name, image) for file, image in images.items())

    def _differs(self, difference: str) -> None:
        self._difference = self._difference or difference

    def _judge_foreign(self) -> None:
        """Findings on members that were written for another plan: they are wrong, or, unless most agree with it, the plan is."""
        if len(self._foreign) >= max(1, self._native):
            members = f"{len(self._foreign)} of {len(self._foreign) + self._native} members"
            self._add(DESCRIPTION, f"is another than {members} were written for: {RESTORE}; {ACCEPT}")
        else:
            for name in self._foreign:
                self._add(f"member {name}", f"{RECORD} {FOREIGN}", name)

    def _member(self, catalog: Catalog, name: str) -> tuple[Member, Digests] | None:
        """A stored member, after its record, rows and summary were checked; None where it can't be read."""
        self._examined[name] = True
        place, folder = f"member {name}", catalog.path / MEMBERS / name
        try:
            member, digests = read_member(folder, catalog.plan)
        except (CatalogError, OSError) as error:
            home = own_name(folder)
            if home not in ("", name):
                self._add(place, f"its record describes {home}: {RENAMED}", name)
            else:
                values = parameters_in(folder / ROWS, catalog.plan).get(name)
                self._add(place, f"{error}; {ROWS} has {named_values(values)}" if values else str(error), name)
            return None
        if problem := fields_problem(member, catalog.plan, digests):
            self._add(place, problem, name)
        self.without_digests += not (PACK in digests.files if catalog.plan.packed else digests.images)
        foreign = is_foreign(digests, catalog.plan)
        self._native += bool(digests.plan) and not foreign
        if foreign:
            self._foreign.append(name)
        elif problem := rows_problem(member, catalog.plan):
            self._add(place, f"{problem}: {ROWS_REPAIR}")
        other = self._names.setdefault(key_of(member.parameters), name)
        if other != name:
            self._add(place, f"has the parameters of member {other}: {TAKE_OUT}")
        return member, digests
