"""A catalog with one file of pictures for each member, made from one with a file for each picture, and back."""

from __future__ import annotations

import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from pathlib import Path

from catalogs.files import durable
from catalogs.files.images import ImageError
from catalogs.files.packed import PACK, PackError, write_pack
from catalogs.store.catalog import Catalog, CatalogError, Member
from catalogs.store.pictures import number_of, pack_of
from catalogs.tools.damage import file_problem, images_of
from catalogs.tools.transfer import Fill, add_members

Progress = Callable[[int, int], None]
WRITERS = 2


@dataclass(frozen=True)
class Transferred:
    """How many members were packed or unpacked now, how many were there, and of how many pictures only the pixels are the same."""

    made: int
    there: int
    other_bytes: int = 0


def pack(
    source: str | os.PathLike[str],
    destination: str | os.PathLike[str],
    *,
    progress: Progress = lambda done, total: None,
) -> Transferred:
    """Write the catalog `source` into the catalog `destination`, with one HDF5 file of pictures a member (`catalogs.files.packed`).

    Table, records and summaries are the same, but for the FILE column.  Pictures are kept so that `unpack` gives the same files,
    byte by byte.  A destination that is there goes on where it was interrupted, and takes in members that are new in the source.

    Raises CatalogError where the source is packed already, where the destination is of another scene or has members that the
    source has not, and for a member whose views differ in size; ImageError for a damaged picture.  What was packed before stays.
    """
    given = Catalog.open(source)
    if given.plan.packed:
        raise CatalogError(f"{given.path} is packed already")
    return _transfer(given, Path(destination), True, _pack_member, progress)


def unpack(
    source: str | os.PathLike[str],
    destination: str | os.PathLike[str],
    *,
    progress: Progress = lambda done, total: None,
) -> Transferred:
    """Write the packed catalog `source` into the catalog `destination` with a file for each picture: the inverse of `pack`.

    Every file has the bytes that it had, as long as zlib and OpenImageIO encode as they did when it was packed; of how many
    pictures only the pixels are the same, the result tells.  Raises CatalogError as `pack` does, PackError for a damaged pack.
    """
    given = Catalog.open(source)
    if not given.plan.packed:
        raise CatalogError(f"{given.path} is not packed: each of its pictures has a file already")
    other_bytes = 0

    def fill(catalog: Catalog, member: Member, folder: Path) -> None:
        nonlocal other_bytes
        other_bytes += _unpack_member(catalog, member, folder)

    return replace(_transfer(given, Path(destination), False, fill, progress), other_bytes=other_bytes)


def _transfer(source: Catalog, destination: Path, packed: bool, fill: Fill, progress: Progress) -> Transferred:
    if destination.resolve() == source.path.resolve():
        raise CatalogError(f"{destination} is the catalog itself: choose another folder")
    target = Catalog.create(destination, replace(source.plan, packed=packed))
    names = [path.name for path in source.member_paths()]
    there = {path.name for path in target.member_paths()}
    for name in sorted(there):
        if name not in source or not _is_same(source.member(name), target.member(name)):
            raise CatalogError(f"{destination} has a member {name} that {source.path} has not: choose a new folder")
    wanted = [(source, name) for name in names if name not in there]
    add_members(target, wanted, fill, progress)
    return Transferred(len(wanted), len(there))


def _is_same(one: Member, other: Member) -> bool:
    """Whether both are records of the same member; pictures are not compared."""
    return replace(one, cameras=other.cameras, path=other.path) == other


def _pack_member(source: Catalog, member: Member, folder: Path) -> None:
    sizes = sorted({(camera.width, camera.height) for camera in member.cameras})
    if len(sizes) > 1:
        raise CatalogError(f"member {member.name} of {source.path} can't be packed: its views differ in size, {sizes}")
    for name, wanted in images_of(source, member):
        if problem := file_problem(source.path, name, wanted):
            raise ImageError(f"{source.path / name} {problem}: `catalogs check --repair` sets its member aside")
    files = [source.image_path(member, a, view) for a in member.appearances for view in range(len(member.cameras))]
    write_pack(folder / PACK, member.appearances, files)


def _unpack_member(source: Catalog, member: Member, folder: Path) -> int:
    """Write a member's picture files; returns how many have other bytes than those that were packed."""
    kept = pack_of(member)

    def write(picture: tuple[str, int]) -> bool:
        appearance, view = picture
        data, same = kept.file(number_of(member, appearance, view))
        durable.write(folder / source.plan.image_name(appearance, view), data)
        return not same

    for appearance in member.appearances:
        (folder / appearance).mkdir()
    with ThreadPoolExecutor(WRITERS) as pool:
        return sum(pool.map(write, [(a, view) for a in member.appearances for view in range(len(member.cameras))]))


__all__ = ["PackError", "Transferred", "pack", "unpack"]
