"""One member of an ensemble on disk: a folder of images, its rows of the table, and its record."""

from __future__ import annotations

import json
import math
import sys
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from catalogs.files import cinema, durable
from catalogs.files.digests import digest_of, is_sealed, sealed
from catalogs.store.coarse import CoarseField, coarse_names, load_coarse_fields
from catalogs.store.digests import Digests
from catalogs.store.plan import (
    ACCEPT,
    CHANGED,
    CatalogError,
    CatalogPlan,
    check_views,
    json_values,
    name_problem,
    parsed_json,
    read_bytes,
    read_json,
)
from catalogs.store.summary import FieldSummary, load_summaries
from catalogs.vocabulary.cameras import Camera, spherical_angles
from catalogs.vocabulary.parameters import SPLITS
from catalogs.vocabulary.variations import VariationSetting
from catalogs.vocabulary.words import member_line, shortened

RECORD = "member.json"
ROWS = "rows.csv"
CAMERAS = "cameras.json"
SUMMARY = "field.npz"
COARSE = "coarse.npz"
FIELD_FILES = SUMMARY, COARSE
NO_DIGESTS = Digests()
T = TypeVar("T")


@dataclass(frozen=True, slots=True)
class Member:
    """A member of an ensemble.

    Attributes
    ----------
    name : its folder in `members/`.
    parameters : the simulation parameters by name, in physical units.
    split : "train", "validation" or "test".
    cameras : the viewpoints of its images.
    view_splits : "train", "validation" or "test" per camera.
    path : its folder.
    provenance : JSON values: the simulated time, the hook's warnings, where images came from.
    appearances : names of those it was rendered with, in the plan's order; all of them or some.

    Examples
    --------
    >>> from blobs import make_run
    >>> from catalogs import Catalog
    >>> member = Catalog.open(make_run() / "blobs.cdb").members[0]
    >>> member.split, member.parameters
    ('train', {'separation': 0.61, 'width': 0.2})
    >>> member.coarse_fields()[""].values.shape
    (24, 24, 24)
    """

    name: str
    parameters: Mapping[str, float]
    split: str
    cameras: tuple[Camera, ...]
    view_splits: tuple[str, ...]
    path: Path
    provenance: Mapping[str, Any] = field(default_factory=dict)
    appearances: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        problem = name_problem(self.name)
        if problem:
            raise CatalogError(f"invalid member name: {problem}")
        if self.split not in SPLITS:
            raise CatalogError(f"split must be one of {SPLITS}, got {self.split!r}")
        if not self.cameras:
            raise CatalogError(f"member {self.name} has no cameras: members of this catalog have their own")
        check_views(self.cameras, self.view_splits)
        object.__setattr__(self, "provenance", json_values(self.provenance, f"the provenance of member {self.name}"))

    def __repr__(self) -> str:
        return member_line(self, f"{len(self.cameras)} views of {shortened(self.appearances)}")

    def summary(self, field: str = "") -> FieldSummary | None:
        """The summary of a field, by default of the first; None where there is none.

        A member of a single field gives its summary for any name, since that field's own is not stored.
        """
        return _of_field(self.summaries(), field)

    def summaries(self) -> dict[str, FieldSummary]:
        """The summary of each field by name, "" for a single one; empty for imported images."""
        path = self.path / SUMMARY
        return load_summaries(path) if path.exists() else {}

    def coarse_field(self, field: str = "") -> CoarseField | None:
        """A field with at most 64³ samples, by default the first; None where none is stored.  Names as in `summary`."""
        return _of_field(self.coarse_fields(), field)

    def coarse_fields(self) -> dict[str, CoarseField]:
        """Each field with at most 64³ samples by name, "" for a single one; empty where none is stored.

        Raises ValueError naming a damaged file.
        """
        path = self.path / COARSE
        return load_coarse_fields(path) if path.exists() else {}

    def coarse_names(self) -> tuple[str, ...]:
        """The names of `coarse_fields`, which are not read for them; raises ValueError naming a damaged file."""
        path = self.path / COARSE
        return coarse_names(path) if path.exists() else ()

    def row_split(self, view: int, setting: VariationSetting | None = None) -> str:
        """The split of one image: test if its member, its view or its setting is for testing, else validation, else train."""
        return max(self.split, self.view_splits[view], setting.split if setting else "train", key=SPLITS.index)


def _of_field(by_name: Mapping[str, T], field: str) -> T | None:
    """Of the values `by_name` that of a field; where it is of a single one, of any name."""
    if field in by_name or not by_name:
        return by_name.get(field)
    return next(iter(by_name.values())) if not field or "" in by_name else None


def known_appearances(names: Sequence[str] | None, available: Sequence[str]) -> tuple[str, ...]:
    """`names` in the order of the catalog's own, `available`; all for None.  Raises CatalogError for an unknown name, or none."""
    if names is None:
        return tuple(available)
    wanted = {names} if isinstance(names, str) else set(names)
    unknown = sorted(wanted - set(available))
    if unknown or not wanted:
        raise CatalogError(
            f"a member needs appearances of the catalog's, which are {shortened(available, 8)}, "
            f"got {shortened(unknown, 8) or 'none'}"
        )
    return tuple(name for name in available if name in wanted)


def stored_names(fields: Mapping[str, T], plan: CatalogPlan) -> Mapping[str, T]:
    """A member's fields under the names in its files: the field of a catalog that shows only one has none."""
    return {"": next(iter(fields.values()))} if len(plan.fields) == 1 == len(fields) else fields


