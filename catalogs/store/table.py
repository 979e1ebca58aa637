"""The table of a growing catalog: complete at every moment, with commits at constant cost.

    x.cdb/data.csv        the table
          .spare.csv      the table before the last commit
          .journal        state after the last commit, see `catalogs.store.journal`
          .unfinished/    members that are being written

A commit takes the spare table, which lacks only the last member, appends the missing rows, syncs it, and renames it to `data.csv`.
The file that had this name becomes the spare.  A spare that a reader still has open is replaced by a copy of the table.  The same
holds on file systems without leases, which can't tell (`durable.opened_elsewhere`).  Everything hidden is derived; where it
does not match the disk, the table is rebuilt from the members.

Appending to `data.csv` itself would be simpler.  But a writer killed within the append, or a power cut, would leave half a row to
every reader until the next writer comes.  Copying the table for each commit would take time in proportion to the members.

Guarantee: every reader of `data.csv`, also after a kill or a power cut, gets a complete table of complete members, which does not
change while it is open.  It may lack a member whose writer died between the member's rename and the table's, until the next writer
comes.  Without leases (network file systems, mostly) each commit copies the table; with writers on several machines, a stale cache
may cost a rebuild.  Both are slower, neither is wrong.

Rows are in the order of commits; `rebuild` sorts them by the members' names.
"""

from __future__ import annotations

import contextlib
import os
import shutil
from collections.abc import Collection, Iterator, Mapping, Sequence
from pathlib import Path

from catalogs.files import cinema, durable
from catalogs.store.journal import Journal, Stamps, key_of
from catalogs.store.members import RECORD, ROWS, Member, read_record, rows_of
from catalogs.store.missing import MISSING, report_missing
from catalogs.store.plan import CatalogError, CatalogPlan, read_json

TABLE = "data.csv"
MEMBERS = "members"
UNFINISHED = ".unfinished"
SPARE = ".spare.csv"
JOURNAL = ".journal"
HIDDEN = {UNFINISHED, SPARE, JOURNAL, MISSING}
GONE = f"its folder is gone from {MEMBERS}/; if you took it out on purpose, delete {MISSING}/{{}}.json"
REPLACED = ".replaced"  # suffix of an old member's folder while a new one takes its place in two renames


