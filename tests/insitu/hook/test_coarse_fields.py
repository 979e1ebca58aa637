"""The hook keeps the fields that are shown with few samples, unless it is not to, on every way into a catalog."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import insitu
from catalogs.files.digests import digest_of_file
from catalogs.store.catalog import Catalog
from catalogs.store.members import COARSE, read_member
from catalogs.store.sizes import Sizes
from catalogs.tools.check import check
from catalogs.vocabulary.appearance import Isosurface, VolumeRendering
from catalogs.vocabulary.scene import ViewPlan
from tests.support.hooked import FUNCTION, SPACING, blob, render, speed, tree

HALF_STEP = 0.5001 / 65534.0  # of the range


def near(values: Any, stored: Any) -> bool:
    return bool(np.abs(values - stored).max() <= HALF_STEP * (values.max() - values.min()))


def test_a_member_keeps_its_field(catalog: Path) -> None:
    (member,) = Catalog.open(catalog).members
    field = member.coarse_field()
    assert field is not None
    assert (field.whole, field.spacing, field.origin) == (True, SPACING, (0.0, 0.0, 0.0))
    assert near(blob(), field.values)
    assert list(member.coarse_fields()) == [""]
    assert member.coarse_field("any") is not None
    _, digests = read_member(member.path, Catalog.open(catalog).plan)
    assert digests.files[COARSE] == digest_of_file(member.path / COARSE)
    assert check(catalog) == []


def test_a_large_field_is_averaged_over_the_same_box(tmp_path: Path) -> None:
    result = render(tmp_path / "a.cdb", blob(size=80))
    (member,) = Catalog.open(tmp_path / "a.cdb").members
    field = member.coarse_field()
    assert field is not None
    assert not field.whole
    assert field.values.shape == (64, 64, 64)
    np.testing.assert_allclose(np.array(field.spacing) * 63, np.array(SPACING) * 79)
    assert np.abs(field.values - blob(size=64)).max() < 0.002
    assert (result.path / COARSE).stat().st_size <= 300_000


def test_every_field_that_is_shown_is_kept(tmp_path: Path) -> None:
    looks = [VolumeRendering("dvr", FUNCTION, field="q"), Isosurface("surface", 4.0, field="speed")]
    fields = {"q": blob(), "speed": speed()}
    render(tmp_path / "a.cdb", fields, appearances=looks)
    with insitu.Session(tmp_path / "a.cdb") as session:
        session.render_member(fields, {"Re": 120.0}, spacing=SPACING, appearances=["surface"])
    one, both = Catalog.open(tmp_path / "a.cdb").members
    assert (list(one.coarse_fields()), list(both.coarse_fields())) == (["speed"], ["q", "speed"])
    assert (one.coarse_names(), both.coarse_names()) == (("speed",), ("q", "speed"))
    for name, values in fields.items():
        field = both.coarse_field(name)
        assert field is not None
        assert near(values, field.values)
    assert one.coarse_field("q") is None
    assert check(tmp_path / "a.cdb") == []


def test_holes_are_kept(tmp_path: Path) -> None:
    values = blob()
    values[:4, :3, 2:] = np.nan
    result = render(tmp_path / "a.cdb", values, nan="transparent")
    (member,) = Catalog.open(tmp_path / "a.cdb").members
    assert result.path == member.path
    field = member.coarse_field()
    assert field is not None
    assert np.array_equal(np.isnan(field.values), np.isnan(values))


def test_none_is_kept_where_none_is_wanted_and_all_else_is_the_same(tmp_path: Path) -> None:
    render(tmp_path / "a.cdb")
    render(tmp_path / "b.cdb", coarse_field=False)
    (member,) = Catalog.open(tmp_path / "b.cdb").members
    assert member.coarse_fields() == {}
    assert member.coarse_names() == ()
    assert member.coarse_field() is None
    assert check(tmp_path / "b.cdb") == []
    one, other = tree(tmp_path / "a.cdb"), tree(tmp_path / "b.cdb")
    differing = {name.rpartition("/")[2] for name in one if one[name] != other.get(name)}
    assert differing == {COARSE, "member.json"}
    assert other.keys() == {name for name in one if not name.endswith(COARSE)}


@pytest.mark.parametrize("background", [False, True])
@pytest.mark.parametrize("wanted", [False, True])
def test_sessions_keep_them_in_the_loop_and_behind_it(tmp_path: Path, background: bool, wanted: bool) -> None:
    with insitu.Session(
        tmp_path / "a.cdb",
        space={"Re": (100.0, 200.0)},
        appearances=VolumeRendering("dvr", FUNCTION),
        views=ViewPlan(frequency=1, width=24, height=24),
        sample_distance=0.05,
        background=background,
        coarse_field=wanted,
    ) as session:
        session.render_member(blob(), {"Re": 110.0}, spacing=SPACING)
    (member,) = Catalog.open(tmp_path / "a.cdb").members
    assert bool(member.coarse_fields()) == wanted


def test_the_result_says_what_is_stored_and_what_may_be_spared(tmp_path: Path) -> None:
    few = render(tmp_path / "a.cdb")
    images = sum(path.stat().st_size for path in few.path.rglob("*.png"))
    assert few.sizes == Sizes(images, (few.path / COARSE).stat().st_size, 12, True)
    assert f"  {few.sizes}" in str(few).splitlines()
    assert "fewer" not in str(few)
    many = render(tmp_path / "b.cdb", views=ViewPlan(frequency=3, width=24, height=24))
    assert "the fields are kept whole: fewer than 92 views may do" in str(many)
    large = render(tmp_path / "c.cdb", blob(size=70), views=ViewPlan(frequency=3, width=8, height=8))
    assert "fewer" not in str(large)
