"""A catalog in a notebook: facts, a contact sheet, and never an exception."""

from __future__ import annotations

import math
import shutil
import time
from pathlib import Path

import numpy as np
import pytest

from catalogs.store.catalog import Catalog
from catalogs.store.notebook.facts import facts
from catalogs.store.notebook.html import first_view
from catalogs.vocabulary.cameras import OBLIQUE, orbit
from catalogs.vocabulary.parameters import Parameter, ParameterSpace
from tests.catalogs.conftest import add_member, make_plan, picture
from tests.support.cards import HOSTILE, Tags, images

CLOVERLEAF = Path(__file__).resolve().parents[4] / "runs" / "cloverleaf" / "catalog.cdb"


def test_a_catalog_says_what_it_holds(catalog: Catalog) -> None:
    shown = catalog._repr_html_()
    text = Tags(shown).text
    assert all(fact in text for _, fact in facts(catalog.plan, catalog.members))
    assert "2 (1 train, 0 validation, 1 test)" in text
    assert "Re 120, Pr 1" in text
    assert len(images(shown)) == 2


def test_members_are_spread_over_the_parameters(catalog: Catalog) -> None:
    for i in range(8):
        add_member(catalog, f"more-{i}", 190.0 - 8.0 * i, seed=3 + i)
    text = Tags(catalog._repr_html_()).text
    places = [text.index(f"Re {value}, Pr") for value in (120, 142, 158, 166, 180, 190)]
    assert places == sorted(places)
    assert text.count(", Pr 1") == 6


def test_an_empty_catalog_is_shown(tmp_path: Path) -> None:
    shown = Catalog.create(tmp_path / "a.cdb", make_plan())._repr_html_()
    assert "none yet" in Tags(shown).text
    assert images(shown) == []


def test_hostile_names_are_only_names(tmp_path: Path) -> None:
    folder = tmp_path / "<img src=x onerror=alert(1)>"
    folder.mkdir()
    space = ParameterSpace((Parameter("<b>'\"&", 0.0, 1.0, "<script>"),))
    made = Catalog.create(folder / "a.cdb", make_plan(space=space))
    with made.begin_member("only", {"<b>'\"&": 0.5}) as writer:
        for appearance, view in writer.missing():
            writer.write_image(appearance, view, picture(view))
    tags = Tags(made._repr_html_())
    assert {"script", "b"}.isdisjoint(tag for tag, _ in tags.seen)
    assert all("onerror" not in attributes for _, attributes in tags.seen)
    assert "<b>'\"& in [0, 1] <script>" in tags.text


def test_damaged_members_are_told_beside_whole_ones(catalog: Catalog) -> None:
    (catalog.path / "members/first/member.json").write_text("{")
    shown = catalog._repr_html_()
    assert "1 member can't be read" in Tags(shown).text
    assert "member.json is damaged" in Tags(shown).text
    assert len(images(shown)) == 1


def test_damaged_pictures_are_told(catalog: Catalog) -> None:
    for path in (catalog.path / "members/first/dvr").iterdir():
        path.write_bytes(b"no picture")
    shown = catalog._repr_html_()
    assert "dvr" in Tags(shown).text
    assert ".png" in Tags(shown).text
    assert len(images(shown)) == 1


def test_a_catalog_that_is_gone_does_not_raise(catalog: Catalog) -> None:
    shutil.rmtree(catalog.path)
    assert "none yet" in Tags(catalog._repr_html_()).text
    broken = Catalog(Path(HOSTILE), None)  # type: ignore[arg-type]
    assert "can't be shown" in Tags(broken._repr_html_()).text


def test_pictures_are_taken_from_one_side_whatever_the_cameras() -> None:
    center = np.array([5.0, -3.0, 2.0])
    cameras = orbit(center, 2.0, width=8, height=8, frequency=3)
    view = first_view(cameras, center)
    toward = cameras[view].position - center
    assert toward @ OBLIQUE / np.linalg.norm(toward) / np.linalg.norm(OBLIQUE) > math.cos(math.radians(20.0))
    assert first_view([cameras[view], *cameras], center) == 0


@pytest.mark.skipif(not CLOVERLEAF.is_dir(), reason="runs/cloverleaf has not been made here")
def test_a_catalog_of_30_000_pictures_is_shown_at_once() -> None:
    catalog, seconds = Catalog.open(CLOVERLEAF), []
    for _ in range(3):
        started = time.process_time()
        shown = catalog._repr_html_()
        seconds.append(time.process_time() - started)
    assert len(shown) < 62_000
    assert min(seconds) < 0.3
