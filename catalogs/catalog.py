"""The store of an ensemble's images: a Cinema database that grows by whole members and survives crashes.

    x.cdb/data.csv                       the table (specification D), rebuilt from the members
          catalog.json                   what a table can't hold: parameter space, cameras, appearances, conventions
          members/<name>/member.json     parameters, split, provenance
                         rows.csv        its part of the table
                         cameras.json    its own cameras, where they are not shared
                         field.npz       the field's summary
                         <appearance>/<view>.png

A member is written under a hidden name and renamed into place when all of it is on disk, so it is there whole or not at all.
"""

from __future__ import annotations

import json
import os
import shutil
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from catalogs import cinema, durable
from catalogs.appearance import Isosurface
from catalogs.cameras import Camera, spherical_angles
from catalogs.images import FORMATS, ImageError, read_image, write_image
from catalogs.parameters import SPLITS
from catalogs.plan import NAME, CatalogError, CatalogPlan, check_views, table_header
from catalogs.summary import FieldSummary

__all__ = ["Catalog", "CatalogError", "CatalogPlan", "Member", "MemberWriter"]

SCHEMA = 1
LOCK = ".lock"


@dataclass(frozen=True)
class Member:
    """A committed member of an ensemble."""

    name: str
    parameters: Mapping[str, float]
    split: str
    cameras: tuple[Camera, ...]
    view_splits: tuple[str, ...]
    path: Path
    provenance: Mapping[str, Any] = field(default_factory=dict)

    def summary(self) -> FieldSummary | None:
        """What was kept of the field; None for images that came without one."""
        path = self.path / "field.npz"
        return FieldSummary.load(path) if path.is_file() else None

    def row_split(self, view: int) -> str:
        """The split of one image: test wins over validation, validation over train."""
        return max(self.split, self.view_splits[view], key=SPLITS.index)


class MemberWriter:
    """Writes one member under a hidden name; leaving the `with` block commits it, an exception leaves nothing."""

    def __init__(self, catalog: Catalog, member: Member, partial: Path) -> None:
        self._catalog = catalog
        self.member = member
        self.path = partial
        self._written: set[tuple[str, int]] = set()

    def write_image(self, appearance: str, view: int, rgba: NDArray[Any]) -> None:
        """Store premultiplied RGBA [H, W, 4], uint8 or float32 in [0, 1], of the camera's size."""
        if appearance not in self._catalog.appearance_names:
            raise CatalogError(f"no appearance {appearance!r}; the catalog has {self._catalog.appearance_names}")
        if not 0 <= view < len(self.member.cameras):
            raise CatalogError(f"view {view} does not exist: there are {len(self.member.cameras)}")
        camera = self.member.cameras[view]
        if rgba.shape != (camera.height, camera.width, 4):
            raise CatalogError(f"view {view} must be {camera.height}x{camera.width} RGBA, got shape {rgba.shape}")
        path = self.path / self._catalog.image_name(appearance, view)
        path.parent.mkdir(exist_ok=True)
        write_image(path, rgba)
        self._written.add((appearance, view))

    def write_summary(self, summary: FieldSummary) -> None:
        """Keep the field's summary beside its images."""
        summary.save(self.path / "field.npz")

    def __enter__(self) -> MemberWriter:
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        try:
            if kind is None:
                self._catalog._commit(self)
        finally:
            shutil.rmtree(self.path, ignore_errors=True)

    def missing(self) -> list[tuple[str, int]]:
        """(appearance, view) pairs that were not written yet."""
        views = range(len(self.member.cameras))
        return [(a, v) for a in self._catalog.appearance_names for v in views if (a, v) not in self._written]


