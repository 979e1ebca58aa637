"""Export of a catalog's images and cameras in the file layouts of other programs."""

from __future__ import annotations

import os
import shutil
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from catalogs.exchange import colmap_text, transforms_text
from catalogs.exchange.records import ExchangeError
from catalogs.exchange.selection import SelectedImage, Selection
from catalogs.files import durable
from catalogs.files.images import write_image
from catalogs.store.catalog import Catalog, Member
from catalogs.vocabulary.words import shortened

Kind = Literal["colmap", "nerf"]
Progress = Callable[[int, int], None]
WRITERS = 4
BLACK = (0.0, 0.0, 0.0)


LAYOUTS = {"colmap": colmap_text, "nerf": transforms_text}  # each with `check`, `place` and `texts`


def export(
    catalog: Catalog,
    directory: str | os.PathLike[str],
    kind: Kind,
    *,
    appearance: str | None = None,
    members: Sequence[str] = (),
    background: Sequence[float] | None = None,
    progress: Progress = lambda done, total: None,
) -> Path:
    """Write images and cameras of a catalog into the new folder `directory`, which appears when it is complete.

    Parameters
    ----------
    kind : "nerf" or "colmap".  The first writes `transforms_{train,val,test}.json` of all members, as in D-NeRF.  The second writes
        a folder `<member>/` each with `images/` and `sparse/0/`, as the code of 3D Gaussian splatting reads it.
    appearance : the exported one; required if there are several.
    members : names; all by default.
    background : RGB in [0, 1] behind the images.  By default "nerf" keeps alpha, and "colmap" has black, since its readers
        disagree about alpha.
    progress : called with images done and in all.

    Raises ExchangeError, before anything is written, where the folder exists or the layout can't hold the selection;
    CatalogError for unknown members; ImageError for a damaged image, after which nothing remains.
    """
    directory = Path(directory)
    if directory.exists():
        raise ExchangeError(f"{directory} exists already: choose a new folder")
    if background is not None and catalog.plan.background is not None:
        raise ExchangeError(
            f"the images of {catalog.path} have the background {catalog.plan.background} already: omit background"
        )
    selected = _members(catalog, members)
    selection = Selection(catalog, selected, _appearance(catalog, selected, appearance))
    layout = LAYOUTS[kind]
    layout.check(selection)
    behind = BLACK if background is None and kind == "colmap" and catalog.plan.background is None else background
    partial = durable.partial_name(directory)
    durable.make_folder(directory.parent)
    partial.mkdir()
    try:
        for name, text in layout.texts(selection):
            (partial / name).parent.mkdir(parents=True, exist_ok=True)
            durable.write(partial / name, text.encode())
        _write_pictures(selection, partial, layout.place, behind, progress)
        durable.commit_folder(partial, directory)
    finally:
        shutil.rmtree(partial, ignore_errors=True)
    return directory


def over(rgba: NDArray[np.uint8], background: Sequence[float]) -> NDArray[np.uint8]:
    """Opaque 8-bit RGBA [H, W, 4]: premultiplied `rgba` over a colour in [0, 1], rounded to the nearest."""
    alpha = rgba[..., 3:].astype(np.float64) / 255.0  # [H, W, 1]
    colors = rgba[..., :3] + (1.0 - alpha) * 255.0 * np.asarray(background, dtype=np.float64)  # [H, W, 3]
    return np.concatenate([np.rint(colors).clip(0, 255), np.full_like(alpha, 255.0)], axis=2).astype(np.uint8)


def _write_pictures(
    selection: Selection,
    folder: Path,
    place: Callable[[SelectedImage], str],
    background: Sequence[float] | None,
    progress: Progress,
) -> None:
    def write(picture: SelectedImage) -> None:
        rgba = selection.catalog.image(picture.member, selection.appearance, picture.view)
        path = folder / place(picture)
        path.parent.mkdir(parents=True, exist_ok=True)
        write_image(path, rgba if background is None else over(rgba, background))

    total = sum(len(member.cameras) for member in selection.members)
    with ThreadPoolExecutor(WRITERS) as pool:
        for done, _ in enumerate(pool.map(write, selection.pictures()), 1):
            progress(done, total)


def _members(catalog: Catalog, names: Sequence[str]) -> tuple[Member, ...]:
    members = tuple(map(catalog.member, dict.fromkeys(names))) if names else catalog.members
    if not members:
        raise ExchangeError(f"{catalog.path} has no members yet")
    return members


def _appearance(catalog: Catalog, members: Sequence[Member], name: str | None) -> str:
    names = catalog.appearance_names
    if name is None and len(names) > 1:
        raise ExchangeError(f"{catalog.path} shows {shortened(names, 8)}: name the appearance to export")
    name = names[0] if name is None else name
    for member in members:
        if name not in member.appearances:
            raise ExchangeError(
                f"member {member.name} of {catalog.path} does not show {name!r}; it shows {shortened(member.appearances)}"
            )
    return name
