"""Problems of one file of a Cinema database, or of one member of a catalog."""

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
class ExpectedImage:
    """Expected contents of an image file: RGBA of this size; in a pack, this number of views of each of these appearances."""

    height: int
    width: int
    views: int = 1
    packed: tuple[str, ...] = ()


def file_problem(root: Path, name: str, expected: ExpectedImage | None = None, *, decode: bool = True) -> str | None:
    """The problem of the file `name` of the database `root`, or None.

    Images are decoded whole and compared with `expected`, where given; without `decode` they only have to exist.
    """
    path = root / name
    if not path.is_file():
        kind = durable.special(path)
        return f"is {kind}, not a regular file" if kind else "is missing"
    if not path.resolve().is_relative_to(root.resolve()):
        return "is a link that leaves the database"
    if not decode:
        return None
    try:
        if expected is not None and expected.packed:
            pack = open_pack(path, expected.views * len(expected.packed), expected.height, expected.width)
            return pack_problem(pack, expected.packed)
        shape = _read_shape(path)
    except (PngError, PackError, ImageError, OSError) as error:
        return f"is damaged: {error}"
    if shape is None:
        return None if path.stat().st_size else "is empty"
    if expected is not None and shape != (expected.height, expected.width, 4):
        return f"is {_size(*shape)}; its camera makes {_size(expected.height, expected.width, 4)}"
    return None


def summary_problem(member: Member, plan: CatalogPlan) -> str | None:
    """The problem of a member's summary file, or None: it is damaged, or has other fields than the member's appearances."""
    try:
        summaries = member.summaries()
    except ValueError as error:
        return str(error)
    shown = shown_fields(a for a in plan.appearances if a.name in set(member.appearances))
    if not summaries or len(plan.fields) < 2 or set(summaries) == set(shown):
        return None
    return f"{SUMMARY} is of the fields {list(summaries)}, the images of {list(shown)}"


def rows_problem(member: Member, plan: CatalogPlan) -> str | None:
    """The problem of a member's file of rows, or None: it is missing, or differs from the member's record."""
    try:
        rows = durable.read(member.path / ROWS)
    except FileNotFoundError:
        return f"{ROWS} is missing"
    except OSError as error:
        return str(error)
    return None if rows == derived_rows(member, plan) else f"{ROWS} differs from what member.json and the plan make"


def images_of(catalog: Catalog, member: Member) -> Iterator[tuple[str, ExpectedImage]]:
    """A member's image files in the order of its rows: names relative to the catalog, and their expected contents."""
    if catalog.plan.packed:
        camera = member.cameras[0]
        image = ExpectedImage(camera.height, camera.width, len(member.cameras), member.appearances)
        yield f"{MEMBERS}/{member.name}/{PACK}", image
        return
    for appearance in member.appearances:
        for view, camera in enumerate(member.cameras):
            name = f"{MEMBERS}/{member.name}/{catalog.plan.image_name(appearance, view)}"
            yield name, ExpectedImage(camera.height, camera.width)


def lasting_problems(catalog: Catalog, folder: Path) -> Iterator[str]:
    """Problems of the member in `folder` that only rendering it again can solve."""
    try:
        member = read_record(folder, catalog.plan)
    except (CatalogError, OSError) as error:
        yield str(error)
        return
    if problem := summary_problem(member, catalog.plan):
        yield problem
    for name, image in images_of(catalog, member):
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