class CatalogTable:
    """The table of the catalog at `path`.  Methods that change it need the catalog's lock."""

    def __init__(self, path: Path, plan: CatalogPlan) -> None:
        self._path, self._plan = path, plan
        self._table, self._members = path / TABLE, path / MEMBERS
        self._journal = Journal(path / JOURNAL)

    def is_current(self) -> bool:
        """True where the table has the rows of all present members, found in constant time.

        False while a table is being written, and where its writer died: the clock of the stamps is too coarse to tell.
        """
        last = self._journal.read()
        try:
            return last is not None and last == self._stamps() and not self._partials()
        except OSError:
            return False

    def find(self, parameters: Mapping[str, float]) -> str | None:
        """The member with these parameters, given in the space's order, as of the last `is_current`."""
        return self._journal.names.get(key_of(parameters))

    def pieces(self, *, also: Member | None = None, without: Collection[str] = ()) -> Iterator[bytes]:
        """The header and the rows of every committed member, sorted by name, and of one about to be committed."""
        names = {*member_names(self._path)}.difference(without)
        if also is not None:
            names.add(also.name)
        yield cinema.format_rows([self._plan.header]).encode()
        for name in sorted(names):
            folder = also.path if also is not None and name == also.name else self._members / name
            yield rows_in(folder, self._plan)

    def clean_up(self) -> None:
        """Remove the remains of dead writers, and put back the old member of an interrupted replacement."""
        durable.remove_abandoned(self._path / UNFINISHED)
        for aside in (self._path / UNFINISHED).glob(f"*{REPLACED}"):
            target = self._members / aside.name.removesuffix(REPLACED)
            if target.exists():
                shutil.rmtree(aside, ignore_errors=True)
            else:
                durable.rename(aside, target)
                durable.sync(self._members)

    def rebuild(self) -> None:
        """Write table and journal anew from the members, unless they are up to date."""
        self.clean_up()
        changed = durable.stamp(self._members).changed
        same = durable.holds(self._table, self.pieces())
        if same and self.is_current():
            return
        if not same:
            self._report_gone()
            durable.replace(self._table, self.pieces())
        self._write_journal(changed)
        durable.remove_abandoned(self._path)
        for partial in self._partials():  # last: they say that the table is out of date
            partial.unlink(missing_ok=True)

    def derive_rows(self, without: Collection[str] = ()) -> None:
        """Rewrite every member's file of rows that differs from its record."""
        for folder in (path for path in member_paths(self._path) if path.name not in without):
            durable.remove_abandoned(folder)  # of a repair that died
            path, rows = folder / ROWS, derived_rows(read_record(folder, self._plan), self._plan)
            if not path.is_file() or durable.read(path) != rows:
                durable.replace(path, rows)

    def set_aside(self, moves: Mapping[str, Path]) -> None:
        """Remove these members from the table, then move their folders elsewhere in the catalog."""
        self._report_gone()
        durable.replace(self._table, self.pieces(without=moves))
        for name, target in moves.items():
            durable.make_folder(target.parent)
            durable.rename(self._members / name, target)
            durable.sync(target.parent)
        durable.sync(self._members)
        self._write_journal(durable.stamp(self._members).changed)

    def add(self, members: Sequence[Member]) -> None:
        """Commit new members, whose folders are complete and synced, with their rows; the table must be current."""
        with self._grown(b"".join(durable.read(member.path / ROWS) for member in members)):
            for member in members:
                durable.rename(member.path, self._members / member.name)
            durable.sync(self._members)
        self._record(members)

    def replace(self, member: Member) -> None:
        """Replace the member of this name by one whose folder is complete and synced; `member.path` then holds the old one.

        Where the rows differ, the table is written twice and lacks the member in between, so that it never names a missing image.
        """
        rows = b""
        with contextlib.suppress(OSError, CatalogError):  # a damaged member may be replaced, too
            rows = rows_in(self._members / member.name, self._plan)
        if rows == durable.read(member.path / ROWS):
            self._exchange(member)
            self._record([member])
            return
        durable.replace(self._table, self.pieces(without=[member.name]))
        with durable.staged(self._table, self.pieces(also=member)):
            self._exchange(member)
        self._write_journal(durable.stamp(self._members).changed)

    def _report_gone(self) -> None:
        """Report members missing that only the table still knows, unless their parameters are those of another one."""
        present = {name for name, _ in _entries(self._path)}
        gone = {n: v for n, v in parameters_in(self._table, self._plan).items() if n not in present}
        keys = set[str]()
        for folder in member_paths(self._path) if gone else ():
            with contextlib.suppress(CatalogError, OSError):
                keys.add(_key_in(folder, self._plan))
        for name, parameters in gone.items():
            if key_of(parameters) not in keys:
                with contextlib.suppress(OSError):
                    report_missing(self._path, name, parameters, GONE.format(name))

    def _exchange(self, member: Member) -> None:
        """Swap the member's folder with the stored one.

        Where the file system can't swap at once, the member is missing between two renames; `clean_up` ends what a kill leaves.
        """
        target = self._members / member.name
        try:
            durable.exchange(member.path, target)
        except OSError:
            aside = self._path / UNFINISHED / f"{member.name}{REPLACED}"
            durable.rename(target, aside)
            durable.rename(member.path, target)
            durable.sync(self._members)
            durable.rename(aside, member.path)
        durable.sync(self._members)

    @contextlib.contextmanager
    def _grown(self, rows: bytes) -> Iterator[None]:
        """Write a table with further `rows` before the block, and rename it into place after; an exception leaves the old one."""
        partial, spare = durable.partial_name(self._table), self._path / SPARE
        try:
            self._take_spare(spare, partial)
            with durable.opened(self._table) as stream:
                stream.seek(partial.stat().st_size)
                durable.append(partial, stream.read() + rows)
            durable.sync(partial)
            yield
            with contextlib.suppress(OSError):  # without hard links the next commit copies
                spare.unlink(missing_ok=True)
                durable.link(self._table, spare)
            durable.rename(partial, self._table)
            durable.sync(self._path)
        except BaseException:
            partial.unlink(missing_ok=True)
            raise

    def _take_spare(self, spare: Path, partial: Path) -> None:
        """Move the spare table to `partial`, or copy the table there if the spare is out of date or being read."""
        if spare.is_file():
            durable.rename(spare, partial)
            if durable.stamp(partial) == self._journal.table_before and not durable.opened_elsewhere(partial):
                return
            partial.unlink()
        durable.copy(self._table, partial)

    def _record(self, members: Sequence[Member]) -> None:
        self._journal.append([(key_of(member.parameters), member.name) for member in members], self._stamps())

    def _write_journal(self, changed: int) -> None:
        (self._path / SPARE).unlink(missing_ok=True)
        names = {key: name for name, key in keys_of(self._path, self._plan)}
        self._journal.write(names.items(), Stamps(changed, durable.stamp(self._table)))

    def _partials(self) -> list[Path]:
        """Unfinished tables; for the holder of the lock, all of dead writers."""
        return [path for path in durable.partials(self._path) if path.name.startswith(f".{TABLE}~")]

    def _stamps(self) -> Stamps:
        return Stamps(durable.stamp(self._members).changed, durable.stamp(self._table))


