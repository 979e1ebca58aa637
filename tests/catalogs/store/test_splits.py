from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial import Delaunay

from catalogs.store.catalog import Catalog
from catalogs.store.members import Member
from catalogs.store.splits import Splits, _distance_to_hull, choose_splits, held_out
from catalogs.vocabulary.cameras import Camera
from catalogs.vocabulary.parameters import Parameter, ParameterSpace
from tests.support.blobs import Blobs
from tests.support.results import MEMBERS, make_catalog

CAMERA = Blobs().cameras()[0]
VIEWS = ("test", "train") * 40


def space_of(count: int) -> ParameterSpace:
    return ParameterSpace(tuple(Parameter(f"p{i}", -1.0, 1.0) for i in range(count)))


def members_at(places: NDArray[np.float64], splits: str = "", **more: object) -> list[Member]:
    """Members (M, P) whose split begins with the letter of `splits`; "t" all without."""
    named = {"t": "train", "v": "validation", "x": "test"}
    cameras: tuple[Camera, ...] = (CAMERA,) * len(VIEWS)
    return [
        Member(
            name=f"m{i}",
            parameters={f"p{k}": float(value) for k, value in enumerate(place)},
            split=named[(splits or "t" * len(places))[i]],
            cameras=cameras,
            view_splits=VIEWS,
            path=Path(f"m{i}"),
            **{"appearances": ("dvr",), **more},  # type: ignore[arg-type]
        )
        for i, place in enumerate(places)
    ]


def of_split(splits: Splits, split: str) -> list[int]:
    return [int(name[1:]) for name, found in splits.members.items() if found == split]


@pytest.mark.parametrize(("count", "parameters"), [(12, 1), (30, 2), (40, 3)])
def test_members_that_are_held_out_lie_within_the_others_and_among_all(count: int, parameters: int) -> None:
    places = np.random.default_rng(1).uniform(-1, 1, (count, parameters))
    members, space = members_at(places), space_of(parameters)
    splits = choose_splits(members, space, "dvr", hold_out=0.2, seed=3)
    test, validation, train = (of_split(splits, name) for name in ("test", "validation", "train"))
    assert (len(test), len(validation), splits.validation_views) == (
        round(0.2 * count),
        max(1, round(0.064 * count)),
        0,
    )
    assert len(test) + len(validation) + len(train) == count
    for i in test + validation:
        inside = (
            places[train].min() < places[i, 0] < places[train].max()
            if parameters == 1
            else Delaunay(places[train]).find_simplex(places[i]) >= 0
        )
        assert inside
    assert choose_splits(members, space, "dvr", hold_out=0.2, seed=3) == splits
    seeds = [of_split(choose_splits(members, space, "dvr", hold_out=0.2, seed=s), "test") for s in range(5)]
    assert len({tuple(found) for found in seeds}) > 1


def test_they_are_spread_out() -> None:
    places = np.linspace(-1.0, 1.0, 21)[:, None]
    for seed in range(5):
        test = held_out(places, 4, np.random.default_rng(seed))
        gaps = np.diff([0, *test, 20])
        assert gaps[1:-1].min() >= 3
        assert gaps.max() <= 9


def test_in_many_dimensions_the_most_surrounded_are_taken() -> None:
    places = np.random.default_rng(2).uniform(-1, 1, (60, 6))
    test = held_out(places, 5, np.random.default_rng(0))
    assert len(test) == 5
    centre = np.linalg.norm(places, axis=1)
    assert centre[test].mean() < np.delete(centre, test).mean()


@pytest.mark.parametrize(
    ("places", "count"),
    [
        (np.zeros((1, 1)), 0),
        (np.array([[-1.0], [1.0]]), 0),
        (np.array([[-1.0], [0.1], [1.0]]), 1),
        (np.array([[-1.0, -1], [-1, 1], [1, -1], [1, 1]]), 0),  # corners alone
        (np.array([[-1.0, -1], [-1, 1], [1, -1], [1, 1], [0, 0]]), 1),
        (np.stack([np.linspace(-1, 1, 5), np.full(5, 0.3)], axis=1), 2),  # a parameter that never changes
        (np.zeros((1, 0)), 0),
    ],
    ids=["one", "two", "three", "corners", "corners and middle", "a line", "no parameters"],
)
def test_few_members(places: NDArray[np.float64], count: int) -> None:
    assert len(held_out(places, 2, np.random.default_rng(0))) == count


