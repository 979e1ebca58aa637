"""Splits of members that came after a run began: those of the run stay, and so do the shares that are held out."""

from __future__ import annotations

from collections import Counter
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from catalogs.store.members import Member
from catalogs.store.splits import MOST_VALIDATION, Splits, _distance_to_hull, choose_splits, with_later
from catalogs.vocabulary.parameters import Parameter, ParameterSpace
from tests.support.blobs import Blobs

CAMERAS = tuple(Blobs().cameras()[:2])
SPACE = ParameterSpace((Parameter("Re", 0.0, 1.0), Parameter("Ma", 0.0, 1.0)))
DUMPS = ParameterSpace((Parameter("Re", 0.0, 1.0), Parameter("Ma", 0.0, 1.0), Parameter("time", 0.0, 1.0)))


def members_of(count: int, dumps: int = 0, **more: object) -> list[Member]:
    """Members at places of a fixed random sequence, with as many dumps of each."""
    places = np.random.default_rng(2).uniform(0.0, 1.0, (count, 2)).tolist()
    times = [{"time": time} for time in np.linspace(0.0, 1.0, dumps)] if dumps else [{}]
    rows = [{"Re": re, "Ma": ma} | time for re, ma in places for time in times]
    fields = {"appearances": ("dvr",), **more}
    return [
        Member(f"m{i}", row, "train", CAMERAS, ("train", "test"), Path(f"m{i}"), **fields)  # type: ignore[arg-type]
        for i, row in enumerate(rows)
    ]


@pytest.mark.parametrize("hold_out", [None, 0.2])
@pytest.mark.parametrize(("first", "steps"), [(20, (40,)), (20, (21, 22, 23, 24, 25, 30)), (10, (80, 400))])
def test_shares_stay_what_they_were(first: int, steps: tuple[int, ...], hold_out: float | None) -> None:
    every = members_of(max(steps))
    splits = choose_splits(every[:first], SPACE, "dvr", hold_out=hold_out)
    for count in steps:
        before, members = splits, every[:count]
        splits = with_later(before, members, SPACE, "dvr", hold_out=hold_out)
        assert before.members.items() <= splits.members.items()
        counts = Counter(splits.members.values())
        tests = round((hold_out or 0.0) * count)
        assert abs(counts["test"] - tests) <= 1  # validation members were training members before
        assert counts["validation"] == pytest.approx(min(MOST_VALIDATION, 0.08 * (count - counts["test"])), abs=1)
        assert splits == with_later(before, members, SPACE, "dvr", hold_out=hold_out)
        places = {m.name: np.array([m.parameters["Re"], m.parameters["Ma"]]) for m in members}
        for name in (n for n, split in splits.members.items() if split != "train" and n not in before.members):
            others = np.array([place for other, place in places.items() if other != name])
            assert _distance_to_hull(others, places[name]) < 0.25


def test_dumps_join_their_run_and_whole_runs_are_held_out() -> None:
    every = members_of(40, dumps=6)
    early = [m for m in every[:120] if m.parameters["time"] < 0.7]
    before = choose_splits(early, DUMPS, "dvr", hold_out=0.2)
    splits = with_later(before, every, DUMPS, "dvr", hold_out=0.2)
    sides: dict[float, set[str]] = {}
    for member in every:
        sides.setdefault(member.parameters["Re"], set()).add(splits.members[member.name])
    assert all(len(side) == 1 for side in sides.values())
    assert Counter(side.pop() for side in sides.values())["test"] == pytest.approx(8, abs=1)


def test_dumps_of_one_run_are_held_out_one_by_one() -> None:
    every = [replace(m, parameters={**m.parameters, "Re": 0.5, "Ma": 0.5}) for m in members_of(1, dumps=60)]
    before = choose_splits(every[::2], DUMPS, "dvr", hold_out=0.2)
    splits = with_later(before, every, DUMPS, "dvr", hold_out=0.2)
    assert Counter(splits.members.values())["test"] == pytest.approx(12, abs=1)


def test_the_catalogs_own_splits_stay() -> None:
    every = [
        replace(m, split="test" if i % 5 == 4 else "validation" if i % 5 == 3 else "train")
        for i, m in enumerate(members_of(30))
    ]
    before = choose_splits(every[:20], SPACE, "dvr")
    splits = with_later(before, every, SPACE, "dvr")
    assert splits == Splits({m.name: m.split for m in every})


@pytest.mark.parametrize(("appearances", "count"), [(("dvr",), 30), ((), 20), (("iso",), 20)])
def test_members_without_the_appearance_wait(appearances: tuple[str, ...], count: int) -> None:
    every = members_of(20) + [replace(m, appearances=appearances) for m in members_of(30)[20:]]
    splits = with_later(choose_splits(every[:20], SPACE, "dvr"), every, SPACE, "dvr")
    assert len(splits.members) == count


def test_few_members_keep_the_views_that_validate_them() -> None:
    every = members_of(5)
    before = choose_splits(every[:4], SPACE, "dvr")
    assert before.validation_views
    splits = with_later(before, every, SPACE, "dvr")
    assert (splits.validation_views, set(splits.members.values())) == (before.validation_views, {"train"})
