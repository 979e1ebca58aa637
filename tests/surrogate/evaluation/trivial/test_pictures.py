"""Mixtures of members' pictures: which views stand in for one another, and what is left out of memory."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from catalogs.cameras import Camera, orbit
from surrogate.evaluation.cases import Case
from surrogate.evaluation.trivial.interpolation import fixed_rules
from surrogate.evaluation.trivial.pictures import MemberMixtures, nearest_views
from tests.support.varied_blobs import varied_catalog, varied_surrogate

CAMERAS = tuple(orbit((0, 0, 0), 2.0, width=8, height=8, frequency=2))


class Seen:
    """A member that has some of the views."""

    def __init__(self, *views: int) -> None:
        self.cameras = tuple(CAMERAS[view] for view in views)


def test_the_view_itself_is_taken_where_a_member_has_it() -> None:
    everything = Seen(*range(len(CAMERAS)))
    views, degrees = nearest_views([everything, everything], CAMERAS)  # type: ignore[list-item]
    assert (views == np.arange(len(CAMERAS))[:, None]).all()
    assert degrees == pytest.approx(0.0, abs=1e-4)


def test_the_nearest_view_stands_in_and_the_worst_angle_is_told() -> None:
    members = [Seen(*range(len(CAMERAS))), Seen(3, 11, 20)]
    views, degrees = nearest_views(members, CAMERAS)  # type: ignore[arg-type]
    for camera, (first, second), told in zip(CAMERAS, views, degrees, strict=True):
        angles = [np.degrees(np.arccos(np.clip(c.forward @ camera.forward, -1, 1))) for c in members[1].cameras]
        assert CAMERAS[first] is camera
        assert angles[second] == pytest.approx(min(angles), abs=1e-6)
        assert told == pytest.approx(min(angles), abs=1e-4)


def test_a_camera_is_told_from_the_same_one_rolled_about_its_axis() -> None:
    straight = Camera.look_at((0, 0, 5), (0, 0, 0), vertical_fov_degrees=30, width=8, height=8, up=(0, 1, 0))
    rolled = Camera.look_at((0, 0, 5), (0, 0, 0), vertical_fov_degrees=30, width=8, height=8, up=(1, 0, 0))
    member = Seen()
    member.cameras = (rolled, straight)
    assert nearest_views([member], [straight, rolled])[0].tolist() == [[1], [0]]  # type: ignore[list-item]


def test_every_picture_is_the_mixture_of_the_same_view(tmp_path: Path) -> None:
    catalog = varied_catalog(tmp_path / "a.cdb", varied_surrogate())
    members = [member for member in catalog.members if member.split == "train"]
    rules = fixed_rules(1)
    mixtures = MemberMixtures(catalog, "dvr", members, rules)
    cases = [Case(catalog.member(name), view, "dvr") for name in ("test-0", "validation-0") for view in (4, 0, 3)]
    weights = {"test-0": [[0.5, 0.5], [1, 0], [0.5, 0.5]], "validation-0": [[0.5, 0.5], [1, 0], [0.75, 0.25]]}
    drawn = {case: list(draw(case)) for batch, draw in mixtures.batches(cases) for case in batch}
    assert mixtures.names == ["mean image", "nearest member", "linear interpolation"]
    assert set(drawn) == set(cases)
    for case, pictures in drawn.items():
        stored = np.stack([catalog.image(member, "dvr", case.view) / 255.0 for member in members])
        for picture, row in zip(pictures, weights[case.member.name], strict=True):
            np.testing.assert_allclose(picture, np.tensordot(row, stored, axes=1), atol=1e-6)
    assert mixtures.borrowed_degrees(cases) == 0.0
    lacking = replace(members[0], cameras=members[0].cameras[:2], view_splits=members[0].view_splits[:2])
    assert MemberMixtures(catalog, "dvr", [lacking], rules).borrowed_degrees(cases) > 1.0
