"""An appearance that another package adds, from the hook to the catalog and back."""

from __future__ import annotations

import importlib
import json
import sys
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import insitu
from catalogs import Catalog
from catalogs.store.plan import CatalogError
from catalogs.tools.check import check
from catalogs.vocabulary.appearance import appearance_from_json, appearance_to_json
from catalogs.vocabulary.plugin_appearance import MissingAppearance
from render import render_views
from tests.support.documented import documented_code
from tests.support.foreign_packages import install

SOURCE = '''
from dataclasses import dataclass
import numpy as np

@dataclass(frozen=True)
class Slice:
    """The middle of the field along z, in gray, the same from everywhere."""
    name: str
    levels: tuple[float, float]
    field: str = ""

    def __post_init__(self):
        if len(self.levels) != 2:
            raise ValueError("levels must be two numbers")
        object.__setattr__(self, "levels", tuple(map(float, self.levels)))

    def pictures(self, grid, cameras, *, float_output):
        low, high = self.levels
        gray = np.clip((grid.values[len(grid.values) // 2] - low) / (high - low), 0.0, 1.0)
        for camera in cameras:
            rows, columns = (np.arange(n) * m // n for n, m in zip((camera.height, camera.width), gray.shape))
            picture = np.repeat(gray[np.ix_(rows, columns)][..., None], 4, axis=2)
            yield picture.astype(np.float32) if float_output else np.rint(255 * picture).astype(np.uint8)

class Stray(Slice):
    """One that is not registered."""

@dataclass(frozen=True)
class Wrong(Slice):
    def pictures(self, grid, cameras, *, float_output):
        return [np.zeros((2, 2, 4), np.uint8) for _ in cameras]
'''
FIELD = np.linspace(0.0, 1.0, 8**3).reshape(8, 8, 8)
VIEWS = insitu.ViewPlan(1, 16, 16)
SURFACE = insitu.Isosurface("surface", 0.5)
MISSING = "appearance 'middle' is of kind 'slice', which no installed package has: install the one that has it"


@pytest.fixture
def stranger(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Any]:
    """The module of an installed package that adds the kinds "slice" and "wrong"."""
    folder = tmp_path / "packages"
    folder.mkdir()
    kinds = {"slice": "stranger_kinds:Slice", "wrong": "stranger_kinds:Wrong"}
    install(folder, "stranger_kinds", {"gs_surrogate.appearances": kinds}, SOURCE)
    monkeypatch.syspath_prepend(str(folder))
    import stranger_kinds  # type: ignore[import-not-found]

    yield stranger_kinds
    sys.modules.pop("stranger_kinds")


@pytest.fixture
def rendered(stranger: Any, tmp_path: Path) -> Path:
    """A catalog of one member, shown by its appearance and by one of ours."""
    middle = stranger.Slice("middle", (0.0, 1.0))
    with insitu.Session(tmp_path / "a.cdb", space={"a": (0, 1)}, appearances=[middle, SURFACE], views=VIEWS) as session:
        session.render_member(FIELD, {"a": 0.5}, spacing=(1, 1, 1))
    return tmp_path / "a.cdb"


def test_its_pictures_are_in_the_catalog(stranger: Any, rendered: Path) -> None:
    catalog = Catalog.open(rendered)
    assert check(rendered) == []
    assert catalog.plan.appearances == (stranger.Slice("middle", (0.0, 1.0)), SURFACE)
    picture = catalog.image(catalog.members[0], "middle", 3)
    assert picture.shape == (16, 16, 4)
    np.testing.assert_allclose(picture[8, :, 0], 255 * np.repeat(FIELD[4, 4], 2), atol=1)
    assert "middle: slice" in catalog._repr_html_()


