"""The figure of an ensemble's members: each where it lies, and nothing drawn of what can't be."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from catalogs.store.catalog import Catalog
from catalogs.store.plan import CatalogPlan
from catalogs.vocabulary.appearance import Isosurface
from catalogs.vocabulary.cameras import orbit, view_splits
from catalogs.vocabulary.parameters import Parameter, ParameterSpace
from research.benchmarks.training.members import draw

COLORS = {(1.0, 0.0): (255, 0, 0), (1.0, 2.0): (0, 0, 255), (3.0, 1.0): (0, 255, 0)}  # by (Re, time)


def catalog(path: Path, *names: str) -> Catalog:
    space = ParameterSpace(tuple(Parameter(name, 0.0, 4.0) for name in names))
    cameras = tuple(orbit((0.0, 0.0, 0.0), 1.0, frequency=1, width=8, height=8))
    plan = CatalogPlan(space, (Isosurface("iso", 0.5),), cameras, tuple(view_splits(12)), ((-1,) * 3, (1,) * 3))
    made = Catalog.create(path, plan)
    for (low, high), color in COLORS.items():
        parameters = dict(zip(names, (low, high), strict=False))
        if len(names) == 1:
            parameters = {names[0]: low + high}
        with made.begin_member(f"m{low:g}{high:g}", parameters) as writer:
            for view in range(12):
                writer.write_image("iso", view, np.full((8, 8, 4), (*color, 255), dtype=np.uint8))
    return made


def test_members_stand_where_they_lie(tmp_path: Path) -> None:
    draw(catalog(tmp_path / "a.cdb", "Re", "time"), 3, tmp_path / "a.png")
    pixels = np.asarray(Image.open(tmp_path / "a.png").convert("RGB"))
    places = {color: np.argwhere((pixels == color).all(axis=-1)).mean(axis=0) for color in COLORS.values()}
    red, blue, green = (places[color] for color in COLORS.values())
    assert red[0] == pytest.approx(blue[0], abs=1), "the same Re is the same height"
    assert green[0] < red[0], "a larger Re stands higher"
    assert red[1] < green[1] < blue[1], "time goes to the right"


def test_what_cannot_be_drawn_is_named(tmp_path: Path) -> None:
    made = catalog(tmp_path / "a.cdb", "Re", "time")
    with pytest.raises(ValueError, match="views 0 to 11, got 12"):
        draw(made, 12, tmp_path / "a.png")
    with pytest.raises(ValueError, match="two parameters are drawn"):
        draw(catalog(tmp_path / "b.cdb", "Re"), 0, tmp_path / "a.png")
    assert not (tmp_path / "a.png").exists()
