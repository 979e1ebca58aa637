import sys
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from catalogs.store.catalog import Catalog
from catalogs.vocabulary.cameras import Camera
from surrogate.gaussians import Normalization
from surrogate.initialization import structure_from_motion as module
from surrogate.initialization.pictures import StartPoints
from surrogate.initialization.structure_from_motion import (
    neighbours,
    structure_from_motion_points,
)
from tests.support import prepared
from tests.support.balls import Ball, grey, speckled, store

BALL = Ball(radius=80.0, center=(505.0, -297.0, 101.0), size=160)
PIXEL = 2.0 * 5.0 * np.tan(np.radians(16.0)) / BALL.size  # in normalized units, at the middle of the box


@cache
def pictures() -> dict[tuple[float, ...], NDArray[np.float32]]:
    """The speckled ball as each camera sees it, by the position of the camera."""
    return {tuple(camera.position): BALL.picture(camera, speckled(BALL)) for camera in BALL.cameras()}


def speckles(camera: Camera) -> NDArray[np.float32]:
    return pictures()[tuple(camera.position)]


def structure(catalog: Catalog, seed: int = 0) -> StartPoints:
    pytest.importorskip("pycolmap")
    normalization = Normalization.of_box(catalog.plan.bounds)
    return structure_from_motion_points(catalog, catalog.member("member-0"), "drawn", normalization, seed=seed)


def check_on_surface(points: StartPoints, ball: Ball, least: int) -> None:
    """A feature is located to a small part of a pixel; where neighbours see it askew, to more."""
    places = points.places
    assert len(places) >= least
    off = np.abs(np.linalg.norm(places - ball.normalized_center, axis=1) - ball.normalized_radius)
    assert np.median(off) < 0.1 * PIXEL
    assert np.percentile(off, 95) < 0.5 * PIXEL
    octants = (places > ball.normalized_center) @ [1, 2, 4]
    assert np.bincount(octants, minlength=8).min() > 0.05 * len(places)
    world = places * ball.half_box + np.array(ball.box_center)
    assert points.colors is not None
    assert np.abs(points.colors - speckled(ball)(world)).mean() < 0.03  # the noise itself deviates by 0.18


@pytest.mark.slow
@pytest.mark.parametrize(("background", "least"), [(None, 1200), ((1.0, 1.0, 1.0), 600)])
def test_points_lie_on_a_textured_ball(
    tmp_path: Path, background: tuple[float, float, float] | None, least: int
) -> None:
    """And only training views are looked at: the others are empty here."""
    cameras = BALL.cameras()
    splits = ["test" if i % 7 == 3 else "train" for i in range(len(cameras))]
    blank = cameras[3::7]

    def drawn(camera: Camera) -> NDArray[np.float32]:
        return np.float32(camera not in blank) * speckles(camera)

    catalog = store(tmp_path, BALL, speckled(BALL), view_splits=splits, drawn=drawn, background=background)
    check_on_surface(structure(catalog), BALL, least)


@pytest.mark.slow
def test_the_same_seed_gives_the_same_points_and_colmap_says_and_leaves_nothing(
    tmp_path: Path, capfd: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    pycolmap = pytest.importorskip("pycolmap")
    catalog = store(tmp_path, BALL, speckled(BALL), cameras=BALL.cameras()[:14], drawn=speckles)
    (tmp_path / "temporary").mkdir()
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path / "temporary"))
    before = pycolmap.logging.minloglevel
    first = structure(catalog)
    assert capfd.readouterr() == ("", "")
    assert pycolmap.logging.minloglevel == before
    assert not list((tmp_path / "temporary").iterdir())
    second = structure(catalog)
    np.testing.assert_array_equal(first.places, second.places)
    np.testing.assert_array_equal(first.colors, second.colors)


@pytest.mark.parametrize("count", [1, 12])
@pytest.mark.parametrize("blank", [True, False])
def test_too_few_points_are_an_error_that_says_how_many(tmp_path: Path, blank: bool, count: int) -> None:
    def drawn(camera: Camera) -> NDArray[np.float32]:
        picture = BALL.picture(camera, grey)
        return np.zeros_like(picture) if blank else picture

    catalog = store(tmp_path, BALL, grey, cameras=BALL.cameras()[:count], drawn=drawn)
    with pytest.raises(
        ValueError, match=rf'found \d+ points in {count} .*translucent.*training\.initialization = "random"'
    ):
        structure(catalog)


def test_two_features_of_one_picture_are_one_view_of_a_point(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Two neighbouring features of a picture may be taken for the same point; two rays may still have met by chance."""
    pytest.importorskip("pycolmap")
    catalog = store(tmp_path, BALL, grey, cameras=BALL.cameras()[:3])
    middle = BALL.size // 2
    chance = [module.Track(np.zeros(3), np.array([[0, middle, middle], [0, middle, middle + 1], [1, middle, middle]]))]
    monkeypatch.setattr(module, "triangulate", lambda *_: chance * module.FEWEST_POINTS)
    with pytest.raises(ValueError, match=r"structure from motion found 0 points"):
        structure(catalog)


def test_without_pycolmap_the_error_names_the_extra(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    catalog = store(tmp_path, BALL, grey, cameras=BALL.cameras()[:1])
    monkeypatch.setitem(sys.modules, "pycolmap", None)
    with pytest.raises(ValueError, match=r"needs pycolmap, which is not installed: pip install 'gs-surrogate\[sfm\]'"):
        structure_from_motion_points(
            catalog, catalog.member("member-0"), "drawn", Normalization.of_box(catalog.plan.bounds)
        )


@pytest.mark.slow
def test_loading_the_module_does_not_load_pycolmap() -> None:
    program = "import sys, surrogate.initialization.structure_from_motion\nraise SystemExit('pycolmap' in sys.modules)"
    assert prepared.run(program)[0] == 0


def test_termination_is_answered_as_before() -> None:
    """COLMAP's own handler would end training without its last checkpoint."""
    pytest.importorskip("pycolmap")
    program = (
        "import os, signal\n"
        "signal.signal(signal.SIGTERM, lambda *_: print('answered'))\n"
        "from surrogate.initialization.structure_from_motion import _load_pycolmap\n"
        "_load_pycolmap()\n"
        "os.kill(os.getpid(), signal.SIGTERM)\n"
    )
    assert prepared.run(program) == (0, "answered\n", "")


def test_views_are_matched_with_their_nearest() -> None:
    cameras = BALL.cameras(1)  # an icosahedron: 5 views are adjacent, 5 further away, 1 opposite
    pairs = neighbours(cameras)
    assert pairs == sorted(set(pairs))
    assert all(i < j for i, j in pairs)
    forward = np.stack([camera.forward for camera in cameras])
    adjacent = {(i, j) for i in range(12) for j in range(i + 1, 12) if forward[i] @ forward[j] > 0.4}
    assert len(adjacent) == 30
    assert adjacent <= set(pairs)
    assert not [(i, j) for i, j in pairs if forward[i] @ forward[j] < -0.9]
    assert neighbours(cameras[:1]) == []
    assert neighbours(cameras[:2]) == [(0, 1)]
