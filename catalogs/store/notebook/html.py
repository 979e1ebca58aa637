"""Notebook card of a catalog: facts and a contact sheet."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from catalogs.store.members import Member, read_record
from catalogs.store.missing import MissingMember, missing_members
from catalogs.store.notebook.cards import WHITE, CardImage, card, never_failing, on_background
from catalogs.store.notebook.facts import facts
from catalogs.store.pictures import read_picture
from catalogs.store.plan import CatalogError, CatalogPlan
from catalogs.vocabulary.cameras import OBLIQUE, Camera

IMAGES = 6  # on a contact sheet
CAPTIONED = 3  # parameters that fit below an image; with more, the caption is the member's name


def catalog_html(path: Path, plan: CatalogPlan, folders: Callable[[], Sequence[Path]]) -> str:
    """The card of the catalog at `path`, whose members are `folders()`: its facts and a contact sheet; never raises."""
    heading = f"Catalog {path}"
    return never_failing(heading, lambda: _catalog_card(heading, plan, folders(), missing_members(path)))


def _catalog_card(heading: str, plan: CatalogPlan, folders: Sequence[Path], missing: Sequence[MissingMember]) -> str:
    members, problems = _readable(plan, folders)
    rows = facts(plan, members) if members or not problems else []
    images, failures = _contact_sheet(plan, members)
    rows += [("missing", str(member)) for member in missing]
    return card(heading, rows, images, [*problems, *failures])


def _readable(plan: CatalogPlan, folders: Sequence[Path]) -> tuple[list[Member], list[str]]:
    """The readable members, and a sentence about the others."""
    members, errors = list[Member](), list[Exception]()
    for folder in folders:
        try:
            members.append(read_record(folder, plan))
        except (CatalogError, OSError) as error:
            errors.append(error)
    count = f"{len(errors)} member{'s' if len(errors) > 1 else ''}"
    return members, [f"{count} can't be read: {errors[0]}"] if errors else []


def _contact_sheet(plan: CatalogPlan, members: Sequence[Member]) -> tuple[list[CardImage], list[str]]:
    """First appearance of members from the lowest to the highest parameters, from about the same direction; and failures."""
    ordered = sorted(members, key=lambda member: tuple(member.parameters.values()))
    places = np.linspace(0, len(ordered) - 1, min(IMAGES, len(ordered))).round().astype(int)
    images, failures = list[CardImage](), list[str]()
    for member in (ordered[place] for place in places):
        view = first_view(member.cameras, np.mean(plan.bounds, axis=0))
        appearance = member.appearances[0]
        try:
            rgba = read_picture(member, plan, appearance, view)
        except (ValueError, OSError) as error:
            failures.append(str(error))
            continue
        values = ", ".join(f"{name} {value:g}" for name, value in member.parameters.items())
        caption = values if 0 < len(member.parameters) <= CAPTIONED else member.name
        title = f"{member.name} ({member.split}), {appearance}, view {view}: {values}"
        images.append(CardImage(on_background(rgba, plan.background or WHITE), caption, title))
    return images, failures


def first_view(cameras: Sequence[Camera], center: NDArray[np.float64]) -> int:
    """Number of the camera closest to the direction `OBLIQUE` from `center` (3,)."""
    offsets = np.array([camera.position for camera in cameras]) - center  # [V, 3]
    lengths = np.maximum(np.linalg.norm(offsets, axis=1), np.finfo(np.float64).tiny)
    return int(np.argmax(offsets @ np.asarray(OBLIQUE) / lengths))