def member_names(catalog: Path) -> list[str]:
    """Names of a catalog's committed members, sorted."""
    return [name for name, is_member in _entries(catalog) if is_member]


def stray_names(catalog: Path) -> list[str]:
    """Names of entries among the members that hold no record, sorted."""
    return [name for name, is_member in _entries(catalog) if not is_member]


def member_paths(catalog: Path) -> list[Path]:
    """Folders of a catalog's committed members, sorted by name."""
    return [catalog / MEMBERS / name for name in member_names(catalog)]


def _entries(catalog: Path) -> Iterator[tuple[str, bool]]:
    """Visible entries among the members, sorted by name, and for each True where it holds a record."""
    names: list[str] = []
    with contextlib.suppress(FileNotFoundError, NotADirectoryError):
        names = os.listdir(catalog / MEMBERS)
    for name in sorted(name for name in names if not name.startswith(".")):
        yield name, os.path.exists(os.path.join(catalog, MEMBERS, name, RECORD))


def keys_of(catalog: Path, plan: CatalogPlan) -> Iterator[tuple[str, str]]:
    """Name and parameters' key of every member from its record; raises CatalogError naming a damaged one."""
    for path in member_paths(catalog):
        yield path.name, _key_in(path, plan)


def _key_in(folder: Path, plan: CatalogPlan) -> str:
    parameters = read_json(folder / RECORD).get("parameters")
    try:
        return key_of({name: parameters[name] for name in plan.space.names})
    except (KeyError, TypeError, ValueError) as error:
        raise CatalogError(f"{folder / RECORD} is damaged: its parameters are {parameters!r}") from error


def parameters_in(path: Path, plan: CatalogPlan) -> dict[str, dict[str, float]]:
    """Parameters of the members, by name, in a table or a member's file of rows, as far as it can be read."""
    by_member: dict[str, dict[str, float]] = {}
    member, names = plan.header.index("member"), plan.space.names
    with contextlib.suppress(OSError, UnicodeDecodeError, cinema.TableError):
        for row in cinema.rows_of(path):
            if len(row) != len(plan.header):
                continue
            try:
                by_member.setdefault(row[member], {n: float(v) for n, v in zip(names, row, strict=False)})
            except ValueError:
                if row != plan.header and not by_member:  # other columns
                    break
    return by_member


def rows_in(folder: Path, plan: CatalogPlan) -> bytes:
    """The rows of the member in `folder`, from their file or, where that is lost, from its record."""
    try:
        return durable.read(folder / ROWS)
    except FileNotFoundError:
        return derived_rows(read_record(folder, plan), plan)


def derived_rows(member: Member, plan: CatalogPlan) -> bytes:
    """Contents of a member's file of rows."""
    return cinema.format_rows(rows_of(member, plan)).encode()
