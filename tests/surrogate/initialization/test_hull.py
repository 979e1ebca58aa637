from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from catalogs.store.catalog import Catalog
from catalogs.vocabulary.cameras import Camera
from surrogate.gaussians import Normalization
from surrogate.initialization.hull import SLACK, hull_points, occupied, voxels
from surrogate.initialization.pictures import Picture, Points
from tests.support.balls import Ball, grey, store

COUNT = 5000
BALL = Ball()
PIXEL = 2.0 * 5.0 * np.tan(np.radians(16.0)) / BALL.size  # in normalized units, at the middle of the box


def hull(catalog: Catalog, seed: int = 0, member: str = "member-0") -> Points:
    normalization = Normalization.of_box(catalog.plan.bounds)
    chosen = catalog.member(member)
    return hull_points(catalog, chosen, "drawn", normalization, COUNT, np.random.default_rng(seed))


def distances(points: Points, ball: Ball) -> NDArray[np.float64]:
    return np.linalg.norm(points.places - ball.normalized_center, axis=1)


def check_fills(points: Points, ball: Ball) -> None:
    """Uniform in the ball, but for the pixels of its edge and the facets between 42 views."""
    places, radius = points.places, ball.normalized_radius
    assert places.shape == (COUNT, 3)
    away = distances(points, ball)
    assert away.max() < 1.1 * radius + PIXEL
    np.testing.assert_allclose(places.mean(0), ball.normalized_center, atol=0.03)
    inside = away < radius
    assert inside.mean() > 0.8
    np.testing.assert_allclose((away[inside] < radius / 2.0).mean(), 1.0 / 8.0, atol=0.02)
    octants = (places[inside] > ball.normalized_center) @ [1, 2, 4]
    np.testing.assert_allclose(np.bincount(octants, minlength=8) / inside.sum(), 1.0 / 8.0, atol=0.02)


def test_the_hull_of_a_ball_is_the_ball(tmp_path: Path) -> None:
    points = hull(store(tmp_path, BALL, grey))
    check_fills(points, BALL)
    assert points.colors is not None
    np.testing.assert_allclose(points.colors, np.tile([0.25, 0.5, 0.75], (COUNT, 1)), atol=0.01)


def test_colours_of_a_translucent_ball_are_straight(tmp_path: Path) -> None:
    points = hull(store(tmp_path, BALL, grey, drawn=lambda camera: np.float32(0.2) * BALL.picture(camera, grey)))
    check_fills(points, BALL)
    assert points.colors is not None
    np.testing.assert_allclose(points.colors.mean(0), [0.25, 0.5, 0.75], atol=0.02)


@pytest.mark.parametrize("background", [(1.0, 1.0, 1.0), (0.0, 0.0, 0.0)])
def test_opaque_pictures_show_the_ball_by_what_is_not_background(
    tmp_path: Path, background: tuple[float, float, float]
) -> None:
    points = hull(store(tmp_path, BALL, grey, background=background))
    check_fills(points, BALL)
    assert points.colors is not None
    np.testing.assert_allclose(np.median(points.colors, axis=0), [0.25, 0.5, 0.75], atol=0.02)


def test_what_is_thinner_than_a_voxel_is_not_lost(tmp_path: Path) -> None:
    """Wherever it lies in its voxel, here near a corner of eight."""
    centers, sides = voxels(np.array([[-1.0, -1.0, -1.0], [1.0, 1.0, 1.0]]))
    corner = centers[len(centers) // 3] + 0.499 * sides
    ball = Ball(radius=1.4, center=tuple(np.array(BALL.box_center) + BALL.half_box * corner))
    assert 2.0 * ball.normalized_radius < sides.min()
    points = hull(store(tmp_path, ball, grey))
    assert len(points.places)
    assert distances(points, ball).max() < 2.0 * PIXEL


def test_only_images_of_training_views_carve(tmp_path: Path) -> None:
    cameras = BALL.cameras()
    splits = ["train"] * len(cameras)
    splits[3], splits[20] = "test", "validation"
    blank = (cameras[3], cameras[20])

    def drawn(camera: Camera) -> NDArray[np.float32]:
        return np.float32(camera not in blank) * BALL.picture(camera, grey)

    catalog = store(tmp_path, BALL, grey, view_splits=splits, drawn=drawn, members=(("train", 0.0), ("test", 1.0)))
    check_fills(hull(catalog), BALL)
    with pytest.raises(ValueError, match=r"member-1 .* has no training images"):
        hull(catalog, member="member-1")


def test_a_view_says_nothing_about_what_it_does_not_see(tmp_path: Path) -> None:
    position = np.array(BALL.box_center) - [0.0, 500.0, 0.0]
    narrow = Camera.look_at(position, BALL.center, vertical_fov_degrees=2.0, width=BALL.size, height=BALL.size)
    check_fills(hull(store(tmp_path, BALL, grey, cameras=[*BALL.cameras(), narrow])), BALL)


def test_an_empty_hull_is_an_error_that_names_the_remedy(tmp_path: Path) -> None:
    catalog = store(tmp_path, BALL, grey, drawn=lambda camera: np.zeros((BALL.size, BALL.size, 4), np.float32))
    with pytest.raises(ValueError, match=r'member member-0 is empty.* training\.initialization = "random"'):
        hull(catalog)


def test_the_same_seed_gives_the_same_points(tmp_path: Path) -> None:
    catalog = store(tmp_path, BALL, grey)
    first, second, other = hull(catalog), hull(catalog), hull(catalog, seed=1)
    np.testing.assert_array_equal(first.places, second.places)
    assert (first.places != other.places).any()


def test_voxels_are_nearly_cubes_that_fill_a_flat_box() -> None:
    box = np.array([[-1.0, -0.3, 0.0], [1.0, 0.3, 0.001]])
    centers, sides = voxels(box)
    assert centers.shape == (64 * 19, 3)
    np.testing.assert_allclose(centers.min(0) - sides / 2.0, box[0], atol=1e-12)
    np.testing.assert_allclose(centers.max(0) + sides / 2.0, box[1], atol=1e-12)


@pytest.mark.slow
@pytest.mark.parametrize("vertical_fov_degrees", [20.0, 60.0, 110.0])
@pytest.mark.parametrize("radius", [0.03, 0.3])
def test_a_ball_of_which_one_pixel_is_seen_anywhere_is_kept(vertical_fov_degrees: float, radius: float) -> None:
    """Of points on its surface, projected one by one, the pixel that is farthest from its centre."""
    random = np.random.default_rng(2)
    camera = Camera.look_at(
        [0.0, 0.0, -2.0], [0.0, 0.0, 0.0], vertical_fov_degrees=vertical_fov_degrees, width=96, height=96
    )
    towards = random.normal(size=(4000, 3))
    towards /= np.linalg.norm(towards, axis=1, keepdims=True)
    for place in random.uniform(-1.0, 1.0, (60, 3)):
        pixels, _ = camera.project(place + radius * towards)
        (center,), _ = camera.project(place[None])
        seen = ((pixels >= 0) & (pixels < 96)).all(axis=1)
        if not seen.any() or not ((center >= 0) & (center < 96)).all():
            continue
        column, row = max(pixels[seen].tolist(), key=lambda pixel, c=center: float(np.hypot(*(pixel - c))))
        picture = np.zeros((96, 96, 4), np.uint8)
        picture[int(row), int(column)] = 255
        assert len(occupied(place[None], [Picture(camera, picture)], radius=radius, slack=SLACK))
