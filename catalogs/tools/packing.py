"""Conversion of a catalog to one file of images per member, and back."""

from __future__ import annotations

import os
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from pathlib import Path

from catalogs.files import durable
from catalogs.files.digests import digest_of, digest_of_file
from catalogs.files.images import ImageError
from catalogs.files.packed import PACK, PackError, write_pack
from catalogs.store.catalog import Catalog, CatalogError, Member
from catalogs.store.digests import Digests
from catalogs.store.pictures import number_of, pack_of
from catalogs.tools.damage import file_problem, images_of
from catalogs.tools.transfer import Fill, Progress, add_members

WRITERS = 2


@dataclass(frozen=True)
class Transferred:
    """Numbers of members transferred now, of members present before, and of images with equal pixels in other bytes."""

    made: int
    there: int
    other_bytes: int = 0


def pack(
    source: str | os.PathLike[str],
    destination: str | os.PathLike[str],
    *,
    progress: Progress = lambda done, total: None,
) -> Transferred:
    """Write the catalog `source` into the catalog `destination`, with one HDF5 file of images per member (`catalogs.files.packed`).

    Table, records and summaries are the same, except for the FILE column; `unpack` restores the same files, byte by byte.  An
    existing destination is resumed, or extended by new members of the source.

    Raises CatalogError where the source is packed already, or the destination is of another scene or has other members.  Raises
    CatalogError for a member whose views differ in size, and ImageError for a damaged image; members packed before stay.
    """
    catalog = Catalog.open(source)
    if catalog.plan.packed:
        raise CatalogError(f"{catalog.path} is packed already")
    return _transfer(catalog, Path(destination), True, _pack_member, progress)


def unpack(
    source: str | os.PathLike[str],
    destination: str | os.PathLike[str],
    *,
    progress: Progress = lambda done, total: None,
) -> Transferred:
    """Write the packed catalog `source` into the catalog `destination` with a file per image: the inverse of `pack`.

    Every file has its former bytes, as long as zlib and OpenImageIO encode as they did for `pack`; the result counts images with
    equal pixels in other bytes.  Raises CatalogError as `pack` does, PackError for a damaged pack.
    """
    catalog = Catalog.open(source)
    if not catalog.plan.packed:
        raise CatalogError(f"{catalog.path} is not packed: each of its images has a file already")
    return _transfer(catalog, Path(destination), False, _unpack_member, progress)


def _transfer(source: Catalog, destination: Path, packed: bool, fill: Fill, progress: Progress) -> Transferred:
    if destination.resolve() == source.path.resolve():
        raise CatalogError(f"{destination} is the catalog itself: choose another folder")
    target = Catalog.create(destination, replace(source.plan, packed=packed))
    names = [path.name for path in source.member_paths()]
    present = {path.name for path in target.member_paths()}
    for name in sorted(present):
        already = target.member(name)
        if name not in source or replace(source.member(name), cameras=already.cameras, path=already.path) != already:
            raise CatalogError(f"{destination} has a member {name} that {source.path} has not: choose a new folder")
    new = [(source, name) for name in names if name not in present]
    other_bytes = add_members(target, new, fill, progress)
    return Transferred(len(new), len(present), other_bytes)


def _pack_member(source: Catalog, member: Member, folder: Path, digests: Digests) -> tuple[int, Digests]:
    """Write a member's pack; returns 0, and the digests with the pack's."""
    sizes = sorted({(camera.width, camera.height) for camera in member.cameras})
    if len(sizes) > 1:
        raise CatalogError(f"member {member.name} of {source.path} can't be packed: its views differ in size, {sizes}")
    for name, image in images_of(source, member, digests):
        if problem := file_problem(source.path, name, image):
            raise ImageError(f"{source.path / name} {problem}: `catalogs check --repair` sets its member aside")
    files = [source.image_path(member, a, view) for a in member.appearances for view in range(len(member.cameras))]
    write_pack(folder / PACK, member.appearances, files)
    return 0, replace(digests, files={**digests.files, PACK: digest_of_file(folder / PACK)})


def _unpack_member(source: Catalog, member: Member, folder: Path, digests: Digests) -> tuple[int, Digests]:
    """Write a member's image files; returns how many have other bytes than the packed ones, and the digests."""
    pack = pack_of(member)

    def write(image: tuple[str, int]) -> tuple[bool, str]:
        appearance, view = image
        data, same = pack.file(number_of(member, appearance, view))
        durable.write(folder / source.plan.image_name(appearance, view), data)
        return not same, digests.image(appearance, view) if same else digest_of(data)

    for appearance in member.appearances:
        (folder / appearance).mkdir()
    with ThreadPoolExecutor(WRITERS) as pool:
        views = range(len(member.cameras))
        written = {a: list(pool.map(write, [(a, view) for view in views])) for a in member.appearances}
    images = {a: "".join(digest for _, digest in written[a]) for a in digests.images}
    others = sum(is_other for each in written.values() for is_other, _ in each)
    return others, Digests(images, {name: digest for name, digest in digests.files.items() if name != PACK})


__all__ = ["PackError", "Transferred", "pack", "unpack"]