class Catalog:
    """An ensemble's Cinema database on disk.  `create` or `open` one; iterate its `members`."""

    def __init__(self, path: Path, plan: CatalogPlan) -> None:
        self.path = path
        self.plan = plan

    @classmethod
    def create(cls, path: str | os.PathLike[str], plan: CatalogPlan) -> Catalog:
        """A new, empty catalog; or the one that is there, if it was made with the same plan.

        Raises CatalogError naming what differs otherwise, and for a path that does not end with `.cdb`.
        """
        path = Path(path)
        if path.suffix != ".cdb":
            raise CatalogError(f"a Cinema database is a folder whose name ends with .cdb, got {path}")
        path.mkdir(parents=True, exist_ok=True)
        with durable.locked(path / LOCK):
            if (path / "catalog.json").exists():
                existing = cls.open(path)
                differing = existing.plan.differences(plan)
                if differing:
                    raise CatalogError(
                        f"{path} was made with other {', '.join(differing)}: choose another path, or remove it first"
                    )
                return existing
            table = cinema.format_rows([table_header(plan)]).encode()
            _refuse_strangers(path, table)
            durable.remove_abandoned(path)
            (path / "members").mkdir(exist_ok=True)
            durable.replace(path / "data.csv", table)
            record = {"schema": SCHEMA, **plan.to_json()}
            durable.replace(path / "catalog.json", json.dumps(record, indent=1, allow_nan=False).encode())
        return cls(path, plan)

    @classmethod
    def open(cls, path: str | os.PathLike[str]) -> Catalog:
        """The catalog at `path`; raises CatalogError when there is none, it is damaged, or it is newer than this program."""
        path = Path(path)
        record = _read_json(path / "catalog.json")
        schema = record.get("schema")
        if not isinstance(schema, int) or schema > SCHEMA:
            raise CatalogError(f"{path} has schema {schema!r}, this program knows {SCHEMA}: use a newer gs-surrogate")
        try:
            plan = CatalogPlan.from_json(record)
        except (KeyError, TypeError, ValueError) as error:
            raise CatalogError(f"{path / 'catalog.json'} is damaged: {error!r}") from error
        return cls(path, plan)

    def __repr__(self) -> str:
        members = self.members
        counts = ", ".join(f"{sum(m.split == s for m in members)} {s}" for s in SPLITS)
        ranges = ", ".join(f"{p.name} in [{p.low:g}, {p.high:g}] {p.unit}".rstrip() for p in self.plan.space.parameters)
        views = sorted({len(m.cameras) for m in members}) or [len(self.plan.cameras)]
        return (
            f"Catalog {self.path}\n  parameters  {ranges}\n  members     {len(members)} ({counts})\n"
            f"  appearances {', '.join(self.appearance_names)}\n  views       {'-'.join(map(str, views))}"
        )

    @property
    def appearance_names(self) -> list[str]:
        return [a.name for a in self.plan.appearances]

    @property
    def members(self) -> tuple[Member, ...]:
        """The committed members, sorted by name."""
        return tuple(self._read_member(path) for path in self._member_paths())

    def member(self, name: str) -> Member:
        """The member called `name`; raises CatalogError listing some that exist otherwise."""
        if name not in self:
            names = [p.name for p in self._member_paths()]
            raise CatalogError(f"{self.path} has no member {name!r}; it has {len(names)}: {', '.join(names[:5])}")
        return self._read_member(self.path / "members" / name)

    def __contains__(self, name: str) -> bool:
        return bool(NAME.fullmatch(name)) and (self.path / "members" / name / "member.json").is_file()

    def begin_member(
        self,
        name: str,
        parameters: Mapping[str, float],
        *,
        split: str = "train",
        cameras: Sequence[Camera] | None = None,
        view_splits: Sequence[str] | None = None,
        provenance: Mapping[str, Any] | None = None,
    ) -> MemberWriter:
        """A writer for a new member, to be used in a `with` block.

        Raises CatalogError before anything is written for a bad or used name, used parameters, a wrong split, or cameras
        given twice or not at all; ValueError for wrong parameters (a value out of bounds only warns, and is recorded).
        """
        if not NAME.fullmatch(name):
            raise CatalogError(f"a member's name must be letters, digits and _.+=-, got {name!r}")
        if split not in SPLITS:
            raise CatalogError(f"split must be one of {SPLITS}, got {split!r}")
        if (cameras is None) == (not self.plan.cameras):
            raise CatalogError(
                "this catalog's cameras are shared: members bring none"
                if self.plan.cameras
                else "every member of this catalog must bring its cameras"
            )
        values = self.plan.space.values(parameters)
        parameters = dict(zip(self.plan.space.names, values.tolist(), strict=True))
        cameras = self.plan.cameras if cameras is None else tuple(cameras)
        view_splits = self.plan.view_splits if view_splits is None else tuple(view_splits)
        check_views(cameras, view_splits)
        partial = durable.partial_name(self.path / "members" / name)
        member = Member(name, parameters, split, cameras, view_splits, partial, dict(provenance or {}))
        self._refuse_duplicate(member)
        durable.remove_abandoned(self.path / "members")
        partial.mkdir()
        return MemberWriter(self, member, partial)

    def image_name(self, appearance: str, view: int) -> str:
        """Path of an image below its member's folder."""
        return f"{appearance}/{view:03d}{FORMATS[self.plan.image_format]}"

    def image_path(self, member: Member | str, appearance: str, view: int) -> Path:
        """Path of an image file."""
        name = member if isinstance(member, str) else member.name
        return self.path / "members" / name / self.image_name(appearance, view)

    def image(self, member: Member | str, appearance: str, view: int, *, dtype: str = "uint8") -> NDArray[Any]:
        """Premultiplied RGBA [H, W, 4], "uint8" or "float32"; opaque where the catalog has a background.

        Raises ImageError naming the file when it is absent, damaged or of another size than its camera.
        """
        member = self.member(member) if isinstance(member, str) else member
        path = self.image_path(member, appearance, view)
        if not path.is_file():
            raise ImageError(f"{path} is missing")
        rgba = read_image(path, dtype=dtype)
        camera = member.cameras[view]
        if rgba.shape[:2] != (camera.height, camera.width):
            raise ImageError(f"{path} is {rgba.shape[0]}x{rgba.shape[1]}, its camera {camera.height}x{camera.width}")
        return rgba

    def images(
        self, member: Member | str, appearance: str, views: Sequence[int], *, dtype: str = "uint8", threads: int = 2
    ) -> NDArray[Any]:
        """Several images of one member, decoded in parallel: [V, H, W, 4]."""
        member = self.member(member) if isinstance(member, str) else member
        with ThreadPoolExecutor(threads) as pool:
            return np.stack(list(pool.map(lambda view: self.image(member, appearance, view, dtype=dtype), views)))

    def rebuild_table(self) -> None:
        """Write `data.csv` anew from the committed members, atomically; writers queue at the catalog's lock."""
        with durable.locked(self.path / LOCK):
            durable.remove_abandoned(self.path)
            parts = [cinema.format_rows([table_header(self.plan)])]
            parts += [(path / "rows.csv").read_bytes().decode() for path in self._member_paths()]
            table = "".join(parts).encode()
            current = self.path / "data.csv"
            if not current.is_file() or current.read_bytes() != table:
                durable.replace(current, table)

    def _commit(self, writer: MemberWriter) -> None:
        missing = writer.missing()
        if missing:
            raise CatalogError(
                f"member {writer.member.name} lacks {len(missing)} images, first {missing[0]}: not stored"
            )
        member = writer.member
        durable.write(writer.path / "rows.csv", cinema.format_rows(self._rows(member)).encode())
        if not self.plan.cameras:
            cameras = json.dumps([c.to_json() for c in member.cameras])
            durable.write(writer.path / "cameras.json", cameras.encode())
        durable.write(writer.path / "member.json", json.dumps(self._record(member), indent=1, allow_nan=False).encode())
        with durable.locked(self.path / LOCK):
            self._refuse_duplicate(member)
            durable.commit_folder(writer.path, self.path / "members" / member.name)
        self.rebuild_table()

    def _record(self, member: Member) -> dict[str, Any]:
        return {
            "name": member.name,
            "parameters": dict(member.parameters),
            "split": member.split,
            "own_cameras": not self.plan.cameras,
            "view_splits": list(member.view_splits),
            "provenance": dict(member.provenance),
        }

    def _rows(self, member: Member) -> Iterator[list[cinema.Cell]]:
        low, high = np.array(self.plan.bounds)
        has_isosurface = any(isinstance(a, Isosurface) for a in self.plan.appearances)
        for appearance in self.plan.appearances:
            isovalue = appearance.isovalue if isinstance(appearance, Isosurface) else 0.0
            for view, camera in enumerate(member.cameras):
                offset = camera.position - (low + high) / 2.0  # [3]
                yield [
                    *member.parameters.values(),
                    appearance.name,
                    *([float(isovalue)] if has_isosurface else []),
                    member.name,
                    view,
                    *spherical_angles(offset),
                    member.row_split(view),
                    member.split,
                    member.view_splits[view],
                    f"members/{member.name}/{self.image_name(appearance.name, view)}",
                ]

    def _refuse_duplicate(self, member: Member) -> None:
        for path in self._member_paths():
            parameters = _read_json(path / "member.json").get("parameters")
            if path.name == member.name or parameters == dict(member.parameters):
                raise CatalogError(
                    f"member {path.name} with parameters {parameters} is in {self.path} already: "
                    f"nothing was written for {member.name}"
                )

    def _member_paths(self) -> list[Path]:
        folder = self.path / "members"
        return sorted(p for p in folder.iterdir() if not p.name.startswith(".")) if folder.is_dir() else []

    def _read_member(self, path: Path) -> Member:
        record = _read_json(path / "member.json")
        try:
            own = _read_json(path / "cameras.json", list) if record["own_cameras"] else None
            return Member(
                name=record["name"],
                parameters={name: float(record["parameters"][name]) for name in self.plan.space.names},
                split=record["split"],
                cameras=self.plan.cameras if own is None else tuple(Camera.from_json(c) for c in own),
                view_splits=tuple(record["view_splits"]),
                path=path,
                provenance=record["provenance"],
            )
        except (KeyError, TypeError, ValueError) as error:
            raise CatalogError(f"{path / 'member.json'} is damaged: {error!r}") from error


def _refuse_strangers(path: Path, table: bytes) -> None:
    """Raise CatalogError where the folder holds more than an interrupted `create` of the same `table` leaves."""
    strangers = {p.name for p in path.iterdir() if p.name != LOCK and not p.name.endswith(durable.PARTIAL)} - {
        "members"
    }
    if "data.csv" in strangers and (path / "data.csv").read_bytes() == table:
        strangers.remove("data.csv")
    if strangers:
        raise CatalogError(f"{path} holds other things ({', '.join(sorted(strangers)[:3])}): choose another path")


def _read_json(path: Path, kind: type = dict) -> Any:
    try:
        record = json.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        raise CatalogError(f"{path} is missing: is {path.parent} a catalog made by gs-surrogate?") from None
    except ValueError as error:
        raise CatalogError(f"{path} is damaged: {error}") from error
    if not isinstance(record, kind):
        raise CatalogError(f"{path} is damaged: it must hold a {kind.__name__}")
    return record
