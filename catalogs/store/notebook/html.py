"""What notebooks show of a catalog: what it holds, in words, and a contact sheet."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from catalogs.store.members import Member, read_record
from catalogs.store.missing import MissingMember, missing_members
from catalogs.store.notebook.cards import WHITE, Picture, card, never_failing, on_background
from catalogs.store.notebook.facts import facts, megabytes
from catalogs.store.pictures import read_picture
from catalogs.store.plan import CatalogError, CatalogPlan
from catalogs.vocabulary.cameras import OBLIQUE, Camera

PICTURES = 6  # on a contact sheet
READING_SECONDS = 0.15  # for pictures; the rest is left out
COUNTING_SECONDS = 0.05  # for sizes of files; the rest is estimated
CAPTIONED = 3  # parameters that have room below a picture; of more, only the name of the member


def catalog_html(path: Path, plan: CatalogPlan, folders: Callable[[], Sequence[Path]]) -> str:
    """The card of the catalog at `path`, whose members are `folders()`: its facts and a contact sheet; never raises."""
    heading = f"Catalog {path}"
    return never_failing(heading, lambda: _catalog_card(heading, plan, folders(), missing_members(path)))


def _catalog_card(heading: str, plan: CatalogPlan, folders: Sequence[Path], missing: Sequence[MissingMember]) -> str:
    members, problems = _readable(plan, folders)
    known = members or not problems  # else the plan alone would say that there are no members yet
    rows = [*facts(plan, members), ("on disk", _size(members))] if known else []
    pictures, failures = _contact_sheet(plan, members)
    rows += [("missing", str(member)) for member in missing]
    return card(heading, rows, pictures, [*problems, *failures])


def _readable(plan: CatalogPlan, folders: Sequence[Path]) -> tuple[list[Member], list[str]]:
    """The members that can be read, and a sentence about the others."""
    members, errors = list[Member](), list[Exception]()
    for folder in folders:
        try:
            members.append(read_record(folder, plan))
        except (CatalogError, OSError) as error:
            errors.append(error)
    count = f"{len(errors)} member{'s' if len(errors) > 1 else ''}"
    return members, [f"{count} can't be read: {errors[0]}"] if errors else []


def _contact_sheet(plan: CatalogPlan, members: Sequence[Member]) -> tuple[list[Picture], list[str]]:
    """Members from the lowest to the highest parameters in their first appearance, all from about the same direction."""
    ordered = sorted(members, key=lambda member: tuple(member.parameters.values()))
    places = np.linspace(0, len(ordered) - 1, min(PICTURES, len(ordered))).round().astype(int)
    pictures, failures, until = list[Picture](), list[str](), math.inf
    for member in (ordered[place] for place in places):
        if time.perf_counter() > until:
            break
        view = first_view(member.cameras, np.mean(plan.bounds, axis=0))
        appearance = member.appearances[0]
        try:
            rgba = read_picture(member, plan, appearance, view)
        except (ValueError, OSError) as error:
            failures.append(str(error))
            continue
        until = min(until, time.perf_counter() + READING_SECONDS)  # the first may have to load the library
        values = ", ".join(f"{name} {value:g}" for name, value in member.parameters.items())
        caption = values if 0 < len(member.parameters) <= CAPTIONED else member.name
        title = f"{member.name} ({member.split}), {appearance}, view {view}: {values}"
        pictures.append(Picture(on_background(rgba, plan.background or WHITE), caption, title))
    return pictures, failures


def first_view(cameras: Sequence[Camera], center: NDArray[np.float64]) -> int:
    """Which of the cameras stands closest to `OBLIQUE` as seen from `center` (3,)."""
    offsets = np.array([camera.position for camera in cameras]) - center  # [V, 3]
    lengths = np.maximum(np.linalg.norm(offsets, axis=1), np.finfo(np.float64).tiny)
    return int(np.argmax(offsets @ np.asarray(OBLIQUE) / lengths))


def _size(members: Sequence[Member]) -> str:
    """How much the members take on disk, in words; estimated from some of them where there are many files."""
    until = time.perf_counter() + COUNTING_SECONDS
    sizes = list[float]()
    for place in np.random.default_rng(0).permutation(len(members)):
        sizes.append(megabytes(members[place].path))
        if time.perf_counter() > until:
            break
    if len(sizes) < len(members):
        return f"about {np.mean(sizes) * len(members):,.0f} MB"
    return f"{sum(sizes):,.1f} MB"