def test_another_process_renders_it_too(stranger: Any, tmp_path: Path) -> None:
    middle = stranger.Slice("middle", (0.0, 1.0))
    with insitu.Session(
        tmp_path / "b.cdb", space={"a": (0, 1)}, appearances=middle, views=VIEWS, background=True
    ) as session:
        session.render_member(FIELD, {"a": 0.5}, spacing=(1, 1, 1))
    assert session.failures == {}
    catalog = Catalog.open(tmp_path / "b.cdb")
    assert catalog.image(catalog.members[0], "middle", 3).any()


def test_without_its_package_the_other_appearances_remain(rendered: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.undo()
    catalog = Catalog.open(rendered)
    missing = catalog.plan.appearances[0]
    assert isinstance(missing, MissingAppearance)
    assert (missing.name, missing.kind, missing.field) == ("middle", "slice", "")
    assert appearance_to_json(missing) == json.loads((rendered / "catalog.json").read_text())["appearances"][0]
    assert catalog.image(catalog.members[0], "middle", 3).any()
    assert check(rendered) == []
    with insitu.Session(rendered) as session:
        with pytest.raises(ValueError, match=MISSING):
            session.render_member(FIELD, {"a": 0.7}, spacing=(1, 1, 1))
        session.render_member(FIELD, {"a": 0.7}, spacing=(1, 1, 1), appearances=["surface"])
    assert len(Catalog.open(rendered).members) == 2
    with pytest.raises(ValueError, match=MISSING):
        insitu.Session(rendered, appearances=catalog.plan.appearances)
    with pytest.raises(ValueError, match=r"appearance kind must be one of .*, got 'slice'"):
        appearance_from_json(appearance_to_json(missing))


def test_a_class_that_is_not_registered_is_refused_before_anything_is_written(stranger: Any, tmp_path: Path) -> None:
    stray = stranger.Stray("stray", (0.0, 1.0))
    with (
        pytest.raises((ValueError, CatalogError), match="no installed package registers Stray as an entry point"),
        insitu.Session(tmp_path / "c.cdb", space={"a": (0, 1)}, appearances=stray, views=VIEWS) as session,
    ):
        session.render_member(FIELD, {"a": 0.5}, spacing=(1, 1, 1))
    assert not (tmp_path / "c.cdb").exists()


def test_pictures_of_another_size_are_refused(stranger: Any, tmp_path: Path) -> None:
    from render import to_grid

    cameras = VIEWS.cameras((0.0, 0.0, 0.0), 1.0)
    with pytest.raises(ValueError, match=r"'bad' drew a picture \(2, 2, 4\) of uint8, where \(16, 16, 4\) of float32"):
        list(render_views(to_grid(FIELD, spacing=(1, 1, 1)), stranger.Wrong("bad", (0, 1)), cameras, float_output=True))


def test_a_wrong_argument_is_named_with_the_appearance(stranger: Any) -> None:
    with pytest.raises(ValueError, match="appearance 'x' of kind 'slice': levels must be two numbers"):
        appearance_from_json({"kind": "slice", "name": "x", "levels": [1]})


def test_the_documented_appearance_renders(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    module, project = documented_code("docs/how-to/extend.md", "An appearance of your own")
    install(tmp_path, "my_package", tomllib.loads(project)["project"]["entry-points"], module)
    monkeypatch.syspath_prepend(str(tmp_path))
    monkeypatch.delitem(sys.modules, "my_package", raising=False)
    appearance = importlib.import_module("my_package").Slice("middle", 0.0, 1.0)
    with insitu.Session(tmp_path / "a.cdb", space={"a": (0, 1)}, appearances=appearance, views=VIEWS) as session:
        session.render_member(FIELD, {"a": 0.5}, spacing=(1, 1, 1))
    catalog = Catalog.open(tmp_path / "a.cdb")
    assert catalog.plan.appearances == (appearance,)
    np.testing.assert_allclose(
        catalog.image(catalog.members[0], "middle", 3)[8, :, 0], 255 * np.repeat(FIELD[4, 4], 2), atol=1
    )
