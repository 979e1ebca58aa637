"""What notebooks show of a catalog: what it holds, in words, and a contact sheet."""

from __future__ import annotations

import math
import os
import time
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from catalogs.cameras import OBLIQUE, Camera
from catalogs.cards import WHITE, Picture, card, never_failing, on_background
from catalogs.catalog import Catalog, CatalogError
from catalogs.members import Member, read_record
from catalogs.show import facts

PICTURES = 6  # on a contact sheet
READING_SECONDS, COUNTING_SECONDS = (
    0.15,
    0.05,
)  # for pictures and sizes of files; what is left then is left out or estimated
CAPTIONED = 3  # parameters that have room below a picture; of more, only the name of the member


def catalog_html(catalog: Catalog) -> str:
    """The card of a catalog: its facts and a contact sheet; never raises."""
    return never_failing(f"Catalog {catalog.path}", lambda: _catalog_card(catalog))


def _catalog_card(catalog: Catalog) -> str:
    members, problems = _readable(catalog)
    known = members or not problems  # else the plan alone would say that there are no members yet
    rows = [*facts(catalog, members), ("on disk", _size(catalog, members))] if known else []
    pictures, failures = _contact_sheet(catalog, members)
    return card(f"Catalog {catalog.path}", rows, pictures, [*problems, *failures])


def _readable(catalog: Catalog) -> tuple[list[Member], list[str]]:
    """The members that can be read, and what is to be said of the others."""
    members, errors = list[Member](), list[Exception]()
    for path in catalog.member_paths():
        try:
            members.append(read_record(path, catalog.plan))
        except (CatalogError, OSError) as error:
            errors.append(error)
    count = f"{len(errors)} member{'s' if len(errors) > 1 else ''}"
    return members, [f"{count} can't be read: {errors[0]}"] if errors else []


def _contact_sheet(catalog: Catalog, members: Sequence[Member]) -> tuple[list[Picture], list[str]]:
    """Members from the lowest to the highest parameters in their first appearance, all from about the same direction."""
    inside = sorted(members, key=lambda member: tuple(member.parameters.values()))
    pictures, failures = list[Picture](), list[str]()
    until = math.inf
    for member in _spread(inside, PICTURES):
        if time.perf_counter() > until:
            break
        view = first_view(member.cameras, np.mean(catalog.plan.bounds, axis=0))
        appearance = member.appearances[0]
        try:
            rgb = on_background(catalog.image(member, appearance, view), catalog.plan.background or WHITE)
        except (ValueError, OSError) as error:
            failures.append(str(error))
            continue
        until = min(until, time.perf_counter() + READING_SECONDS)  # the first may have to load the library
        values = ", ".join(f"{name} {value:g}" for name, value in member.parameters.items())
        caption = values if 0 < len(member.parameters) <= CAPTIONED else member.name
        title = f"{member.name} ({member.split}), {appearance}, view {view}: {values}"
        pictures.append(Picture(rgb, caption, title))
    return pictures, failures


def first_view(cameras: Sequence[Camera], center: NDArray[np.float64]) -> int:
    """Which of the cameras stands closest to `OBLIQUE` as seen from `center` (3,)."""
    offsets = np.array([camera.position for camera in cameras]) - center  # [V, 3]
    lengths = np.maximum(np.linalg.norm(offsets, axis=1), np.finfo(np.float64).tiny)
    return int(np.argmax(offsets @ np.asarray(OBLIQUE) / lengths))


def _spread(members: Sequence[Member], most: int) -> list[Member]:
    """At most so many of them, evenly, the first and the last among them."""
    places = np.linspace(0, len(members) - 1, min(most, len(members))).round().astype(int)
    return [members[place] for place in places]


def _size(catalog: Catalog, members: Sequence[Member]) -> str:
    """How much the members take on disk, in words; estimated from some of them where there are many files."""
    until = time.perf_counter() + COUNTING_SECONDS
    sizes = list[int]()
    for place in np.random.default_rng(0).permutation(len(members)):
        sizes.append(sum(entry.stat().st_size for entry in _files(catalog.path / "members" / members[place].name)))
        if time.perf_counter() > until:
            break
    if len(sizes) < len(members):
        return f"about {np.mean(sizes) * len(members) / 1e6:,.0f} MB"
    return f"{sum(sizes) / 1e6:,.1f} MB"


def _files(folder: str | Path) -> Iterator[os.DirEntry[str]]:
    with os.scandir(folder) as entries:
        for entry in entries:
            if entry.is_dir(follow_symlinks=False):
                yield from _files(entry.path)
            else:
                yield entry
