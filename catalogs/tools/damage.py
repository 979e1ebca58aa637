"""Problems of one file of a Cinema database, or of one member of a catalog."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from catalogs.files import durable
from catalogs.files.digests import digest_of_file
from catalogs.files.images import ImageError, read_stored
from catalogs.files.packed import PACK, PackError, open_pack, pack_problem
from catalogs.files.png import PngError, check_png
from catalogs.store.catalog import Catalog, CatalogError, Member
from catalogs.store.digests import Digests
from catalogs.store.members import COARSE, RECORD, ROWS, SUMMARY, read_member
from catalogs.store.plan import CatalogPlan
from catalogs.store.table import MEMBERS, derived_rows
from catalogs.vocabulary.appearance import shown_fields

OTHER = "is not the file that was written with its member (its digest differs)"
FOREIGN = "was written for another catalog.json"
IMAGES = {".jpg", ".jpeg", ".exr", ".tif", ".tiff", ".webp"}


@dataclass(frozen=True)
class ExpectedImage:
    """Expected contents of an image file: RGBA of this size; in a pack, this number of views of each of these appearances.

    `digest` is the file's, "" where its member's record has none.
    """

    height: int
    width: int
    views: int = 1
    packed: tuple[str, ...] = ()
    digest: str = ""


def file_problem(root: Path, name: str, expected: ExpectedImage | None = None, *, decode: bool = True) -> str | None:
    """The problem of the file `name` of the database `root`, or None.

    Images are compared with `expected`, where given: by their digest, since they were valid when it was recorded, else decoded
    whole.  Without `decode` they only have to exist.
    """
    path = root / name
    if not path.is_file():
        kind = durable.special(path)
        return f"is {kind}, not a regular file" if kind else "is missing"
    if not path.resolve().is_relative_to(root.resolve()):
        return "is a link that leaves the database"
    if not decode:
        return None
    digest = expected.digest if expected is not None else ""
    try:
        if digest and digest_of_file(path) == digest:
            return None
        if expected is not None and expected.packed:
            pack = open_pack(path, expected.views * len(expected.packed), expected.height, expected.width)
            return pack_problem(pack, expected.packed) or (OTHER if digest else None)
        shape = _read_shape(path)
    except (PngError, PackError, ImageError, OSError) as error:
        return f"is damaged: {error}"
    if shape is None:
        return None if path.stat().st_size else "is empty"
    if expected is not None and shape != (expected.height, expected.width, 4):
        return f"is {_size(*shape)}; its camera makes {_size(expected.height, expected.width, 4)}"
    return OTHER if digest else None


def is_foreign(digests: Digests, plan: CatalogPlan) -> bool:
    """True for a member that was written into a catalog of another plan."""
    return bool(digests.plan) and digests.plan != plan.digest


def fields_problem(member: Member, plan: CatalogPlan, digests: Digests) -> str | None:
    """The problem of a member's summaries or coarse fields, or None.

    A file is missing, damaged, another than was written, or has other fields than the member's appearances.
    """
    return _field_file_problem(member, plan, digests, SUMMARY) or _field_file_problem(member, plan, digests, COARSE)


def _field_file_problem(member: Member, plan: CatalogPlan, digests: Digests, name: str) -> str | None:
    path, digest = member.path / name, digests.files.get(name, "")
    if digest and not path.exists():
        return f"{name} is missing"
    if digest and len(plan.fields) < 2 and not durable.special(path) and digest_of_file(path) == digest:
        return None
    try:
        contents = member.summaries() if name == SUMMARY else member.coarse_fields()
    except ValueError as error:
        return str(error)
    fields = shown_fields(a for a in plan.appearances if a.name in set(member.appearances))
    fits = (
        set(contents) == set(fields) if name == SUMMARY else set(contents) <= set(fields)
    )  # none of a field that is all holes
    if contents and len(plan.fields) > 1 and not fits:
        return f"{name} is of the fields {list(contents)}, the images of {list(fields)}"
    unrecorded = not digest and digests.images and name == SUMMARY and contents
    return f"{name} {OTHER}" if unrecorded or (digest and digest_of_file(path) != digest) else None


def rows_problem(member: Member, plan: CatalogPlan) -> str | None:
    """The problem of a member's file of rows, or None: it is missing, or differs from the member's record."""
    try:
        rows = durable.read(member.path / ROWS)
    except FileNotFoundError:
        return f"{ROWS} is missing"
    except OSError as error:
        return str(error)
    return None if rows == derived_rows(member, plan) else f"{ROWS} differs from what member.json and the plan make"


def images_of(catalog: Catalog, member: Member, digests: Digests) -> Iterator[tuple[str, ExpectedImage]]:
    """A member's image files in the order of its rows: names relative to the catalog, and their expected contents."""
    if catalog.plan.packed:
        camera = member.cameras[0]
        views, digest = len(member.cameras), digests.files.get(PACK, "")
        image = ExpectedImage(camera.height, camera.width, views, member.appearances, digest)
        yield f"{MEMBERS}/{member.name}/{PACK}", image
        return
    for appearance in member.appearances:
        for view, camera in enumerate(member.cameras):
            name = f"{MEMBERS}/{member.name}/{catalog.plan.image_name(appearance, view)}"
            yield name, ExpectedImage(camera.height, camera.width, digest=digests.image(appearance, view))


def lasting_problems(catalog: Catalog, folder: Path) -> Iterator[str]:
    """Problems of the member in `folder` that only rendering it again can solve."""
    try:
        member, digests = read_member(folder, catalog.plan)
    except (CatalogError, OSError) as error:
        yield str(error)
        return
    if is_foreign(digests, catalog.plan):
        yield f"{RECORD} {FOREIGN}"
    if problem := fields_problem(member, catalog.plan, digests):
        yield problem
    for name, image in images_of(catalog, member, digests):
        if problem := file_problem(catalog.path, name, image):
            yield f"{name} {problem}"


def _read_shape(path: Path) -> tuple[int, int, int] | None:
    """Height, width and channels of an image, after reading every byte; None for other files."""
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