def rows_of(member: Member, plan: CatalogPlan) -> Iterator[list[cinema.Cell]]:
    """The member's rows of the table: one per appearance and view."""
    low, high = np.array(plan.bounds)
    for appearance in (a for a in plan.appearances if a.name in set(member.appearances)):
        varied, setting = plan.varied(appearance.name).values(), plan.setting(appearance.name)
        for view, camera in enumerate(member.cameras):
            yield [
                *member.parameters.values(),
                appearance.name,
                *varied,
                member.name,
                view,
                *spherical_angles(camera.position - (low + high) / 2.0),
                member.row_split(view, setting),
                member.split,
                member.view_splits[view],
                f"members/{member.name}/{plan.file_name(appearance.name, view)}",
            ]


def write_record(member: Member, plan: CatalogPlan, digests: Digests = NO_DIGESTS) -> None:
    """Write the member's record, with the `digests` of its images and summaries, rows and own cameras; not synced."""
    durable.write(member.path / ROWS, cinema.format_rows(rows_of(member, plan)).encode())
    if not plan.cameras:
        cameras = json.dumps([camera.to_json() for camera in member.cameras]).encode()
        durable.write(member.path / CAMERAS, cameras)
        digests = replace(digests, files={**digests.files, CAMERAS: digest_of(cameras)})
    durable.write(member.path / RECORD, record_of(member, plan, digests))


def record_of(member: Member, plan: CatalogPlan, digests: Digests) -> bytes:
    """Contents of the member's record in a catalog of this plan."""
    record = {
        "name": member.name,
        "parameters": dict(member.parameters),
        "split": member.split,
        "own_cameras": not plan.cameras,
        "view_splits": list(member.view_splits),
        "provenance": dict(member.provenance),
        **({"appearances": list(member.appearances)} if len(member.appearances) < len(plan.appearances) else {}),
        "digests": replace(digests, plan=plan.digest).to_json(),
    }
    return sealed(record)


def read_record(path: Path, plan: CatalogPlan) -> Member:
    """The member in the folder `path`; raises CatalogError naming the file that is absent or damaged."""
    return _member(path, read_json(path / RECORD), plan)


def read_member(path: Path, plan: CatalogPlan, *, verify: bool = True) -> tuple[Member, Digests]:
    """The member in the folder `path`, and its digests.

    Raises CatalogError naming the file that is absent or damaged or, with `verify`, contradicts its digest.
    """
    data, digests = read_bytes(path / RECORD), NO_DIGESTS
    record = parsed_json(path / RECORD, data)
    if verify and not is_sealed(data) and not record.keys().isdisjoint(("digest", "digests")):
        raise CatalogError(f"{path / RECORD} is damaged: {CHANGED}; {ACCEPT}")
    with suppress(KeyError, TypeError, ValueError):  # none, or malformed by an edit
        digests = Digests.from_json(record["digests"])
    return _member(path, record, plan, digests.files.get(CAMERAS, "") if verify else ""), digests


def _member(path: Path, record: Mapping[str, Any], plan: CatalogPlan, cameras_digest: str = "") -> Member:
    """The member of a record; its own cameras are compared with a digest, where given."""
    cameras = _own_cameras(path / CAMERAS, cameras_digest) if record.get("own_cameras") else plan.cameras
    try:
        parameters = {name: float(record["parameters"][name]) for name in plan.space.names}
        if not all(map(math.isfinite, parameters.values())) or record["name"] != path.name:
            raise ValueError(f"it describes {record['name']} with {parameters}")
        return Member(
            name=record["name"],
            parameters=parameters,
            split=sys.intern(record["split"]),
            cameras=cameras,
            view_splits=_shared(record["view_splits"], plan.view_splits),
            path=path,
            provenance=record["provenance"],
            appearances=known_appearances(record.get("appearances"), plan.appearance_names),
        )
    except (KeyError, TypeError, ValueError) as error:
        raise CatalogError(f"{path / RECORD} is damaged: {error!r}") from error


def own_name(folder: Path) -> str:
    """The name in the record of the member in `folder`, which may have been renamed; "" unless its digest proves it right."""
    try:
        data = read_bytes(folder / RECORD)
        name = parsed_json(folder / RECORD, data)["name"] if is_sealed(data) else ""
    except (CatalogError, OSError, KeyError):
        return ""
    return name if name_problem(name) is None else ""


def has_coarse_fields(folder: Path, plan: CatalogPlan) -> bool:
    """True if the member in `folder` has coarse fields, recorded if its images are: a killed writer may not have got that far."""
    if not (folder / COARSE).is_file():
        return False
    _, digests = read_member(folder, plan, verify=False)
    return COARSE in digests.files or not digests.images


def restored_record(folder: Path, parameters: Mapping[str, float]) -> bytes | None:
    """The damaged record of the member in `folder` as it was with these parameters; None unless its digest proves that."""
    try:
        record = read_json(folder / RECORD)
        digest = record.pop("digest")
        data = sealed({**record, "parameters": dict(parameters)})
    except (CatalogError, OSError, KeyError, ValueError):
        return None
    return data if parsed_json(folder / RECORD, data)["digest"] == digest else None


def _own_cameras(path: Path, digest: str) -> tuple[Camera, ...]:
    """The cameras in a member's file, which must have this digest unless that is ""."""
    data = read_bytes(path)
    records = parsed_json(path, data, list)
    if digest and digest_of(data) != digest:
        raise CatalogError(f"{path} is damaged: {CHANGED}; {ACCEPT}")
    try:
        return tuple(Camera.from_json(camera) for camera in records)
    except (KeyError, TypeError, ValueError) as error:
        raise CatalogError(f"{path} is damaged: {error!r}") from error


def _shared(splits: Sequence[str], common: tuple[str, ...]) -> tuple[str, ...]:
    """The splits of a member's views; where equal, the plan's own tuple, so that 100,000 members share it."""
    own = tuple(map(sys.intern, splits))
    return common if own == common else own
