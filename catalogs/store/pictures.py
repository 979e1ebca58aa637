"""Images of a stored member: a file each, or one pack for all."""

from __future__ import annotations

import os
from collections.abc import Iterable
from typing import Any

from numpy.typing import NDArray

from catalogs.files.images import ImageError, in_memory, read_image, read_stored
from catalogs.files.packed import PACK, Pack, PackError, open_pack
from catalogs.store.members import Member
from catalogs.store.plan import CatalogPlan


def read_picture(
    member: Member, plan: CatalogPlan, appearance: str, view: int, *, dtype: str = "uint8"
) -> NDArray[Any]:
    """One of the member's images: premultiplied RGBA [H, W, 4], "uint8" or "float32".

    Raises ImageError naming the file when it is absent, damaged or of another size than its camera.
    """
    camera = member.cameras[view]
    if plan.packed:
        try:
            return in_memory(pack_of(member).pixels(number_of(member, appearance, view)), dtype)
        except (PackError, OSError) as error:
            raise ImageError(str(error)) from error
    path = member.path / plan.image_name(appearance, view)
    rgba = read_image(path, dtype=dtype)
    if rgba.shape[:2] != (camera.height, camera.width):
        raise ImageError(f"{path} is {rgba.shape[0]}x{rgba.shape[1]}, its camera {camera.height}x{camera.width}")
    return rgba


def stored_picture(member: Member, plan: CatalogPlan, appearance: str, view: int) -> NDArray[Any]:
    """One of the member's images as stored, [H, W, C]; raises ImageError or PackError where it is absent or damaged."""
    if plan.packed:
        return pack_of(member).pixels(number_of(member, appearance, view))
    return read_stored(member.path / plan.image_name(appearance, view))


def picture_sizes(member: Member, plan: CatalogPlan, appearances: Iterable[str]) -> list[int]:
    """Bytes of each image's own file, appearance by appearance and view by view, also where it is packed.

    Raises OSError or PackError where one is absent.
    """
    views = range(len(member.cameras))
    if plan.packed:
        entries = pack_of(member).entries
        return [int(entries[number_of(member, name, view)]["size"]) for name in appearances for view in views]
    folder = os.fspath(member.path)  # a path object for each of many thousands takes longer than to ask for its size
    return [os.stat(f"{folder}/{plan.image_name(name, view)}").st_size for name in appearances for view in views]


def pack_of(member: Member) -> Pack:
    """The pack of a member of a packed catalog; raises PackError where it is absent, damaged, or not this member's."""
    camera = member.cameras[0]
    count = len(member.appearances) * len(member.cameras)
    return open_pack(member.path / PACK, count, camera.height, camera.width)


def number_of(member: Member, appearance: str, view: int) -> int:
    """Number of an image in its member's pack."""
    return member.appearances.index(appearance) * len(member.cameras) + view
