"""What is wrong with one file of a Cinema database, or with one member of a catalog."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from catalogs.files import durable
from catalogs.files.images import ImageError, read_stored
from catalogs.files.packed import PACK, PackError, open_pack, pack_problem
from catalogs.files.png import PngError, check_png
from catalogs.store.catalog import Catalog, CatalogError, Member
from catalogs.store.members import ROWS, SUMMARY, read_record
from catalogs.store.plan import CatalogPlan
from catalogs.store.table import MEMBERS, derived_rows
from catalogs.vocabulary.appearance import shown_fields

IMAGES = {".jpg", ".jpeg", ".exr", ".tif", ".tiff", ".webp"}


@dataclass(frozen=True)
class Wanted:
    """What an image file must hold: pictures of this size, RGBA; in a pack so many views of each of these appearances."""

    height: int
    width: int
    views: int = 1
    packed: tuple[str, ...] = ()


def file_problem(root: Path, name: str, wanted: Wanted | None = None, *, decode: bool = True) -> str | None:
    """What is wrong with the file `name` of the database `root`; None where nothing is.

    Images are decoded whole, and must be what is `wanted` where that is known; without `decode` it is enough that they are there.
    """
    path = root / name
    if not path.is_file():
        kind = durable.special(path)
        return f"is {kind}, where a file belongs" if kind else "is missing"
    if not path.resolve().is_relative_to(root.resolve()):
        return "is a link that leaves the database"
    if not decode:
        return None
    try:
        if wanted is not None and wanted.packed:
            pack = open_pack(path, wanted.views * len(wanted.packed), wanted.height, wanted.width)
            return pack_problem(pack, wanted.packed)
        shape = _read_shape(path)
    except (PngError, PackError, ImageError, OSError) as error:
        return f"is damaged: {error}"
    if shape is None:
        return None if path.stat().st_size else "is empty"
    if wanted is not None and shape != (wanted.height, wanted.width, 4):
        return f"is {_size(*shape)}; its camera makes {_size(wanted.height, wanted.width, 4)}"
    return None


def summary_problem(member: Member, plan: CatalogPlan) -> str | None:
    """Why the sidecar can't be read or, where a catalog shows several fields, is not of exactly those that the member shows."""
    try:
        kept = member.summaries()
    except ValueError as error:
        return str(error)
    shown = shown_fields(a for a in plan.appearances if a.name in set(member.appearances))
    if not kept or len(plan.fields) < 2 or set(kept) == set(shown):
        return None
    return f"{SUMMARY} is of the fields {list(kept)}, the pictures of {list(shown)}"


def rows_problem(member: Member, plan: CatalogPlan) -> str | None:
    """Why the member's file of rows is not what its record makes."""
    try:
        rows = durable.read(member.path / ROWS)
    except FileNotFoundError:
        return f"{ROWS} is missing"
    except OSError as error:
        return str(error)
    return (
        None
        if rows == derived_rows(member, plan)
        else f"{ROWS} is not what its member.json and the catalog's plan make"
    )


def images_of(catalog: Catalog, member: Member) -> Iterator[tuple[str, Wanted]]:
    """A member's image files in the order of its rows: names relative to the catalog, and what they must hold."""
    if catalog.plan.packed:
        camera = member.cameras[0]
        wanted = Wanted(camera.height, camera.width, len(member.cameras), member.appearances)
        yield f"{MEMBERS}/{member.name}/{PACK}", wanted
        return
    for appearance in member.appearances:
        for view, camera in enumerate(member.cameras):
            name = catalog.image_path(member, appearance, view).relative_to(catalog.path).as_posix()
            yield name, Wanted(camera.height, camera.width)


def lasting_problems(catalog: Catalog, folder: Path) -> Iterator[str]:
    """What is wrong with the member in `folder` that nothing stored can mend: then it must be made again."""
    try:
        member = read_record(folder, catalog.plan)
    except (CatalogError, OSError) as error:
        yield str(error)
        return
    if problem := summary_problem(member, catalog.plan):
        yield problem
    for name, shape in images_of(catalog, member):
        if problem := file_problem(catalog.path, name, shape):
            yield f"{name} {problem}"


def _read_shape(path: Path) -> tuple[int, int, int] | None:
    """Height, width and channels of an image whose every byte was read; None for a file that is no image."""
    if path.suffix.lower() == ".png":
        header = check_png(path)
        if header.is_plain_color:
            return header.height, header.width, 4 if header.has_alpha else 3
    if path.suffix.lower() not in {".png", *IMAGES}:
        return None
    height, width, channels = read_stored(path).shape
    return height, width, channels


def _size(height: int, width: int, channels: int) -> str:
    return f"{width}x{height} with {channels} channels"
