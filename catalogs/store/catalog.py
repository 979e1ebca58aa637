"""The store of an ensemble's images: a Cinema database that grows by whole members and survives crashes.

    x.cdb/data.csv                       the table (specification D), derived from the members
          catalog.json                   parameter space, cameras, appearances, conventions
          members/<name>/member.json     parameters, split, provenance
                         rows.csv        its rows of the table
                         cameras.json    its own cameras, where cameras are not shared
                         field.npz       summaries of its fields
                         coarse.npz      its fields with at most 64³ samples
                         <appearance>/<view>.png

A member is written in a hidden folder and renamed into place when all of it is on disk, so it is never incomplete.
See `catalogs.store.table` for how `data.csv` is updated in constant time.
"""

from __future__ import annotations

import contextlib
import dataclasses
import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from catalogs.files import durable
from catalogs.files.digests import digest_of, sealed
from catalogs.store.coarse import CoarseField, coarse_bytes
from catalogs.store.description import DESCRIPTION, LOCK, check_place, read_description, write_empty
from catalogs.store.journal import key_of
from catalogs.store.member_writer import MemberWriter
from catalogs.store.members import (
    COARSE,
    RECORD,
    Member,
    known_appearances,
    read_member,
    read_record,
    stored_names,
    write_record,
)
from catalogs.store.missing import MissingMember, missing_members
from catalogs.store.notebook.html import catalog_html
from catalogs.store.pictures import read_picture
from catalogs.store.plan import CatalogError, CatalogPlan, name_problem, read_json
from catalogs.store.splits import Splits
from catalogs.store.table import MEMBERS, UNFINISHED, CatalogTable, keys_of, member_paths
from catalogs.vocabulary.cameras import Camera
from catalogs.vocabulary.parameters import Outside
from catalogs.vocabulary.words import counted, shortened

__all__ = ["Catalog", "CatalogError", "CatalogPlan", "Member", "MemberWriter"]


