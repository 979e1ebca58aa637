"""Mixtures of stored pictures: which stand in for one another, and what rules make of them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from catalogs.store.catalog import Member
from catalogs.vocabulary.cameras import Camera, orbit
from catalogs.vocabulary.parameters import Parameter, ParameterSpace
from surrogate.evaluation.cases import Case
from surrogate.evaluation.trivial.interpolation import fixed_rules
from surrogate.evaluation.trivial.mixtures import MemberPictures, Mixtures
from tests.support.varied_blobs import varied_catalog, varied_surrogate

CAMERAS = tuple(orbit((0, 0, 0), 2.0, width=8, height=8, frequency=2))
SPACE = ParameterSpace((Parameter("p", 0.0, 1.0),))


def member(name: str, cameras: tuple[Camera, ...]) -> Member:
    return Member(name, {"p": 0.5}, "train", cameras, ("train",) * len(cameras), Path("nowhere"), appearances=("dvr",))


WANTED = member("wanted", CAMERAS)
CASES = [Case(WANTED, view, "dvr") for view in range(len(CAMERAS))]


def test_the_view_itself_is_taken_where_a_member_has_it() -> None:
    members = [member("a", CAMERAS), member("b", CAMERAS[::-1])]
    pictures = MemberPictures(SPACE, "dvr", members)
    for case in CASES:
        last = len(CAMERAS) - 1
        assert pictures.images_for(case) == [(members[0], "dvr", case.view), (members[1], "dvr", last - case.view)]
    assert pictures.borrowed_degrees(CASES) == 0.0


def test_the_nearest_view_stands_in_and_the_worst_angle_is_told() -> None:
    few = tuple(CAMERAS[view] for view in (3, 11, 20))
    pictures = MemberPictures(SPACE, "dvr", [member("a", CAMERAS), member("b", few)])
    worst = []
    for case in CASES:
        angles = [np.degrees(np.arccos(np.clip(c.forward @ case.camera.forward, -1, 1))) for c in few]
        (_, _, first), (_, _, second) = pictures.images_for(case)
        assert first == case.view
        assert angles[second] == pytest.approx(min(angles), abs=1e-6)
        worst.append(min(angles))
    assert pictures.borrowed_degrees(CASES) == pytest.approx(max(worst))
    assert pictures.borrowed_degrees([CASES[3]]) == 0.0


def test_a_camera_is_told_from_the_same_one_rolled_about_its_axis() -> None:
    straight = Camera.look_at((0, 0, 5), (0, 0, 0), vertical_fov_degrees=30, width=8, height=8, up=(0, 1, 0))
    rolled = Camera.look_at((0, 0, 5), (0, 0, 0), vertical_fov_degrees=30, width=8, height=8, up=(1, 0, 0))
    pictures = MemberPictures(SPACE, "dvr", [member("a", (rolled, straight))])
    wanted = member("wanted", (straight, rolled))
    assert [pictures.images_for(Case(wanted, view, "dvr"))[0][2] for view in (0, 1)] == [1, 0]


def test_every_picture_is_the_mixture_of_the_same_view(tmp_path: Path) -> None:
    catalog = varied_catalog(tmp_path / "a.cdb", varied_surrogate())
    members = [m for m in catalog.members if m.split == "train"]
    mixtures = Mixtures(catalog, MemberPictures(catalog.plan.space, "dvr", members), fixed_rules(1))
    cases = [Case(catalog.member(name), view, "dvr") for name in ("test-0", "validation-0") for view in (4, 0, 3)]
    weights = {
        "test-0": [[0.5, 0.5], [1, 0], [0.5, 0.5], [0.5, 0.5]],
        "validation-0": [[0.5, 0.5], [1, 0], [0.75, 0.25], [0.75, 0.25]],
    }
    drawn = {case: list(draw(case)) for batch, draw in mixtures.batches(cases) for case in batch}
    between = "inverse distances to the 4 nearest members"
    assert mixtures.names == ["mean image", "nearest member", between, "linear interpolation"]
    assert set(drawn) == set(cases)
    for case, pictures in drawn.items():
        stored = np.stack([catalog.image(m, "dvr", case.view) / 255.0 for m in members])
        for picture, row in zip(pictures, weights[case.member.name], strict=True):
            np.testing.assert_allclose(picture, np.tensordot(row, stored, axes=1), atol=1e-6)
