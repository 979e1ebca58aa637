"""Dumps of one run are held out together."""

from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from catalogs.store.members import Member
from catalogs.store.splits import Splits, choose_splits, ordered_names, shared_runs
from catalogs.vocabulary.parameters import Parameter, ParameterSpace
from tests.support.blobs import Blobs

CAMERAS = tuple(Blobs().cameras()[:2])


def space_of(*names: str) -> ParameterSpace:
    return ParameterSpace(tuple(Parameter(name, 0.0, 100.0) for name in names))


def members_of(rows: Sequence[Mapping[str, float]], **more: object) -> list[Member]:
    return [
        Member(f"m{i}", dict(row), "train", CAMERAS, ("train", "test"), Path(f"m{i}"), appearances=("dvr",), **more)  # type: ignore[arg-type]
        for i, row in enumerate(rows)
    ]


def sides(members: Sequence[Member], splits: Splits, *ordered: str) -> dict[tuple[tuple[str, float], ...], set[str]]:
    """The splits of each run's members; a run, here, is what is equal in all parameters but these."""
    found = defaultdict(set)
    for member in members:
        run = tuple((n, v) for n, v in member.parameters.items() if n not in ordered)
        found[run].add(splits.members[member.name])
    return dict(found)


@pytest.mark.parametrize(
    "ordered",
    [
        ("time",),
        ("t",),
        ("Time",),
        ("step", "time"),
        ("time_step",),
        ("snapshot",),
        ("redshift",),
        ("cycle",),
        ("Frame",),
    ],
    ids="-".join,
)
@pytest.mark.parametrize("share", [0.1, 0.3])
def test_no_run_has_members_on_two_sides(ordered: tuple[str, ...], share: float) -> None:
    random = np.random.default_rng(5)
    runs = random.uniform(0, 100, (15, 2))
    rows = [
        {"Re": re, "Ma": ma, **{name: dump * (7.0 + i) for i, name in enumerate(ordered)}}
        for re, ma in runs
        for dump in range(1, 5)
    ]
    members = members_of([rows[i] for i in random.permutation(len(rows))])
    space = space_of("Re", "Ma", *ordered)
    splits = choose_splits(members, space, "dvr", hold_out=share, seed=2)
    found = sides(members, splits, *ordered)
    assert all(len(split) == 1 for split in found.values())
    assert sum(split == {"test"} for split in found.values()) == round(share * 15)
    assert sum(split == {"validation"} for split in found.values()) == 1
    seen = [m for m in (splits.of(member) for member in members) if m is not None]
    assert shared_runs(seen, space) == []
    before = choose_splits(members, space, "dvr", hold_out=share, seed=2, whole_runs=False)
    assert shared_runs([m for m in map(before.of, members) if m is not None], space)


@pytest.mark.parametrize(
    "names", [("T", "Re"), ("end_time", "Re"), ("relaxation time", "Re"), ("tau", "Re"), ("seed", "Re")]
)
def test_other_parameters_tell_runs_apart(names: tuple[str, ...]) -> None:
    assert ordered_names(space_of(*names)) == ()


def test_a_single_run_holds_out_dumps() -> None:
    members, space = members_of([{"time": float(t)} for t in range(20)]), space_of("time")
    splits = choose_splits(members, space, "dvr", hold_out=0.2)
    assert list(splits.members.values()).count("test") == 4
    same = choose_splits(members, space, "dvr", hold_out=0.2, whole_runs=False)
    assert splits == same


@pytest.mark.parametrize("values", [(1.0, 2.0), (50.0,)], ids=["two runs", "one, with a parameter that never varies"])
def test_where_no_run_lies_between_others_dumps_do(values: tuple[float, ...]) -> None:
    members = members_of([{"Re": re, "time": float(t)} for re in values for t in range(6)])
    splits = choose_splits(members, space_of("Re", "time"), "dvr", hold_out=0.2)
    assert "test" in splits.members.values()
    assert all("train" in found for found in sides(members, splits, "time").values())


def test_runs_of_several_seeds_are_runs_and_equal_members_are_one() -> None:
    rows = [
        {"Re": float(re), "seed": float(seed), "time": t} for re in range(6) for seed in range(3) for t in (1.0, 2.0)
    ]
    members, space = members_of(rows), space_of("Re", "seed", "time")
    found = sides(members, choose_splits(members, space, "dvr", hold_out=0.2), "time")
    assert len(found) == 18
    assert all(len(split) == 1 for split in found.values())
    assert sum(split == {"test"} for split in found.values()) == 4
    again = members_of([{"Re": float(re)} for re in range(12) for _ in range(3)])
    equal = sides(again, choose_splits(again, space_of("Re"), "dvr", hold_out=0.2))
    assert all(len(split) == 1 for split in equal.values())


def test_dumps_without_the_appearance_follow_their_run() -> None:
    members = members_of([{"Re": float(re), "time": float(t)} for re in range(6) for t in range(3)])
    members = [m if m.parameters["time"] == 1.0 else replace(m, appearances=("iso",)) for m in members]
    splits = choose_splits(members, space_of("Re", "time"), "dvr", hold_out=0.2)
    found = sides(members, splits, "time")
    assert all(len(split) == 1 for split in found.values())
    assert {"test"} in found.values()


def test_members_of_one_dump_each_are_drawn_as_before() -> None:
    rows = np.random.default_rng(0).uniform(0, 100, (30, 2))
    members, space = members_of([{"Re": re, "time": t} for re, t in rows]), space_of("Re", "time")
    both = [choose_splits(members, space, "dvr", hold_out=0.2, whole_runs=rule) for rule in (True, False)]
    assert both[0] == both[1]