class Catalog:
    """An ensemble's Cinema database on disk.  `create` or `open` one; iterate its `members`.

    Any number of processes may write at once, each its own members; a network file system must support file locks (NFS 4
    and Lustre mounted with flock do).  Readers need no lock: they see complete members and a complete table at any moment.

    Examples
    --------
    >>> from blobs import make_run
    >>> from catalogs import Catalog
    >>> catalog = Catalog.open(make_run() / "blobs.cdb")
    >>> len(catalog.members), catalog.appearance_names
    (20, ['blobs'])
    >>> catalog.image(catalog.members[0], "blobs", 4).shape
    (64, 64, 4)
    """

    def __init__(self, path: Path, plan: CatalogPlan, splits: Splits | None = None) -> None:
        self.path = path
        self.plan = plan
        self.splits = splits  # the members of one run and their splits; None: all members, as stored
        self._table = CatalogTable(path, plan)

    @classmethod
    def create(cls, path: str | os.PathLike[str], plan: CatalogPlan) -> Catalog:
        """A new, empty catalog; or the existing one, if it was made with the same plan (provenance aside).

        Raises CatalogError where plans differ, naming the differences, for a path that does not end with `.cdb`, and for a
        folder that holds anything else.
        """
        path = Path(path)
        if not (path / DESCRIPTION).exists():
            check_place(path, plan)
            plan.check_recordable()
            durable.make_folder(path)
            with durable.locked(path / LOCK):
                if not (path / DESCRIPTION).exists():  # another process may have been first
                    write_empty(path, plan)
        existing = cls.open(path)
        differing = existing.plan.differences(plan)
        if differing:
            raise CatalogError(
                f"{path} was made with other {', '.join(differing)}: choose another path, or remove it first"
            )
        return existing

    @classmethod
    def open(cls, path: str | os.PathLike[str]) -> Catalog:
        """The catalog at `path`; raises CatalogError when there is none, it is damaged, or of another schema."""
        path = Path(path)
        return cls(path, read_description(path))

    def __repr__(self) -> str:
        try:
            members = self.members
        except CatalogError as error:
            return f"<Catalog {self.path}: {error}>"
        views = sorted({len(member.cameras) for member in members}) or [len(self.plan.cameras)]
        count = f"{len(members)} members ({counted(member.split for member in members)})"
        images = f"{'-'.join(map(str, views))} views of {shortened(self.appearance_names)}"
        return f"<Catalog {self.path}: {count}; {self.plan.space}; {images}>"

    def _repr_html_(self) -> str:
        """Card for notebooks with a few images."""
        return catalog_html(self.path, self.plan, self.member_paths)

    @property
    def appearance_names(self) -> list[str]:
        return self.plan.appearance_names

    @property
    def members(self) -> tuple[Member, ...]:
        """The committed members, sorted by name."""
        members = (read_record(path, self.plan) for path in self.member_paths())
        return tuple(members) if self.splits is None else tuple(filter(None, map(self.splits.of, members)))

    @property
    def missing(self) -> tuple[MissingMember, ...]:
        """Members that were reported missing, sorted by name."""
        return missing_members(self.path)

    def with_splits(self, splits: Splits) -> Catalog:
        """The same catalog restricted to the members of `splits`, with those splits; nothing is written."""
        return Catalog(self.path, self.plan, splits)

    def member_paths(self) -> list[Path]:
        """Folders of the committed members, sorted by name."""
        return member_paths(self.path)

    def member(self, name: str) -> Member:
        """The member called `name`; raises CatalogError listing some that exist otherwise."""
        if name not in self:
            names = [p.name for p in self.member_paths()]
            raise CatalogError(f"{self.path} has no member {name!r}; it has {len(names)}: {', '.join(names[:5])}")
        return read_record(self.path / MEMBERS / name, self.plan)

    def __contains__(self, name: str) -> bool:
        return name_problem(name) is None and (self.path / MEMBERS / name / RECORD).is_file()

    def find(self, parameters: Mapping[str, float]) -> str | None:
        """The name of the member with exactly these parameters, None where there is none; takes constant time.

        Updates table and journal if necessary, or reads all records of a catalog that must not be written.  Raises ValueError
        for missing or unknown parameters.
        """
        parameters = self._ordered(parameters, "allow", 1)
        try:
            self.update_table()
        except OSError:
            key = key_of(parameters)
            return next((name for name, member_key in keys_of(self.path, self.plan) if member_key == key), None)
        return self._table.find(parameters)

    def begin_member(
        self,
        name: str,
        parameters: Mapping[str, float],
        *,
        split: str = "train",
        cameras: Sequence[Camera] | None = None,
        view_splits: Sequence[str] | None = None,
        provenance: Mapping[str, Any] | None = None,
        appearances: Sequence[str] | None = None,
        outside: Outside = "warn",
        replace: bool = False,
    ) -> MemberWriter:
        """A writer for a new member, used in a `with` block; `appearances` names those that it shows, all by default.

        With `replace` the new member atomically replaces the one of this name, if there is one, when it is complete; if anything
        fails, the old one stays.  (Where the file system can't swap two folders, as many network file systems, the member is
        missing between two renames; if its writer dies there, the next writer restores it.)

        Raises CatalogError, before anything is written, for a bad or used name, used parameters, a wrong split or provenance,
        unknown appearances, and cameras given twice or not at all.  Raises ValueError for wrong parameters.  A value out of
        bounds is recorded, with a warning unless `outside` is "allow".
        """
        if self.plan.packed:
            raise CatalogError(
                f"{self.path} is packed and takes no further members: `catalogs unpack` it, or pack again later"
            )
        if (cameras is None) == (not self.plan.cameras):
            raise CatalogError(
                "this catalog's cameras are shared: give none for a member"
                if self.plan.cameras
                else "members of this catalog have their own cameras: give them"
            )
        member = Member(
            name=name,
            parameters=self._ordered(parameters, outside, 2),
            split=split,
            cameras=self.plan.cameras if cameras is None else tuple(cameras),
            view_splits=self.plan.view_splits if view_splits is None else tuple(view_splits),
            path=self.path / UNFINISHED / name,
            provenance=provenance or {},
            appearances=known_appearances(appearances, self.plan.appearance_names),
        )
        self.update_table()
        self._refuse_duplicate(member, replace)
        durable.remove_abandoned(self.path / UNFINISHED)
        hidden = dataclasses.replace(member, path=self.unfinished_folder(name))
        return MemberWriter(self.plan, hidden, partial(self._commit, replace=replace))

    def unfinished_folder(self, name: str) -> Path:
        """A new hidden folder for the member `name`, which `adopt` commits; it is removed later if its writer dies."""
        folder = durable.partial_name(self.path / UNFINISHED / name)
        folder.parent.mkdir(exist_ok=True)
        folder.mkdir()
        return folder

    def adopt(self, members: Sequence[Member]) -> None:
        """Commit members whose folders, from `unfinished_folder`, are complete and synced, all at once.

        Raises CatalogError where a name or parameters are in use; then none of them is stored.
        """
        with self._ready_for(members):
            self._table.add(members)

    def add_coarse_fields(self, name: str, coarse: Mapping[str, CoarseField]) -> None:
        """Store the coarse fields, by name ("" for a single field), of a member that has none.

        Nothing else is touched but the digests in its record.  Raises CatalogError where the record is damaged.
        """
        folder, data = self.path / MEMBERS / name, coarse_bytes(stored_names(coarse, self.plan))
        with durable.locked(self.path / LOCK):
            member, _ = read_member(folder, self.plan)
            durable.remove_abandoned(folder)
            record = read_json(member.path / RECORD)
            durable.replace(folder / COARSE, data)
            if "digests" in record:
                record.pop("digest", None)
                record["digests"]["files"][COARSE] = digest_of(data)
                durable.replace(folder / RECORD, sealed(record))

    def image_path(self, member: Member | str, appearance: str, view: int) -> Path:
        """Path of the file that holds an image: in a packed catalog the member's pack."""
        name = member if isinstance(member, str) else member.name
        return self.path / MEMBERS / name / self.plan.file_name(appearance, view)

    def image(self, member: Member | str, appearance: str, view: int, *, dtype: str = "uint8") -> NDArray[Any]:
        """Premultiplied RGBA [H, W, 4], "uint8" or "float32"; opaque where the catalog has a background.

        Raises ImageError naming the file when it is absent, damaged or of another size than its camera, CatalogError for an
        appearance that the member does not show.
        """
        member = self.member(member) if isinstance(member, str) else member
        if appearance not in member.appearances:
            raise CatalogError(
                f"member {member.name} of {self.path} does not show {appearance!r}; it shows {shortened(member.appearances)}"
            )
        return read_picture(member, self.plan, appearance, view, dtype=dtype)

    def images(
        self,
        member: Member | str,
        appearance: str,
        views: Sequence[int] | None = None,
        *,
        dtype: str = "uint8",
        threads: int = 2,
    ) -> NDArray[Any]:
        """Several images of one member, all by default, decoded in parallel: [V, H, W, 4]."""
        member = self.member(member) if isinstance(member, str) else member
        views = range(len(member.cameras)) if views is None else views
        with ThreadPoolExecutor(threads) as pool:
            return np.stack(list(pool.map(lambda view: self.image(member, appearance, view, dtype=dtype), views)))

    def table(self) -> bytes:
        """Contents of `data.csv` after `rebuild_table`: the header and the rows of every committed member, sorted by name."""
        return b"".join(self._table.pieces())

    def update_table(self) -> None:
        """Rebuild `data.csv` if a writer was killed or members were removed by hand; else in constant time."""
        if not self._table.is_current():
            with durable.locked(self.path / LOCK):
                self._update_locked()

    def rebuild_table(self) -> None:
        """Write `data.csv` anew from the committed members, sorted by name, and clean up after writers that died."""
        with durable.locked(self.path / LOCK):
            self._table.rebuild()

    def repair(self, set_aside: Callable[[], Mapping[str, Path]] = dict) -> None:
        """`rebuild_table`, from rows that are derived anew from every member's record.

        `set_aside` is called under the lock and names members to move, each with its new path.
        """
        with durable.locked(self.path / LOCK):
            durable.make_folder(self.path / MEMBERS)
            self._table.clean_up()
            moves = set_aside()
            self._table.derive_rows(without=moves)
            if moves:
                self._table.set_aside(moves)
            self._table.rebuild()

    def unfinished(self) -> list[Path]:
        """Hidden folders of members that are being written or whose writer died."""
        return durable.partials(self.path / UNFINISHED)

    def _commit(self, writer: MemberWriter, *, replace: bool) -> None:
        """Commit the member and its rows; everything that can fill a disk is written before the first rename."""
        member, missing = writer.member, writer.missing()
        if missing:
            raise CatalogError(f"member {member.name} lacks {len(missing)} images, first {missing[0]}: not stored")
        write_record(member, self.plan, writer.digests())
        durable.sync_tree(member.path)
        with self._ready_for([member], replace=replace):
            if member.name in self:
                self._table.replace(member)
            else:
                self._table.add([member])

    @contextlib.contextmanager
    def _ready_for(self, members: Sequence[Member], *, replace: bool = False) -> Iterator[None]:
        """Hold the lock, with a current table, for a commit of members; raises CatalogError for duplicates."""
        with durable.locked(self.path / LOCK):
            self._update_locked()
            for member in members:
                self._refuse_duplicate(member, replace)
            self._table.clean_up()
            yield

    def _update_locked(self) -> None:
        if not self._table.is_current():
            self._table.rebuild()

    def _ordered(self, parameters: Mapping[str, float], outside: Outside, depth: int) -> dict[str, float]:
        """Validated parameters in the space's order; a warning points `depth` calls above this one."""
        values = self.plan.space.values(parameters, outside=outside, stacklevel=depth + 1)
        return dict(zip(self.plan.space.names, values.tolist(), strict=True))

    def _refuse_duplicate(self, member: Member, replace: bool) -> None:
        """Raise CatalogError where another member has the name or the parameters; with `replace`, its own name may be there."""
        other = self._table.find(member.parameters)
        if other in (None, member.name):
            other = member.name if member.name in self and not replace else None
        if other:
            parameters = read_json(self.path / MEMBERS / other / RECORD).get("parameters")
            raise CatalogError(
                f"member {other} with parameters {parameters} is in {self.path} already: "
                f"nothing was written for {member.name}"
            )
