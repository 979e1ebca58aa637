"""Points of the members' summaries come with their members, values and kinds."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest

from catalogs.store.catalog import Catalog, CatalogPlan
from catalogs.store.summary import FieldSummary
from catalogs.vocabulary.appearance import Appearance, Isosurface
from catalogs.vocabulary.parameters import Parameter, ParameterSpace
from surrogate.gaussians import Normalization
from surrogate.initialization.field_points import FieldPoints, field_points
from tests.support.blobs import Blobs

SPACE = ParameterSpace((Parameter("Re", 100.0, 300.0), Parameter("nu", 1e-4, 1e-2, scale="log")))
BOUNDS = ((0.0, 0.0, 0.0), (4.0, 2.0, 2.0))
MEMBERS = {
    "a": ("train", 100.0, 1e-4),
    "b": ("test", 200.0, 1e-3),
    "c": ("train", 300.0, 1e-2),
    "d": ("validation", 250.0, 1e-3),
}


def summary(points: int, even: int, value: float) -> FieldSummary:
    """Points at x = `value`, even ones at x = `value` + 0.25, with these values."""
    places, more = np.ones((points, 3), np.float32), np.ones((even, 3), np.float32)
    places[:, 0], more[:, 0] = value, value + 0.25
    edges = np.linspace(0.0, 1.0, 257)
    zeros, opacities = np.zeros(256, np.int64), np.ones(points, np.float32)
    return FieldSummary(
        0.0, 1.0, 0.0, zeros, edges, places, places[:, 0], opacities, more, more[:, 0].astype(np.float64)
    )


def catalog_of(path: Path, kept: dict[str, dict[str, FieldSummary]], fields: Sequence[str] = ("",)) -> Catalog:
    """The members with these summaries; others have none."""
    shown: list[Appearance] = [Isosurface(f"iso-{n}", 0.5, field=name) for n, name in enumerate(fields)]
    plan = CatalogPlan(SPACE, tuple(shown), Blobs(size=8).cameras()[:1], ("train",), BOUNDS)
    catalog = Catalog.create(path / "points.cdb", plan)
    for name, (split, re, nu) in MEMBERS.items():
        with catalog.begin_member(name, {"Re": re, "nu": nu}, split=split) as writer:
            for appearance in shown:
                writer.write_image(appearance.name, 0, np.zeros((8, 8, 4), np.uint8))
            if name in kept:
                writer.write_summaries(kept[name])
    return Catalog.open(path / "points.cdb")


def gathered(catalog: Catalog, field: str = "", **changes: object) -> FieldPoints:
    return field_points(catalog, field, Normalization.of_box(BOUNDS), SPACE, **changes)  # type: ignore[arg-type]


def test_points_know_their_member_value_and_kind(tmp_path: Path) -> None:
    catalog = catalog_of(tmp_path, {name: {"": summary(3, 2, number)} for number, name in enumerate(MEMBERS)})
    points = gathered(catalog)
    assert points.names == ("a", "c")
    np.testing.assert_allclose(points.parameters, [[-1.0, -1.0], [1.0, 1.0]])
    assert points.members.tolist() == [0] * 5 + [1] * 5
    assert points.evenly.tolist() == [False, False, False, True, True] * 2
    assert points.values.tolist() == [0.0, 0.0, 0.0, 0.25, 0.25, 2.0, 2.0, 2.0, 2.25, 2.25]
    np.testing.assert_allclose(points.places[:, 0], (points.values - 2.0) / 2.0)
    np.testing.assert_allclose(points.places[:, 1:], 0.0)
    types = (points.places.dtype, points.values.dtype, points.parameters.dtype, points.members.dtype)
    assert types == (np.float32, np.float64, np.float32, np.int64)
    assert repr(points) == "<FieldPoints: 10 of 2 members, 4 of them evenly>"
    others = gathered(catalog, splits=("validation", "test"))
    assert others.names == ("b", "d")


def test_members_without_points_are_left_out(tmp_path: Path) -> None:
    catalog = catalog_of(tmp_path, {"a": {"": summary(0, 0, 1.0)}, "c": {"": summary(4, 0, 1.0)}})
    points = gathered(catalog)
    assert (points.names, len(points), points.evenly.any()) == (("c",), 4, False)
    none = gathered(catalog, splits=("test",))
    assert (none.parameters.shape, none.places.shape, len(none)) == ((0, 2), (0, 3), 0)
    assert none.evenly.dtype == bool


def test_each_field_has_its_own(tmp_path: Path) -> None:
    kept = {"a": {"q": summary(2, 1, 0.0), "speed": summary(1, 3, 1.0)}, "c": {"speed": summary(1, 1, 2.0)}}
    catalog = catalog_of(tmp_path, kept, fields=("q", "speed"))
    assert (gathered(catalog, "q").names, len(gathered(catalog, "q"))) == (("a",), 3)
    assert gathered(catalog, "speed").values.tolist() == [1.0, 1.25, 1.25, 1.25, 2.0, 2.25]


@pytest.mark.parametrize(
    ("field", "splits", "message"),
    [
        ("pressure", ("train",), r"points\.cdb shows q, speed, and no field 'pressure'"),
        ("q", ("training",), "splits must be some of train, validation, test, got training"),
        ("q", (), "got none"),
    ],
)
def test_what_is_none_is_named(tmp_path: Path, field: str, splits: tuple[str, ...], message: str) -> None:
    catalog = catalog_of(tmp_path, {}, fields=("q", "speed"))
    with pytest.raises(ValueError, match=message):
        gathered(catalog, field, splits=splits)


@pytest.mark.parametrize(
    ("points", "even", "asked", "expected"),
    [(30, 20, 0.3, 0.3), (30, 20, 0.0, 0.0), (30, 20, 1.0, 1.0), (5, 0, 0.5, 0.0), (0, 5, 0.5, 1.0)],
)
def test_points_are_drawn_of_one_member_in_the_share_asked_for(
    tmp_path: Path, points: int, even: int, asked: float, expected: float
) -> None:
    catalog = catalog_of(tmp_path, {name: {"": summary(points, even, number)} for number, name in enumerate("ac")})
    known = gathered(catalog)
    drawn = known.sample(1, 4000, np.random.default_rng(0), even_share=asked)
    assert (known.members[drawn] == 1).all()
    assert known.evenly[drawn].mean() == pytest.approx(expected, abs=0.05)
    assert len(np.unique(drawn)) == points * (expected < 1.0) + even * (expected > 0.0)
    with pytest.raises(IndexError, match="row 2"):
        known.sample(2, 1, np.random.default_rng(0))
