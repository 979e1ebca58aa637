"""Warnings of a run: each kind once, with a count at its end, and what members show before the first is rendered."""

import shutil
from pathlib import Path
from typing import Any

import pytest

import insitu
from catalogs.vocabulary.appearance import TransferFunction, VolumeRendering
from catalogs.vocabulary.parameters import Parameter, ParameterSpace
from catalogs.vocabulary.scene import PlannedMember, ViewPlan
from insitu.members.notes import Once, kind_of, notes_on_ensemble
from tests.support.hooked import FUNCTION, SPACING, blob

SPACE = ParameterSpace((Parameter("Re", 1.0, 2.0),))


def members(values: list[float], split: str = "train") -> list[PlannedMember]:
    return [PlannedMember(f"m{i}", {"Re": value}, split) for i, value in enumerate(values)]


@pytest.mark.parametrize(
    ("values", "split", "expected"),
    [
        ([1.0, 1.2, 1.4, 1.6, 2.0], "train", []),
        ([1.0, 1.2, 1.4, 1.6, 5.0], "train", []),
        (
            [1000.0, 1200.0, 1400.0, 1600.0, 2000.0],
            "train",
            ["all members lie outside the bounds [1, 2] of Re, from 1000"],
        ),
        ([1.5] * 6, "train", ["parameter Re is 1.5 in every member"]),
        ([1.0, 1.3, 1.6, 2.0], "train", []),
        ([1.0, 1.5, 2.0], "train", ["3 of 3 members are to learn from: a surrogate of fewer than 4 can"]),
        ([1.0, 1.2, 1.4, 1.6, 2.0], "test", ["0 of 5 members are to learn from"]),
    ],
)
def test_what_members_show_is_said_before_the_first(values: list[float], split: str, expected: list[str]) -> None:
    notes = notes_on_ensemble(members(values, split), SPACE)
    assert len(notes) == len(expected)
    assert all(note.startswith(start) for note, start in zip(notes, expected, strict=True))


def test_kinds_differ_in_more_than_numbers() -> None:
    assert kind_of("dvr: 50.3 dB at 1e-05, -2 to inf") == kind_of("dvr: 4 dB at 12.5, 17 to 3")
    assert kind_of("dvr: 5 dB") != kind_of("iso: 5 dB")


def test_each_kind_is_given_once_and_counted(tmp_path: Path) -> None:
    heard: list[str] = []
    plan: dict[str, Any] = {"space": {"Re": (100, 200)}, "views": ViewPlan(frequency=1, width=8, height=8)}
    look = VolumeRendering("dvr", FUNCTION)
    with insitu.Session(
        tmp_path / "a.cdb", appearances=look, sample_distance=0.1, warn=lambda note: heard.append(str(note)), **plan
    ) as session:
        results = [session.render_member(blob(), {"Re": 300.0 + i}, spacing=SPACING) for i in range(3)]
    assert [len(result.warnings) for result in results] == [1] * 3
    assert heard == [
        "parameter Re = 300 lies outside its bounds [100, 200]: predictions there extrapolate",
        "3 of 3 members had this warning: parameter Re = 302 lies outside its bounds [100, 200]: predictions there "
        "extrapolate",
        "a.cdb so far: all members lie outside the bounds [100, 200] of Re, from 300 to 302: are the bounds in another unit?",
        "a.cdb so far: 3 of 3 members are to learn from: a surrogate of fewer than 4 can at best blend between them",
    ]


def test_calls_without_a_session_say_a_thing_once_for_a_catalog(tmp_path: Path) -> None:
    heard: list[str] = []
    plan: dict[str, Any] = {"space": {"Re": (100, 200)}, "views": ViewPlan(frequency=1, width=8, height=8)}
    plan |= {"appearances": VolumeRendering("dvr", FUNCTION), "sample_distance": 0.1, "spacing": SPACING}
    for name in ("a.cdb", "b.cdb"):
        for i in range(3):
            insitu.render_member(
                blob(), {"Re": 300.0 + i}, catalog=tmp_path / name, warn=lambda note: heard.append(str(note)), **plan
            )
    shutil.rmtree(tmp_path / "a.cdb")
    assert len(heard) == 2
    insitu.render_member(
        blob(), {"Re": 9.0}, catalog=tmp_path / "a.cdb", warn=lambda note: heard.append(str(note)), **plan
    )
    assert len(heard) == 3


def test_notes_of_another_name_are_one_kind() -> None:
    heard: list[str] = []
    once = Once(lambda note: heard.append(str(note)))
    once.say("a", ["x 1"])
    once.say("b", ["x 2", "y"])
    assert heard == ["a: x 1", "b: y"]


@pytest.mark.parametrize(("scale", "warned"), [(1.0, False), (5.0, False), (1000.0, True)])
def test_a_field_far_beyond_the_transfer_function_is_said(scale: float, warned: bool, tmp_path: Path) -> None:
    heard: list[str] = []
    function = TransferFunction(
        ((-1.0, 0.0, 0.0, 1.0), (1.0, 1.0, 0.0, 0.0)), ((-1.0, 0.5), (0.0, 0.0), (1.0, 0.5)), opacity_unit_distance=0.3
    )
    insitu.render_member(
        scale * (2.0 * blob() - 1.0),
        {"Re": 150.0},
        catalog=tmp_path / "a.cdb",
        space={"Re": (100, 200)},
        appearances=VolumeRendering("dvr", function),
        views=ViewPlan(frequency=1, width=8, height=8),
        sample_distance=0.1,
        spacing=SPACING,
        warn=lambda note: heard.append(str(note)),
    )
    assert [("are clipped" in note and "other units" in note) for note in heard] == [True] * warned
