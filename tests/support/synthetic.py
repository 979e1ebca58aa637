"""Catalogs of very many pictures, made in a moment."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np

from catalogs.files.images import write_image
from catalogs.store.catalog import Catalog, CatalogPlan
from catalogs.store.members import Member, write_record
from catalogs.vocabulary.appearance import ImportedImages
from catalogs.vocabulary.cameras import orbit, view_splits
from catalogs.vocabulary.parameters import Parameter, ParameterSpace

SIZE = 32


def synthetic_catalog(folder: Path, *, members: int, views: int, parameters: int = 6) -> Catalog:
    """A catalog whose pictures are all one file; its table is left empty, for the page does not read it."""
    space = ParameterSpace(tuple(Parameter(f"p{i}", 0.0, 1.0) for i in range(parameters)))
    cameras = orbit((0.0, 0.0, 0.0), 1.0, width=SIZE, height=SIZE, frequency=5)[:views]
    plan = CatalogPlan(
        space=space,
        appearances=(ImportedImages("pictures"),),
        cameras=tuple(cameras),
        view_splits=tuple(view_splits(252)[:views]),
        bounds=((-1.0, -1.0, -1.0), (1.0, 1.0, 1.0)),
    )
    catalog = Catalog.create(folder, plan)
    random = np.random.default_rng(0)
    picture = folder.parent / f"{folder.stem}.png"
    write_image(picture, np.full((SIZE, SIZE, 4), 200, np.uint8))
    for number, values in enumerate(random.random((members, parameters))):
        member = Member(
            name=f"m{number:06d}",
            parameters=dict(zip(space.names, values.tolist(), strict=True)),
            split=("train", "train", "train", "validation", "test")[number % 5],
            cameras=plan.cameras,
            view_splits=plan.view_splits,
            path=folder / "members" / f"m{number:06d}",
            appearances=("pictures",),
        )
        (member.path / "pictures").mkdir(parents=True)
        for view in range(views):
            _link(picture, member.path / plan.image_name("pictures", view))
        write_record(member, plan)
    return catalog


def _link(picture: Path, path: Path) -> None:
    try:
        os.link(picture, path)
    except OSError:  # a file may not have as many names as there are members
        path.write_bytes(picture.read_bytes())