def test_few_members_spare_views_and_many_spare_members_to_validate() -> None:
    few = choose_splits(members_at(np.linspace(-1, 1, 3)[:, None]), space_of(1), "dvr")
    assert (set(few.members.values()), few.validation_views) == ({"train"}, 16)
    seen = few.of(members_at(np.zeros((1, 1)))[0])
    assert seen is not None
    assert [view for view, split in enumerate(seen.view_splits) if split == "validation"] == [17, 49]
    assert [split for split in seen.view_splits if split == "test"] == ["test"] * 40
    many = choose_splits(members_at(np.linspace(-1, 1, 9)[:, None]), space_of(1), "dvr")
    assert (list(many.members.values()).count("validation"), many.validation_views) == (1, 0)


def test_views_that_validate_already_are_enough_for_few_members_but_not_for_many() -> None:
    def splits(count: int) -> Splits:
        members = members_at(np.linspace(-1, 1, count)[:, None])
        views = ("validation", *VIEWS[1:])
        return choose_splits([replace(m, view_splits=views) for m in members], space_of(1), "dvr")

    assert (set(splits(3).members.values()), splits(3).validation_views) == ({"train"}, 0)
    assert list(splits(9).members.values()).count("validation") == 1


def test_the_distance_to_a_hull_is_that_of_geometry() -> None:
    square = np.array([[-1.0, -1], [-1, 1], [1, -1], [1, 1]])
    for place, distance in (((0, 0), 0.0), ((1, 0.3), 0.0), ((2.5, 0.3), 1.5), ((2, 3), np.hypot(1, 2)), ((-9, 0), 8)):
        assert _distance_to_hull(square, np.array(place, dtype=float)) == pytest.approx(distance, abs=1e-9)


def test_splits_that_are_given_are_kept() -> None:
    members = members_at(np.linspace(-1, 1, 9)[:, None], "ttvttxttt")
    assert choose_splits(members, space_of(1), "dvr").members == {m.name: m.split for m in members}
    with pytest.raises(ValueError, match="1 test members already"):
        choose_splits(members, space_of(1), "dvr", hold_out=0.2)


def test_only_members_that_show_what_is_learnt_are_held_out() -> None:
    places = np.linspace(-1, 1, 12)[:, None]
    members = members_at(places[:6]) + members_at(places[6:], appearances=("iso",))
    members = [replace(m, name=f"m{i}") for i, m in enumerate(members)]
    splits = choose_splits(members, space_of(1), "iso", hold_out=0.3)
    assert of_split(splits, "test")
    assert min(of_split(splits, "test")) > 5


@pytest.mark.parametrize("share", [0.0, 1.0, -0.2, 3, float("nan"), "half", True])
def test_a_share_must_be_one(share: float) -> None:
    with pytest.raises(ValueError, match="must lie between 0 and 1"):
        choose_splits(members_at(np.linspace(-1, 1, 9)[:, None]), space_of(1), "dvr", hold_out=share)


def test_nothing_to_hold_out_is_said() -> None:
    with pytest.raises(ValueError, match="none of the 2 training members lies between others"):
        choose_splits(members_at(np.array([[-1.0], [1.0]])), space_of(1), "dvr", hold_out=0.5)


def test_a_catalog_is_seen_with_the_splits_of_a_run(tmp_path: Path) -> None:
    catalog = make_catalog(tmp_path, "blobs")
    chosen = Splits({"train-0": "train", "train-1": "test", "test-0": "train"})
    seen = catalog.with_splits(chosen)
    assert {m.name: m.split for m in seen.members} == chosen.members
    assert {m.name for m in catalog.members} == set(MEMBERS)
    assert {m.name for m in Catalog.open(catalog.path).members if m.split == "test"} == {"test-0"}
    assert seen.table() == catalog.table()


def test_splits_are_json() -> None:
    splits = Splits({"a": "train", "b": "test"}, 4)
    assert Splits.from_json(splits.to_json()) == splits
    for members, views in (({"a": "tset"}, 0), ({"a": "train"}, -1), ({"a": "train"}, 1.5)):
        with pytest.raises(ValueError, match="must be"):
            Splits(members, views)  # type: ignore[arg-type]
