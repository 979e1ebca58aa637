"""Pictures that show nothing are warned of, with the field's range against what is shown."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from catalogs.vocabulary.appearance import Isosurface, TransferFunction, VolumeRendering
from catalogs.vocabulary.scene import ViewPlan
from insitu import Session
from insitu.members.blank import opaque_values

COLORS = ((0.0, 0.0, 0.0, 1.0), (1.0, 1.0, 0.0, 0.0))
FIELD = np.linspace(-2.0, -1.0, 8**3).reshape(8, 8, 8)


def volume(*points: tuple[float, float], name: str = "dvr") -> VolumeRendering:
    return VolumeRendering(name, TransferFunction(COLORS, points, 1.0))


HIGH = volume((0.0, 0.0), (0.5, 0.9), (1.0, 0.0))


def session(path: Path, *appearances: Any, heard: list[str] | None = None) -> Session:
    heard = [] if heard is None else heard
    return Session(
        path / "a.cdb",
        space={"a": (0.0, 9.0)},
        appearances=appearances,
        views=ViewPlan(frequency=1, width=8, height=8),
        sample_distance=None if all(isinstance(a, Isosurface) for a in appearances) else 1.0,
        warn=lambda note: heard.append(str(note)),
        nan="transparent",
    )


@pytest.mark.parametrize(
    ("appearance", "field", "message"),
    [
        (HIGH, FIELD, "dvr: every picture is blank: the field's values run from -2 to -1, the transfer function is opaque from"),
        (volume((0.0, 0.0), (1.0, 0.0)), FIELD, "the transfer function is transparent everywhere"),
        (volume((0.0, 0.0), (1.0, 0.5)), FIELD, "the transfer function is opaque above 0"),
        (volume((-3.0, 0.5), (-2.5, 0.0), (0.0, 0.0), (1, 0.5)), FIELD, "opaque below -2.5 and above 0"),
        (volume((-3.0, 0.0), (1.0, 1e-9)), FIELD, "too faint"),
        (volume((0.0, 0.5), (1.0, 0.5)), FIELD, "all of the field has one colour: the field's values run from -2 to -1"),
        (volume((0.0, 0.0), (1.0, 0.9)), np.where(FIELD < -1.6, 0.5, -1e3 * FIELD), "much of the field has the colours of"),
        (Isosurface("iso", 3.0), FIELD, "every picture is blank: the field's values run from -2 to -1, not through the isovalue 3"),
        (
            Isosurface("iso", -1.5),
            np.where(np.indices(FIELD.shape).sum(axis=0) % 2, np.nan, FIELD),
            "no camera sees the surface at -1.5",
        ),
    ],
)  # fmt: skip
def test_it_is_said_and_recorded(tmp_path: Path, appearance: Any, field: np.ndarray, message: str) -> None:
    heard: list[str] = []
    with session(tmp_path, appearance, heard=heard) as hook:
        member = hook.render_member(field, {"a": 1.0}, spacing=1.0)
    assert len(heard) == 1
    assert message in heard[0]
    assert member.warnings == (heard[0],)
    assert json.loads((member.path / "member.json").read_text())["provenance"]["warnings"] == heard


def test_it_is_said_once_a_session_and_recorded_of_every_member(tmp_path: Path) -> None:
    heard: list[str] = []
    with session(tmp_path, HIGH, volume((-2.0, 0.0), (1.0, 0.9), name="seen"), heard=heard) as hook:
        members = [hook.render_member(FIELD - shift, {"a": shift}, spacing=1.0) for shift in (0.0, 0.5, 0.9)]
    assert len(heard) == 3
    assert (
        heard[2]
        == "a.cdb so far: 3 of 3 members are to learn from: a surrogate of fewer than 4 can at best blend between them"
    )
    assert heard[1].startswith("3 of 3 members had this warning: dvr: every picture is blank")
    assert [len(member.warnings) for member in members] == [1, 1, 1]
    assert "from -2.9" in members[2].warnings[0]


def test_pictures_that_show_something_are_not_warned_of(tmp_path: Path) -> None:
    heard: list[str] = []
    with session(tmp_path, HIGH, Isosurface("iso", 0.5), heard=heard) as hook:
        member = hook.render_member(FIELD + 2.0, {"a": 1.0}, spacing=1.0)
    assert heard == []
    assert member.warnings == ()


@pytest.mark.parametrize(
    ("points", "expected"),
    [
        (((0, 0), (1, 0)), []),
        (((0, 1), (1, 1)), [(-np.inf, np.inf)]),
        (((0, 0), (1, 1), (2, 0), (3, 0), (4, 1)), [(0, 2), (3, np.inf)]),
        (((0, 0), (1, 1), (2, 0), (3, 1), (4, 0)), [(0, 2), (2, 4)]),
        (((0, 1), (1, 0)), [(-np.inf, 1)]),
    ],
)
def test_opaque_values(points, expected) -> None:
    assert opaque_values(TransferFunction(COLORS, points, 1.0)) == expected
